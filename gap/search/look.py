"""All usual numbers of a joint in one fit: what a log shows at first sight, before any search.

A search adds one cause at a time, and what comes first stands in for what is not there yet. Here the delay, the gain,
the supply, friction, the load and the stops are turned together with the numbers that the model has, by a few steps of
least squares on some seconds of the log. That takes a second or two for a joint. What comes out is provisional: nothing
was held back to judge it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..causes.cause import Cause
from ..log.parts import FIT_A, FIT_B
from ..replay.comparison import rms
from ..replay.parameters import Parameter
from ..replay.problem import Problem, periods_of
from .delays import DELAY
from .fit import Fit, fit, merge
from .intervals import intervals
from .settings import SearchSettings
from .sketch import sketch

LOOKED_FOR = (
    DELAY,
    "drive.gain",
    "drive.offset",
    "drive.supply_sag",
    "friction.coulomb",
    "friction.viscous",
    "friction.load_dependent",
    "load.mass",
    "contact.blocked",
)
"""Causes that every machine may have; the first number of each is turned."""
ITERATIONS = 10
DRAWS = 200  # of the bootstrap that widens the intervals


@dataclass(frozen=True, eq=False)
class Look:
    """What one fit of all usual numbers says of a joint.

    Attributes:
        problem: the part of the log that was looked at.
        parameters: that were turned.
        found: the fit.
        bounds: 95 % intervals by path.
        causes: of :data:`LOOKED_FOR`, by the path of the number that each turns.
        errors: rms error of the believed model and of the fit, in the unit of the signal.
    """

    problem: Problem
    parameters: tuple[Parameter, ...]
    found: Fit
    bounds: Mapping[str, tuple[float, float]]
    causes: Mapping[str, str]
    errors: tuple[float, float]

    def effects(self) -> dict[str, float]:
        """How far the replay moves where a number is put back to what is believed, by path (rms, in the signal's unit).

        Only numbers of causes whose intervals leave out what is believed; the largest first. None where all of them
        together bring the replay nearer by less than the noise.
        """
        before, after = self.errors
        if before**2 - after**2 < self.problem.noise**2:
            return {}
        nominal = self.problem.models[0]
        told = {
            p.path: p.neutral(nominal)
            for p in self.parameters
            if p.path in self.causes and not self._may_be(p, p.neutral(nominal))
        }
        rows = [{**self.found.values, path: min(value, 1e9)} for path, value in told.items()]
        if not rows:
            return {}
        back, here = self.problem.simulate(rows), self.problem.position_error(self.found.simulated)
        moved = {path: rms(self.problem.position_error(row) - here) for path, row in zip(told, back, strict=True)}
        return dict(sorted(moved.items(), key=lambda item: -item[1]))

    def _may_be(self, parameter: Parameter, value: float) -> bool:
        low, high = self.bounds[parameter.path]
        return low <= value <= high


def look(problem: Problem, wide: Sequence[Parameter], causes: Sequence[Cause], settings: SearchSettings) -> Look:
    """One fit of all usual numbers of a joint.

    Args:
        problem: all data of the joint, in parts.
        wide: numbers that the model has, with the bounds of refitting.
        causes: that the joint can have.
        settings: of a search.
    """
    part = sketch(problem.part(FIT_A, FIT_B), settings.sketched)
    owner: dict[str, str] = {}
    more: list[Parameter] = []
    for cause in causes:
        if cause.name in LOOKED_FOR:
            first = cause.variants[0][0]
            owner[first.path] = cause.name
            more.append(first)
    parameters = tuple(merge(wide, more))
    found = looked(part, parameters, causes)
    bounds = intervals(part, parameters, found, draws=DRAWS)
    before, after = (rms(part.position_error(row)) for row in (part.simulate([{}])[0], found.simulated))
    return Look(part, parameters, found, bounds, owner, (before, after))


def looked(part: Problem, parameters: Sequence[Parameter], causes: Sequence[Cause]) -> Fit:
    """One fit of many parameters, also from the other start that a delay has among its causes."""
    found = fit(part, parameters, None, ITERATIONS)
    # columns that are read once a sample leave a delay minima of their own, a sample apart
    apart = 0.5 * min(periods_of(part))
    for cause in [cause for cause in causes if cause.name == DELAY]:
        first, last = cause.variants[0][0], cause.variants[-1][0]
        if abs(last.start - first.start) > apart:
            other = fit(part, parameters, {last.path: last.start}, ITERATIONS)
            found = min(found, other, key=lambda one: one.cost)
    return found


def in_place_of(seen: Look, number: str, other: Sequence[Parameter]) -> Fit:
    """The fit of a look once more, from where it ended, with other parameters in place of one number.

    Args:
        seen: the look.
        number: that stays as believed.
        other: to be turned in its place; nothing: the number is only held.
    """
    kept = [p for p in seen.parameters if p.number != number]
    start = {path: value for path, value in seen.found.values.items() if any(p.path == path for p in kept)}
    return fit(seen.problem, merge(kept, other), start, ITERATIONS)
