"""The numbers that the nominal model has, refitted alone: the baseline that causes are held against.

A baseline that stops in a local minimum makes every cause look good. So it is fitted from several starts, of which one
counts errors as squares of their own size: far from the optimum, the robust loss hardly knows the way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import cast

from ..replay.comparison import rms
from ..replay.parameters import Parameter
from ..replay.problem import JointProblem, Problem
from .fit import Fit, fit
from .settings import SearchSettings
from .sketch import fit_from_sketch, is_long, most_iterations, sketch

LEFT = 3.0  # noise floors that a fit may leave before further starts are tried
CLOSE = 2.0  # standard errors: the size that the first, coarse fit gives to one


def refit(
    problem: Problem, wide: Sequence[Parameter], starts: Sequence[Mapping[str, float]], settings: SearchSettings
) -> Fit:
    """The best of several fits, which is never worse than the nominal model on what it was fitted to.

    Args:
        problem: what is fitted to.
        wide: numbers, with the bounds of refitting.
        starts: values by path from which to fit, too, where the fit from the believed numbers leaves much.
        settings: of the search.
    """
    found = [fit_from_sketch(problem, wide, None, settings)]
    joint = problem.joint
    if wide and joint is not None and rms(problem.position_error(found[0].simulated)) > LEFT * joint.noise:
        paths = {p.path for p in wide}
        known = [{path: x for path, x in start.items() if path in paths} for start in starts]
        tries = [_coarse(joint, wide, found[0], settings), *(start for start in known if start)]
        found += [fit(problem, wide, start, most_iterations(problem, settings)) for start in tries]
    nominal = problem.simulate([{}])[0]
    worst = rms(problem.position_error(nominal))
    sound = [one for one in found if rms(problem.position_error(one.simulated)) <= worst]
    if sound:
        return min(sound, key=lambda one: one.cost)
    believed = {p.path: min(max(p.neutral(problem.models[0]), p.low), p.high) for p in wide}
    return fit(problem, wide, believed, 0)


def _coarse(problem: JointProblem, wide: Sequence[Parameter], found: Fit, settings: SearchSettings) -> dict[str, float]:
    """Where a fit ends that takes all errors for small ones."""
    times = max(rms(problem.position_error(found.simulated)) / problem.noise / CLOSE, 1.0)
    part = sketch(problem, settings.sketched) if is_long(problem, settings.sketched) else problem
    coarse = cast(JointProblem, replace(part, weight=part.weight / times))
    return fit(coarse, wide, None, settings.iterations).values
