"""One latency of the bus for all joints: commands of one host take effect as late at each of them.

Joint by joint a latency is one number among many, and what else is wrong at the joint bends it. What is equal at joints
that have nothing else in common is of the bus.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..causes.cause import Cause
from ..checks.signal import block_weights
from ..replay.parameters import Parameter
from ..replay.problem import periods_of
from .delays import DELAY
from .look import Look, in_place_of

NUMBER = "delay.seconds"
RIVAL = "drive.goal_filter"
"""What delays all commands as well, though not by the same time at every speed."""
AGREEING = 2.0 / 3.0  # of the joints, and two at least
CLOCK = 0.1  # of a sample period, by which joints may differ in any case
ROOM = 1.5  # half widths of the shared interval within which each joint may turn it
DRAWS = 400
WORTH = 0.02  # of the loss that the latency must remove


@dataclass(frozen=True)
class Latency:
    """A latency that joints share.

    Attributes:
        value, low, high: of it, and 95 % interval [s].
        believed: by the chains [s].
        joints: that have it.
        confidence: share of the bootstrap draws in which it explains the joints better than none and than a filter of
            the goals, times the share of the joints that agree.
    """

    value: float
    low: float
    high: float
    believed: float
    joints: tuple[str, ...]
    confidence: float

    def numbers_of(self, joint: str, numbers: Sequence[Parameter]) -> list[Parameter]:
        """Numbers of a joint with this one where it is known to be, if the joint has it."""
        if joint not in self.joints:
            return list(numbers)
        half = ROOM * 0.5 * (self.high - self.low)
        known = Parameter(
            NUMBER, "s", max(self.value - half, 0.0), self.value + half, self.value, 0.004, difference=0.5
        )
        return [*(p for p in numbers if p.number != NUMBER), known]

    def causes_of(self, joint: str, causes: Sequence[Cause]) -> list[Cause]:
        """Causes that are still to be sought at a joint."""
        return [cause for cause in causes if not (cause.name == DELAY and joint in self.joints)]


def latency_of(looks: Mapping[str, Look], causes: Mapping[str, Sequence[Cause]], seed: int = 0) -> Latency | None:
    """The latency that joints share; None where they share none, or it is as believed.

    Args:
        looks: at each joint.
        causes: that each joint can have.
        seed: of the bootstrap.
    """
    rows = {}
    for joint, seen in looks.items():
        parameter = next((p for p in seen.parameters if p.number == NUMBER), None)
        if parameter is not None and any(cause.name == DELAY for cause in causes[joint]):
            nominal = seen.problem.models[0]
            ends = (seen.found.values[parameter.path], *seen.bounds[parameter.path])
            value, low, high = (float(parameter.physical(x, nominal)) for x in ends)
            rows[joint] = value, max(0.5 * (high - low), CLOCK * max(periods_of(seen.problem))), nominal.value(NUMBER)
    if len(rows) < 2 or len({round(believed, 6) for *_, believed in rows.values()}) > 1:
        return None
    believed = next(iter(rows.values()))[2]
    joints = agreeing({joint: (value, half) for joint, (value, half, _) in rows.items()})
    if len(joints) < max(2, AGREEING * len(rows)):
        return None
    clock = CLOCK * max(max(periods_of(looks[joint].problem)) for joint in joints)
    mean = apart_from(believed, {joint: rows[joint][:2] for joint in joints}, clock)
    if mean is None:
        return None
    value, half = mean
    sure = _win_rate({joint: looks[joint] for joint in joints}, causes, seed)
    if sure is None:
        return None
    found = Latency(value, max(value - half, 0.0), value + half, believed, tuple(joints), 0.0)
    return replace(found, confidence=sure * len(joints) / len(rows))


def agreeing(values: Mapping[str, tuple[float, float]]) -> list[str]:
    """The joints that agree on a value, by value and half width of each: those that are left once the one that is
    furthest from the mean of the others, beyond both intervals, was dropped, again and again.
    """
    left = dict(values)
    while len(left) > 1:
        apart = {}
        for joint, (value, half) in left.items():
            mean, others = mean_of([pair for other, pair in left.items() if other != joint])
            apart[joint] = abs(value - mean) / np.hypot(half, others)
        worst = max(apart, key=apart.__getitem__)
        if apart[worst] <= 1.0:
            break
        # the one with the wider interval knows less
        del left[worst]
    return list(left)


def apart_from(believed: float, values: Mapping[str, tuple[float, float]], clock: float) -> tuple[float, float] | None:
    """The mean of the joints' values, and its half width; None where it may be what is believed.

    What one joint alone says is that joint's: without any of them, the others must say it too.

    Args:
        believed: value.
        values: of each joint, with its half width.
        clock: by which all joints may be off alike, which no mean takes away.
    """
    means = [mean_of([pair for joint, pair in values.items() if joint != left]) for left in (None, *values)]
    if any(abs(value - believed) <= max(half, clock) for value, half in means):
        return None
    value, half = means[0]
    return value, max(half, clock)


def mean_of(values: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """The mean of values with half widths, each weighted by its width, and the half width of the mean: wider where they
    differ by more than they say.
    """
    at, half = np.array(values, float).T
    weight = half**-2.0
    mean = float(weight @ at / weight.sum())
    spread = float(weight @ (at - mean) ** 2) / max(len(at) - 1, 1)
    return mean, float(np.sqrt(max(spread, 1.0) / weight.sum()))


def _win_rate(looks: Mapping[str, Look], causes: Mapping[str, Sequence[Cause]], seed: int) -> float | None:
    """Share of the draws in which a latency explains the joints best; None where it is worth nothing."""
    with_it, without, filtered = [], [], []
    for joint, seen in looks.items():
        rival = next((cause.variants[0] for cause in causes[joint] if cause.name == RIVAL), ())
        with_it.append(seen.problem.block_errors(seen.found.simulated))
        without.append(seen.problem.block_errors(in_place_of(seen, NUMBER, ()).simulated))
        late = seen.problem.block_errors(in_place_of(seen, NUMBER, rival).simulated) if rival else without[-1]
        filtered.append(late)
    here, none, other = (np.concatenate(parts) for parts in (with_it, without, filtered))
    if not here.sum() < (1.0 - WORTH) * none.sum():
        return None
    weights = block_weights(len(here), DRAWS, np.random.default_rng(seed))
    return float(((weights @ here < weights @ none) & (weights @ here < weights @ other)).mean())
