"""Checks of how a host recorded: columns that hold values or lag by rows, goals that were interpolated or read.

Each looks like an effect of the machine, most like a delay, and is none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..log.finding import Finding
from ..log.types import MIN_CHANGES, READING_SHARE, Array
from .context import JointContext
from .signal import FOLLOWS_SHARE, LAG_REACH, MIN_SAMPLES, OTHER_ERROR_RATIO, quantisation_step

READ_COLUMNS = ("position", "velocity", "link_position", "duty", "current", "torque")
"""Columns that a host reads in every cycle; temperature and voltage are polled less often."""
MAX_ROWS = 25  # that a column may hold a value for, or between two goals that were joined by a line
REGULAR_STRETCH_SHARE = 0.95  # share of the stretches that must be whole multiples
MAX_DUTY_ROWS = 12_000  # of a run that the duty is followed over: more tell no more
READING_REACH = 0.02  # [s] by which a position may be late, or columns early
DRIVE_LOOP_PERIOD = 2.5e-4
"""[s] by which a reading may come before what is set in its row: a period of a drive's loop, assumed."""
DELAY_TOLERANCE = 0.06  # relative error of a delay that is believed: the tolerance that every fit has

ROUNDING_SHARE = 1e-6
"""Of the range of motion: difference that writing a number down makes."""
ROUNDING_STEPS = 0.51
"""Of the quantisation steps of both columns: difference that rounding one of two equal columns makes."""
STEADY_LAG = 2e-3  # [s] within which no servo holds its lag at all speeds; assumed: 0.4 of the delay of sts3215


def check_recording(joint: JointContext) -> Iterator[Finding]:
    """Yield how the host recorded a joint, where that is not what the format says."""
    yield from _held(joint)
    yield from _interpolated(joint)
    yield from _rows(joint)


# --- values that are held ------------------------------------------------------------------------------------------


def _held(joint: JointContext) -> Iterator[Finding]:
    for signal in READ_COLUMNS:
        values = getattr(joint.log, signal)
        if values is None or not np.isfinite(values).all() or (rows := held_rows(values, joint.moving)) < 2:
            continue
        yield joint.fault(
            "column.held", "warning", signal, float(rows),
            f"holds each value for {rows} rows: it was read at {1 / joint.period / rows:.4g} Hz and logged at "
            f"{1 / joint.period:.4g} Hz, so that it is up to {1e3 * (rows - 1) * joint.period:.3g} ms old; log it "
            "when it is read.",
        )  # fmt: skip


def held_rows(values: Array, moving: np.ndarray) -> int:
    """For how many rows a column (n,) holds each value while the joint is ``moving`` (n,): 1 where it does not."""
    change = np.flatnonzero(np.diff(values) != 0.0) + 1
    if len(change) < MIN_CHANGES:
        return 1
    lengths = np.diff(change)[moving[change[1:]]]
    return _common(lengths)


def _common(lengths: np.ndarray) -> int:
    """The largest number of rows that nearly all stretches are whole multiples of; 1 where there is none."""
    if len(lengths) < MIN_CHANGES:
        return 1
    for rows in range(MAX_ROWS, 1, -1):
        # the number itself must be there: stretches of 4 and 8 rows are no stretches of 2
        if (lengths % rows == 0).mean() > REGULAR_STRETCH_SHARE and (lengths == rows).mean() > 0.3:
            return rows
    return 1


def fresh(values: Array, rows: int) -> np.ndarray:
    """At which samples (n,) a column that holds its values for so many rows was read."""
    change = np.flatnonzero(np.diff(values) != 0.0) + 1
    first = int(np.bincount(change % rows, minlength=rows).argmax()) if len(change) else 0
    read = np.arange(len(values)) % rows == first
    read[change] = True  # where a row was lost
    read[0] = True
    return read


def unheld(values: Array, rows: int, *, angle: bool) -> Array:
    """The column without what it held: an angle between its readings, anything else without a value there."""
    read = fresh(values, rows)
    if not angle:
        return np.where(read, values, np.nan)
    at = np.arange(len(values))
    between = np.interp(at, at[read], values[read])
    step = quantisation_step(values)
    return np.where(read, values, step * np.round(between / step) if step > 0.0 else between)


# --- goals that were interpolated ----------------------------------------------------------------------------------


def _interpolated(joint: JointContext) -> Iterator[Finding]:
    goal = joint.log.goal
    if goal is None or not np.isfinite(goal).all() or (rows := knot_rows(joint.time, goal)) < 2:
        return
    apart = rows * joint.period
    what = f"is made of straight lines over {rows} rows ({1e3 * apart:.3g} ms)"
    shown = _follows_held(joint, goal, rows)
    if shown is None:
        yield joint.remark(
            "goal.knots", "note", "goal", 0.5 * apart,
            f"{joint.column('goal')} {what}: if goals were sent at {1 / apart:.4g} Hz and held, the log was "
            f"interpolated, which looks like a delay of {1e3 * apart / 2:.3g} ms; log the goals as sent, or the duty, "
            "which tells.",
        )  # fmt: skip
    elif shown:
        yield joint.fault(
            "goal.interpolated", "warning", "goal", float(rows),
            f"{what}, but the duty follows goals that were held that long: the log was interpolated, which would look "
            f"like a delay of {1e3 * apart / 2:.3g} ms; log the goals as sent.",
        )  # fmt: skip


