"""What the motion of columns is evidence for: how late one follows another, the unit of a velocity, an encoder's
step."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..types import MIN_CHANGES, TURN_IN_UNITS, Array

STEP_TOLERANCE = 5e-5
MOTION_WINDOW = 0.1  # [s] over which motion is compared with the integral of its derivative
LONGEST_LAG = 0.6  # [s]
AGAINST_MARGIN = 0.1
"""Share of a motion by which it must go better against another one than along with it: of a swing both fit alike, half
a period apart."""
JUMP_SHARE = 0.1
"""Share of the changes of an angle up to which jumps by a turn are an encoder's; more are commanded steps."""
NOISE_FACTOR = 3.0
"""Times its noise that a column moves over :data:`MOTION_WINDOW`; noise alone makes 1.4."""
MOST_SAMPLES = 40_000


@dataclass(frozen=True)
class Relation:
    """How one signal goes with another: its scale per the first, the share of it that the first explains, and its lag
    [s]."""

    scale: float = 0.0
    fit: float = 0.0
    lag: float = 0.0


def span(values: Array) -> float:
    """How far a column reaches, -1 where it has no value."""
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) if len(finite) else -1.0


def whole_numbers(values: Array) -> bool:
    """Whether all values are whole."""
    known = values[np.isfinite(values)]
    return bool(len(known)) and bool((known == np.round(known)).all())


def encoder(values: Array) -> tuple[str, int] | None:
    """Unit and counts of a turn, where the values lie on the grid of an encoder: a turn in 2^n or 2^n - 1 steps."""
    step = _grid(values)
    if step <= 0.0 or abs(step - round(step, 3)) < 1e-9 * step:
        return None
    turns = ((unit, counts, turn) for unit, turn in TURN_IN_UNITS.items() for bits in range(8, 19)
             for counts in (2**bits, 2**bits - 1)[: 2 if bits < 15 else 1])  # fmt: skip
    return next((one[:2] for one in turns if abs(step * one[1] / one[2] - 1.0) < STEP_TOLERANCE), None)


def _grid(values: Array) -> float:
    """Step on which all values lie, 0 where they lie on none."""
    known = np.unique(values[np.isfinite(values)][:MOST_SAMPLES])
    gaps = np.diff(known)
    gaps = gaps[gaps > 1e-6 * max(float(np.abs(known).max(initial=0.0)), 1e-9)]  # single precision makes two of one
    if len(known) < 5 or not len(gaps):
        return 0.0
    step = float(np.median(gaps[gaps < 1.5 * gaps.min()]))
    for _ in range(3):  # the mean step over the whole range is exact to many digits
        counts = np.round((known - known[0]) / step)
        step = float((known[-1] - known[0]) / counts[-1])
    off = np.abs((known - known[0]) / step - np.round((known - known[0]) / step))
    return step if float(np.quantile(off, 0.98)) < 0.05 and counts[-1] < 1e6 else 0.0


def _known(*columns: Array) -> tuple[Array, ...]:
    """Samples of columns that all have, angles without the jumps of an encoder by a turn; none where they are few."""
    columns = tuple(values[:MOST_SAMPLES] for values in columns)
    good = np.logical_and.reduce([np.isfinite(values) for values in columns])
    return tuple(_unwound(values[good]) for values in columns) if good.sum() >= MIN_CHANGES else ()


def _unwound(values: Array) -> Array:
    for turn in (360.0, 2.0 * math.pi):
        steps = np.abs(np.diff(values))
        jumps = (steps > 0.75 * turn).sum()
        if 0.9 * turn < span(values) < 1.01 * turn and 0 < jumps < JUMP_SHARE * np.count_nonzero(steps):
            return np.unwrap(values, period=turn)
    return values


def slope(first: Array, second: Array) -> Relation:
    """How one column goes with another as they stand."""
    a, b = first - first.mean(), second - second.mean()
    power = math.sqrt(float(a @ a) * float(b @ b))
    if not 0.0 < power < math.inf:
        return Relation()
    along = float(a @ b) / power
    return Relation(math.copysign(math.sqrt(float(b @ b) / float(a @ a)), along), along * along)


def as_derivative(time: Array, position: Array, column: Array) -> Relation:
    """A column against the derivative of a position: by way over :data:`MOTION_WINDOW`, so that noise counts little."""
    if not (known := _known(time, position, column)):
        return Relation()
    time, position, column = known
    way = np.concatenate([[0.0], np.cumsum(0.5 * (column[1:] + column[:-1]) * np.diff(time))])
    late = np.searchsorted(time, time + MOTION_WINDOW)
    ends = late < len(time)
    return slope(position[late[ends]] - position[ends], way[late[ends]] - way[ends]) if ends.any() else Relation()


def following(time: Array, first: Array, second: Array) -> Relation:
    """How much later than ``first`` ``second`` moves, by the best correlation of their ways over short times."""
    known = _known(time, first, second)
    period = float(np.median(np.diff(known[0]))) if known else 0.0
    reach = max(round(MOTION_WINDOW / period), 1) if period > 0.0 else 0
    even = np.arange(known[0][0], known[0][-1], period)[:MOST_SAMPLES] if reach else np.zeros(0)
    if len(even) < 2 * max(reach, 1):
        return Relation()
    a, b = (np.interp(even, known[0], values) for values in known[1:])
    a, b = a[reach:] - a[:-reach], b[reach:] - b[:-reach]
    most = min(round(LONGEST_LAG / period), len(a) // 4)
    best = {True: Relation(), False: Relation()}  # along, and against
    for shift in range(-most, most + 1):
        early, late = (a[: len(a) - shift], b[shift:]) if shift >= 0 else (a[-shift:], b[: len(b) + shift])
        found = slope(early, late)
        if found.scale != 0.0 and found.fit > best[found.scale > 0.0].fit:
            best[found.scale > 0.0] = Relation(found.scale, found.fit, shift * period)
    return best[best[True].fit + AGAINST_MARGIN >= best[False].fit]


def move_apart(time: Array, goal: Array, position: Array, share: float) -> bool:
    """Whether a goal moves, and a position by more than its noise, and not slowly after it: the goal explains less of
    it."""
    known = _known(time, goal, position)
    reach = max(round(MOTION_WINDOW / max(float(np.median(np.diff(known[0]))), 1e-9)), 1) if known else 0
    if not known or np.ptp(known[1]) == 0.0 or len(known[0]) < 2 * reach:
        return False
    noise = float(np.sqrt(np.mean(np.diff(known[2], 2) ** 2) / 6.0))
    moved = float(np.sqrt(np.mean((known[2][reach:] - known[2][:-reach]) ** 2)))
    slow = slope(known[1], known[2])
    return moved > NOISE_FACTOR * noise and (slow.scale <= 0.0 or slow.fit < share)
