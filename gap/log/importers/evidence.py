"""What the numbers of foreign columns say: clocks, encoders, derivatives, what follows what."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..types import Array

SLOWEST, FASTEST = 0.5, 2e-5  # [s] sample periods of logs that show the motion of a servo
CLOCKS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "d": 86400.0}
"""Units of clocks [s]; days are those of spreadsheets, since 1900."""
SPREADSHEET = (2e4, 8e4)  # [d] of 1954 to 2119
TURN = {"rad": 2.0 * math.pi, "deg": 360.0, "turn": 1.0}
"""One turn in each unit of an angle."""
STEP_TOLERANCE = 5e-5
WINDOW = 0.1  # [s] over which motion is compared with the integral of its derivative
LONGEST_LAG = 0.6  # [s]
OPPOSITE = 0.1
"""Share of a motion by which it must go better against another one than along with it: of a swing both fit alike, half
a period apart."""
RARE = 0.1
"""Share of the changes of an angle up to which jumps by a turn are an encoder's; more are commanded steps."""
BEYOND_NOISE = 3.0
"""Times its noise that a column moves over :data:`WINDOW`; noise alone makes 1.4."""
ADDED = 0.05
"""Share of a column that speed and acceleration must explain beyond the angle, of which a pose is a function, too."""
MOST = 40_000  # samples that are looked at


def clock_units(time: Array) -> list[str]:
    """Units in which a column's steps are sample periods of a servo's log; empty where it is no clock."""
    steps = np.diff(time[np.isfinite(time)])
    if len(steps) < 2 or (steps < 0).any() or np.median(steps) <= 0.0:
        return []
    step = float(np.median(steps))
    in_days = SPREADSHEET[0] < time[np.isfinite(time)][0] < SPREADSHEET[1]
    return [unit for unit, second in CLOCKS.items() if FASTEST <= step * second <= SLOWEST and (unit != "d" or in_days)]


def grid(values: Array) -> float:
    """Step on which all values lie, 0 where they lie on none."""
    known = np.unique(values[np.isfinite(values)][:MOST])
    if not len(known) >= 5:
        return 0.0
    gaps = np.diff(known)
    size = float(np.abs(known).max())
    gaps = gaps[gaps > 1e-6 * max(size, 1e-9)]  # single precision makes two of one
    if not len(gaps):
        return 0.0
    step = float(np.median(gaps[gaps < 1.5 * gaps.min()]))
    for _ in range(3):  # the mean step over the whole range is exact to many digits
        counts = np.round((known - known[0]) / step)
        step = float((known[-1] - known[0]) / counts[-1])
    off = np.abs((known - known[0]) / step - np.round((known - known[0]) / step))
    return step if float(np.quantile(off, 0.98)) < 0.05 and counts[-1] < 1e6 else 0.0


def encoder(values: Array) -> tuple[str, int] | None:
    """Unit and counts of a turn, where the values lie on the grid of an encoder: a turn in 2^n or 2^n - 1 steps."""
    step = grid(values)
    if step <= 0.0 or abs(step - round(step, 3)) < 1e-9 * step:
        return None
    for unit, turn in TURN.items():
        for bits in range(8, 19):
            for counts in (2**bits, 2**bits - 1)[: 2 if bits < 15 else 1]:
                if abs(step * counts / turn - 1.0) < STEP_TOLERANCE:
                    return unit, counts
    return None


def whole_numbers(values: Array) -> bool:
    """Whether all values are whole."""
    known = values[np.isfinite(values)]
    return bool(len(known)) and bool((known == np.round(known)).all())


def unwound(values: Array) -> Array:
    """An angle in degrees or rad without the jumps by a turn of an encoder that knows one; others as they are."""
    known = np.isfinite(values)
    cells = values[known]
    reach = float(np.ptp(cells)) if len(cells) else 0.0
    steps = np.abs(np.diff(cells))
    for turn in (360.0, 2.0 * math.pi):
        jumps = steps > 0.75 * turn
        if not 0.9 * turn < reach < 1.01 * turn or not 0 < jumps.sum() < RARE * np.count_nonzero(steps):
            continue
        out = values.copy()
        out[known] = np.unwrap(cells, period=turn)
        return out if np.abs(np.diff(out[known])).max() < 0.25 * turn else values
    return values


@dataclass(frozen=True)
class Relation:
    """How one signal goes with another.

    Attributes:
        scale: of the second per the first.
        fit: share of the second that the first explains, 0 to 1.
        lag: of the second behind the first [s].
    """

    scale: float
    fit: float
    lag: float = 0.0


def as_derivative(time: Array, position: Array, column: Array) -> Relation:
    """A column against the derivative of a position: by way over :data:`WINDOW`, so that noise counts little."""
    time, position, column = time[:MOST], unwound(position[:MOST]), column[:MOST]
    good = np.isfinite(column) & np.isfinite(position) & np.isfinite(time)
    if good.sum() < 50:
        return Relation(0.0, 0.0)
    time, position, column = time[good], position[good], column[good]
    way = np.concatenate([[0.0], np.cumsum(0.5 * (column[1:] + column[:-1]) * np.diff(time))])
    late = np.searchsorted(time, time + WINDOW)
    ends = late < len(time)
    moved = position[late[ends]] - position[ends]
    travelled = way[late[ends]] - way[ends]
    return _slope(moved, travelled)


def _slope(first: Array, second: Array) -> Relation:
    a, b = first - first.mean(), second - second.mean()
    power = math.sqrt(float(a @ a) * float(b @ b))
    if power <= 0.0:
        return Relation(0.0, 0.0)
    along = float(a @ b) / power
    return Relation(math.copysign(math.sqrt(float(b @ b) / float(a @ a)), along), along * along)


