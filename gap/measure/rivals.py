"""What the numbers of named causes are beside the rivals of each of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from ..replay.parameters import Parameter
from ..replay.problem import Problem
from ..search.fit import Fit, fit, merge, middle
from ..search.intervals import intervals
from ..search.result import Search

Interval = tuple[float, float]
IntervalsAt = Callable[[Sequence[Parameter], tuple[Fit, Fit]], Mapping[str, Interval]]
"""Intervals by path of a model with these parameters, of which there are fits to both parts of the data."""


def beside_rivals(search: Search, bounds: Mapping[str, Interval], intervals_at: IntervalsAt) -> dict[str, Interval]:
    """Intervals that also hold what each number is beside the rivals of the causes, as far as it is open there.

    Of a weaker motor and an encoder that reads too much, which one is beside a rotor decides how heavy the rotor is.
    And what one of them leaves open of it, the other may not: with a motor constant that is a cause, a resistance is
    told closely; with one that is only known within its tolerance, it is not.

    Args:
        search: that found the model.
        bounds: intervals by path.
        intervals_at: gives those of another model.
    """
    found, told = dict(bounds), {p.path for one in search.accepted for p in one.variant} & bounds.keys()
    for place, step in enumerate(step for step in search.rounds if step.accepted):
        others = [one.variant for number, one in enumerate(search.accepted) if number != place]
        for rival in search.close(step):
            fitted = rival.fits[0].values
            turned = merge(search.tuned, *others, rival.variant)
            if not {p.path for p in turned} <= fitted.keys():  # it was tried before all the others were found
                continue
            there = intervals_at(turned, rival.fits)
            for path in told & there.keys():
                (low, high), (least, most) = found[path], there[path]
                found[path] = min(low, least), max(high, most)
    return found


def intervals_of(problem: Problem, iterations: int, seed: int) -> IntervalsAt:
    """Intervals of models over one problem, each about its own optimum.

    Args:
        problem: all that may be fitted.
        iterations: of a fit that begins half way between those to its parts.
        seed: of all resampling.
    """

    def at(parameters: Sequence[Parameter], fits: tuple[Fit, Fit]) -> Mapping[str, Interval]:
        found = fit(problem, parameters, middle(*fits), iterations)
        return intervals(problem, parameters, found, seed, fits)

    return at