def _rounding(goal: Array) -> float:
    """Bend of a goal that rounding makes."""
    return ROUNDING_SHARE * float(np.ptp(goal)) + 2.0 * ROUNDING_STEPS * quantisation_step(goal)


def knot_rows(time: Array, goal: Array) -> int:
    """Over how many rows a goal (n,) goes in straight lines; 1 where it bends anywhere."""
    slope = np.diff(goal) / np.diff(time)
    least = _rounding(goal)
    bends = np.flatnonzero(np.abs(np.diff(slope)) * np.median(np.diff(time)) > least) + 1
    return _common(np.diff(bends))


def held_again(goal: Array, rows: int) -> Array:
    """Goals (n,) that were sent every so many rows, and held."""
    bend = np.abs(np.diff(goal, 2))
    strong = np.flatnonzero(bend > _rounding(goal)) + 1
    first = int(np.bincount(strong % rows, minlength=rows).argmax()) if len(strong) else 0
    at = np.arange(len(goal))
    return goal[np.maximum(at - (at - first) % rows, 0)]


def _follows_held(joint: JointContext, goal: Array, rows: int) -> bool | None:
    """Whether the duty follows the goals held rather than as logged; None where nothing tells."""
    duty = driving(joint)
    if duty is None:
        return None
    logged, held = (following(joint, duty, values) for values in (goal, held_again(goal, rows)))
    if logged is None or held is None or max(logged.explained, held.explained) < FOLLOWS_SHARE:
        return None
    if held.error < OTHER_ERROR_RATIO * logged.error:
        return True
    return False if logged.error < OTHER_ERROR_RATIO * held.error else None


# --- rows of a log that are of different times ---------------------------------------------------------------------


@dataclass(frozen=True)
class Following:
    """How a duty follows goal and position.

    Attributes:
        goal_rows: by how many rows the goal acts late.
        rows: how many rows older than its own the position is that the duty answers to; below zero a newer one.
        error: what this leaves of the duty, mean square of all but the largest tenth.
        error_now: the same, at best with the position of the same row.
        explained: share of the variance that is explained.
    """

    goal_rows: int
    rows: int
    error: float
    error_now: float
    explained: float


def driving(joint: JointContext) -> Array | None:
    """The duty (n,), as logged or as current and speed give it; None where the firmware has more than a P loop."""
    chain = joint.chain
    if chain is None or chain.find("position_p") is None or joint.log.goal is None or not joint.natural:
        return None
    if joint.log.duty is not None:
        return joint.log.duty
    motor, supply = chain.find("dc_motor"), chain.find("supply")
    if joint.log.current is None or motor is None or supply is None or np.nanmin(joint.log.current) >= 0.0:
        return None
    back_emf = motor.back_emf * chain.gear_ratio() * joint.velocity
    return (joint.log.current * motor.resistance + back_emf) / supply.volts