def following(time: Array, first: Array, second: Array) -> Relation:
    """How much later than ``first`` ``second`` moves, by the best correlation of their ways over short times."""
    time, first, second = time[:MOST], unwound(first[:MOST]), unwound(second[:MOST])
    good = np.isfinite(first) & np.isfinite(second) & np.isfinite(time)
    if good.sum() < 50:
        return Relation(0.0, 0.0)
    period = float(np.median(np.diff(time[good])))
    even = np.arange(time[good][0], time[good][-1], period)[:MOST]
    a, b = (np.interp(even, time[good], values[good]) for values in (first, second))
    reach = max(round(WINDOW / period), 1)
    if len(a) < 2 * reach:
        return Relation(0.0, 0.0)
    a, b = a[reach:] - a[:-reach], b[reach:] - b[:-reach]
    most = min(round(LONGEST_LAG / period), len(a) // 4)
    along = against = Relation(0.0, 0.0)
    for shift in range(-most, most + 1):
        early, late = (a[: len(a) - shift], b[shift:]) if shift >= 0 else (a[-shift:], b[: len(b) + shift])
        found = _slope(early, late)
        if found.scale > 0.0 and found.fit > along.fit:
            along = Relation(found.scale, found.fit, shift * period)
        elif found.scale < 0.0 and found.fit > against.fit:
            against = Relation(found.scale, found.fit, shift * period)
    return against if against.fit > along.fit + OPPOSITE else along


def moves(time: Array, values: Array) -> bool:
    """Whether a column moves over :data:`WINDOW` by more than its noise, which shows from sample to sample."""
    good = np.isfinite(time) & np.isfinite(values)
    time, values = time[good][:MOST], unwound(values[good][:MOST])
    if len(values) < 50:
        return False
    reach = max(round(WINDOW / float(np.median(np.diff(time)))), 1)
    if len(values) < 2 * reach:
        return False
    noise = float(np.sqrt(np.mean(np.diff(values, 2) ** 2) / 6.0))
    return float(np.sqrt(np.mean((values[reach:] - values[:-reach]) ** 2))) > BEYOND_NOISE * noise


def both_move_apart(time: Array, goal: Array, position: Array, share: float) -> bool:
    """Whether a goal that a position does not follow in time moves, and the position too, and not slowly after it.

    Args:
        time, goal, position: (n,) each.
        share: of the position that the goal explains as it stands, from which a slow joint follows it.
    """
    good = np.isfinite(goal) & np.isfinite(position)
    if good.sum() < 2 or np.ptp(goal[good]) == 0.0 or not moves(time, position):
        return False
    slow = _slope(goal[good][:MOST], position[good][:MOST])
    return slow.scale <= 0.0 or slow.fit < share


def no_signal(values: Array) -> str:
    """Why a column is no signal at all; empty where it may be one."""
    if np.nanmin(values) == np.nanmax(values):
        return "it never changes"
    return "it counts the samples" if (np.diff(values) == 1.0).all() else ""


def same_motion(first: Array, second: Array) -> bool:
    """Whether two columns are one motion, by their numbers."""
    good = np.isfinite(first) & np.isfinite(second)
    return bool(good.sum() > 50) and float(np.corrcoef(first[good], second[good])[0, 1]) > 0.999


def multiple(first: Array, second: Array) -> float | None:
    """Constant by which ``second`` is ``first``, None where it is not."""
    good = np.isfinite(first) & np.isfinite(second)
    a, b = first[good][:MOST], second[good][:MOST]
    if len(a) < 10 or not (a @ a) > 0.0:
        return None
    ratio = float(a @ b) / float(a @ a)
    return ratio if ratio and np.abs(b - ratio * a).max() <= 1e-3 * np.abs(b).max() else None


def drives(time: Array, position: Array, column: Array) -> float:
    """Share of a column that a motion explains: acceleration, speed, its direction, angle, a constant.

    It is 0 where the angle alone explains as much, as of another angle or a pose.
    """
    time, position, column = (a[:MOST] for a in (time, position, column))
    good = np.isfinite(time) & np.isfinite(position) & np.isfinite(column)
    if good.sum() < 50:
        return 0.0
    time, position, column = time[good], position[good], column[good]
    reach = max(round(0.03 / float(np.median(np.diff(time)))), 2)
    kernel = np.ones(2 * reach + 1) / (2 * reach + 1)
    smooth = np.convolve(np.convolve(position, kernel, "same"), kernel, "same")
    speed = np.gradient(smooth, time)
    acceleration = np.gradient(speed, time)
    ends = slice(4 * reach, -4 * reach)
    still = 0.02 * float(np.abs(speed).max() or 1.0)
    angle = [smooth, np.sin(smooth), np.cos(smooth), np.ones_like(speed)]
    terms = np.stack([*angle, acceleration, speed, np.tanh(speed / still)], axis=1)[ends]
    wanted = np.convolve(column, kernel, "same")[ends]
    if len(wanted) < 50 or not np.isfinite(wanted).all() or np.ptp(wanted) == 0.0:
        return 0.0
    share, of_angle = (_explained(part, wanted) for part in (terms, terms[:, : len(angle)]))
    return share if share > of_angle + ADDED else 0.0


def _explained(terms: Array, wanted: Array) -> float:
    left = wanted - terms @ np.linalg.lstsq(terms, wanted, rcond=None)[0]
    return max(1.0 - float(left.var() / wanted.var()), 0.0)