def following(joint: JointContext, duty: Array, goal: Array) -> Following | None:
    """Regress the duty on goal and position of earlier and later rows; None where too few samples are between limits.

    A position loop answers to the position at the time, so the row that it answers to is of the same time.
    """
    reach, most = max(round(READING_REACH / joint.period), 1), max(round(LAG_REACH / joint.period), 2)
    reach, most = min(reach, 6), min(most, 16)
    count = len(duty)
    at = np.arange(most + reach, count - reach)
    good = np.isfinite(duty[at]) & (np.abs(duty[at]) < 0.95 * np.nanmax(np.abs(duty))) & joint.on[at] & joint.moving[at]
    at = at[good]
    if len(at) < 200:
        return None
    at = at[:: -(-len(at) // MAX_DUTY_ROWS)]
    wanted = duty[at]
    total = _trimmed((wanted - wanted.mean()) ** 2)
    best: tuple[float, int, int] = (np.inf, 0, 0)
    now = np.inf
    for late in range(most + 1):
        for rows in range(-reach, reach + 1):
            terms = np.stack([goal[at - late], joint.log.position[at - rows], np.ones(len(at))], axis=1)
            gram = terms.T @ terms
            found = np.linalg.lstsq(gram, terms.T @ wanted, rcond=None)[0]
            error = _trimmed((wanted - terms @ found) ** 2)
            best = min(best, (error, late, rows))
            now = min(now, error) if rows == 0 else now
    error, late, rows = best
    return Following(late, rows, error, now, 1.0 - error / max(total, 1e-300))


def _before_goal(joint: JointContext, seen: int) -> bool:
    """Whether the goal in force is one row older than the chain has it, and would be that a moment earlier."""
    delay = None if joint.chain is None else joint.chain.find("delay")
    believed = 0.0 if delay is None else delay.seconds
    return seen == _rows_late(joint.time, believed) + 1 and a_moment_tells(joint.time, believed)


def a_moment_tells(time: Array, delay: float) -> bool:
    """Whether a goal is in force one row later where a row is read a moment earlier, its delay being as believed [s].

    Where the tolerance of the delay does the same, that may be all there is.
    """
    now, tuned, before = (
        _rows_late(time, s) for s in (delay, (1.0 + DELAY_TOLERANCE) * delay, delay + DRIVE_LOOP_PERIOD)
    )
    return before == now + 1 and tuned == now


def _rows_late(time: Array, delay: float) -> int:
    """By how many rows a goal acts later than its own when it takes so long [s]."""
    at = np.arange(len(time))
    return int(np.median(at - np.searchsorted(time + delay, time + 1e-9, side="right") + 1))


def _trimmed(squares: np.ndarray) -> float:
    """Mean of all but the largest tenth: where a goal jumps, a row may have either."""
    kept = np.partition(squares, int(0.9 * len(squares)))[: int(0.9 * len(squares))]
    return float(kept.mean())


def before_goal_note(joint: str, signal: str, period: float) -> Finding:
    """That a column answers to the goal of the row before, with rows of a period [s]."""
    return Finding(
        "columns.before_goal", "note", joint, f"{joint}.{signal}",
        f"What {joint} reads of its drive is of the moment before the goal of the same row acts: up to a row "
        f"({1e3 * period:.3g} ms) of what looks like a delay is none.",
        value=1.0,
    )  # fmt: skip


def _rows(joint: JointContext) -> Iterator[Finding]:
    duty = driving(joint)
    if duty is None or joint.log.goal is None:
        return
    seen = following(joint, duty, joint.log.goal)
    if seen is None or seen.explained < FOLLOWS_SHARE:
        return
    if seen.rows == 0 and _before_goal(joint, seen.goal_rows):
        yield before_goal_note(joint.name, "current" if joint.log.duty is None else "duty", joint.period)
    if seen.rows == 0 or seen.error > OTHER_ERROR_RATIO * seen.error_now:
        return
    seconds = abs(seen.rows) * joint.period
    if seen.rows < 0:
        yield joint.remark(
            "position.late", "note", "position", seconds,
            f"The drive of {joint.name} answers to positions that the log has {1e3 * seconds:.3g} ms later "
            f"({-seen.rows} row{'s' * (seen.rows < -1)}): position readings reach the log late, not the commands the "
            "drive.",
            cause="sensor.delay",
        )  # fmt: skip
        return
    for signal in ("duty", "current"):
        if getattr(joint.log, signal) is None:
            continue
        yield joint.fault(
            "column.behind", "warning", signal, float(seen.rows),
            f"is {seen.rows} row{'s' * (seen.rows > 1)} behind ({1e3 * seconds:.3g} ms): the drive answers to the "
            "position of an earlier row; log what is read with the row that it is read in.",
            cause="sensor.delay",
        )  # fmt: skip


# --- goals that are readings ---------------------------------------------------------------------------------------


def check_goal(joint: JointContext) -> Iterator[Finding]:
    """Yield whether the goal of a joint is its reading, of the same row or of the next.

    A servo lags its goal by milliseconds at least, which at speed is more than a step of its encoder. So equal columns
    are one column that was logged twice.
    """
    goal, position = joint.log.goal, joint.log.position
    if goal is None or not np.isfinite(goal).all() or np.ptp(goal) == 0.0:
        return
    for ahead in (0, 1):
        share = _equal(joint, goal, position, ahead)
        if share < READING_SHARE:
            continue
        next_row = " of the next row" if ahead else ""
        yield joint.fault(
            "goal.is_position", "error", "goal", share,
            f"equals {joint.column('position')}{next_row} in {share:.0%} of the samples in motion, which no servo "
            "does: it is the reading and not the command, or the position repeats the goal; log the goal as it was "
            "sent.",
        )  # fmt: skip
        return


def _equal(joint: JointContext, goal: Array, position: Array, ahead: int) -> float:
    """Share of the samples in motion, drive on, in which the goal is the reading so many rows later."""
    last = len(goal) - ahead
    counts = (joint.moving & joint.on)[:last]
    if counts.sum() < MIN_SAMPLES:
        return 0.0
    apart = np.abs(goal[:last] - position[ahead:])[counts]
    exact = float((apart <= ROUNDING_SHARE * joint.span).mean())
    within = ROUNDING_STEPS * (joint.step + quantisation_step(goal))
    shows = np.abs(joint.velocity[:last][counts]) * STEADY_LAG > within  # slower motion hides a lag in the rounding
    return exact if exact >= READING_SHARE or shows.sum() < MIN_SAMPLES else float((apart <= within)[shows].mean())
