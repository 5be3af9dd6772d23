"""Checks of columns that must agree with the motion: velocity, current, voltage, and columns that are stuck."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ..log.finding import Finding
from ..log.parts import GAP_PERIODS, WARM_UP, gaps
from ..log.types import Array, MeasuredRun
from .context import JointContext
from .drive import EFFORTS, predicted
from .motion import velocity_unit
from .signal import (
    AT_LIMIT,
    FOLLOWS_SHARE,
    MIN_SAMPLES,
    NORMAL_OVER_MEDIAN,
    OTHER_ERROR_RATIO,
    Lag,
    derivatives,
    fit_lag,
    quantisation_step,
    same_unit,
)

IRREGULAR_PERIOD_SPREAD = 0.15
"""Spread of the sample period, relative to its median, from which a clock is called irregular."""
STAMP_ERROR_SHARE = 0.03
"""Step or jitter of time stamps, relative to the period, from which they disturb derivatives."""


def check_clock(run: MeasuredRun) -> Iterator[Finding]:
    """Yield what is wrong with the sampling of a run."""
    steps = np.diff(run.time)
    period = float(np.median(steps))
    regular = steps[steps <= GAP_PERIODS * period]
    spread = float(np.std(regular) / period)
    if spread > IRREGULAR_PERIOD_SPREAD:
        yield Finding(
            "clock.irregular", "note", None, "time",
            f"Sampling is irregular: {1 / steps.max():.4g} to {1 / steps.min():.4g} Hz around {1 / period:.4g} Hz; "
            "replays use the recorded time stamps.",
            value=spread,
        )  # fmt: skip
    missing = gaps(run.time)
    if len(missing):
        worst = int(missing[np.argmax(steps[missing])])
        logs = run.joints.values()
        told = []
        if any(log.goal is not None for log in logs):
            told.append(
                f"where goals changed meanwhile, motion counts again {WARM_UP:g} s later, or half way to the next gap"
            )
        if any(log.torque_command is not None for log in logs):
            told.append("where torques changed meanwhile, a joint that follows them begins anew behind each")
        yield Finding(
            "clock.gaps", "warning", None, "time",
            f"{len(missing)} gap{'s' * (len(missing) > 1)} in the samples, the longest {steps[worst]:.3g} s after "
            f"{run.time[worst]:.4g} s (period {period:.3g} s){''.join(f'; {each}' for each in told)}.",
            value=float(steps[worst]), data_error=True,
        )  # fmt: skip
    tick = time_stamp_step(run.time[: 1 << 16])
    if tick > STAMP_ERROR_SHARE * period and spread > 1e-3:
        yield Finding(
            "clock.quantised", "warning", None, "time",
            f"Time stamps are rounded to {tick * 1e3:.3g} ms at a period of {period * 1e3:.3g} ms; log them finer.",
            value=tick, data_error=True,
        )  # fmt: skip


def time_stamp_step(time: np.ndarray) -> float:
    """Return the step that time stamps are rounded to [s], 0 where none of 10 us or more shows."""
    since = time - time[0]
    for step in (1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5, 1e-5):
        if np.allclose(since / step, np.round(since / step), rtol=0.0, atol=1e-3):
            return step
    return 0.0


def check_stamps(joint: JointContext) -> Iterator[Finding]:
    """Yield whether the time stamps of a run jitter more than its readings, judged by a joint that moves."""
    if joint.still or len(joint.time) < 400:
        return
    grid = regular(joint.time)
    if grid is None:
        return
    late = joint.time - grid
    jitter = float(np.std(late))
    if jitter < STAMP_ERROR_SHARE * joint.period:
        return
    fast = np.abs(joint.velocity) > np.quantile(np.abs(joint.velocity), 0.8)
    if fast.sum() < 200:
        return
    stamped, even = (_roughness(time, joint.log.position, fast) for time in (joint.time, grid))
    if even**2 < OTHER_ERROR_RATIO * stamped**2:
        yield Finding(
            "clock.late_stamps", "warning", None, "time",
            f"Time stamps jitter by {1e3 * jitter:.2g} ms (up to {1e3 * np.ptp(late):.2g} ms late), the readings do "
            f"not: on a regular clock the position is {stamped / even:.2g} times smoother in motion; stamp a row when "
            "it is read.",
            value=jitter, data_error=True,
        )  # fmt: skip


def regular(time: Array) -> Array | None:
    """The regular clock (n,) whose ticks the stamps follow, the earliest of them on time; None where rows are lost."""
    at = np.arange(len(time))
    slope, start = np.polyfit(at, time, 1)
    grid = start + slope * at
    if np.ptp(time - grid) > 1.5 * slope:
        return None
    return grid + float(np.quantile(time - grid, 0.02))


def _roughness(time: Array, position: Array, keep: np.ndarray) -> float:
    """Rms of what a local cubic cannot follow at some samples [rad]."""
    smooth = derivatives(time, position, 9 * float(np.median(np.diff(time))))[0]
    return float(np.sqrt(np.mean((position - smooth)[keep] ** 2)))


SCALE_TOLERANCE = 0.03
LAG_TOLERANCE = 0.003
"""Smallest delay of a column that is worth a word [s]."""
STUCK_SECONDS = 0.5


def check_columns(joint: JointContext) -> Iterator[Finding]:
    """Yield what is wrong with the columns beside goal and position."""
    yield from _stuck(joint)
    if joint.log.velocity is not None and joint.natural:
        yield from _velocity(joint, joint.log.velocity)
    if joint.log.goal_velocity is not None and joint.log.goal is not None and joint.natural:
        yield from _goal_velocity(joint, joint.log.goal, joint.log.goal_velocity)
    if joint.log.voltage is not None and joint.log.duty is not None:
        yield from _voltage(joint, joint.log.voltage, joint.log.duty)


def _stuck(joint: JointContext) -> Iterator[Finding]:
    position = joint.motion[0]
    for signal in ("velocity", "link_position", "duty", "current", "torque"):
        values = getattr(joint.log, signal)
        if values is None:
            continue
        if not np.isfinite(values).any():
            yield joint.fault("column.empty", "warning", signal, None, "holds no value; leave the column out.")
            continue
        if signal in EFFORTS and joint.chain is not None and signal not in predicted(joint.chain) and not values.any():
            continue  # a servo without a motor has neither current nor duty to report
        starts = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
        ends = np.concatenate([starts[1:], [len(values)]]) - 1
        length = joint.time[ends] - joint.time[starts]
        # from end to end: along its way, the noise of a joint at rest adds up
        moved = np.maximum.reduceat(position, starts) - np.minimum.reduceat(position, starts)
        stuck = (length > STUCK_SECONDS) & (moved > 0.1 * joint.span + 20 * joint.noise) & joint.on[starts]
        if signal in EFFORTS:  # of which a dead band gives none, and a step as much as the drive can
            size = np.abs(values[starts])
            works = (size > 0.0) & (size < AT_LIMIT * np.nanmax(size))
            stuck &= works | (length > 0.5 * (joint.time[-1] - joint.time[0]))
        stuck[stuck] = _should_change(joint, values, list(zip(starts[stuck], ends[stuck] + 1, strict=True)))
        if stuck.any():
            worst = int(np.argmax(np.where(stuck, length, 0.0)))
            yield joint.fault(
                "column.stuck", "warning", signal, float(length[worst]),
                f"stays at {values[starts[worst]]:.4g} for {length[worst]:.3g} s from {joint.time[starts[worst]]:.4g} "
                "s while the joint moves: the reading was not updated.",
            )  # fmt: skip


def _should_change(joint: JointContext, values: Array, stretches: Sequence[tuple[int, int]]) -> list[bool]:
    """Whether a column should have left its value in each stretch, by what it does elsewhere.

    At constant speed a current is constant, one of coarse steps shows no change for long, and dry friction holds a
    torque. Of what it should do, the middle eight tenths count: the rest is noise, or smoothed where the stretch ends.
    """
    if not stretches:
        return []
    position, speed, acceleration = joint.motion
    away = np.zeros(len(speed)) if joint.log.goal is None else joint.log.goal - joint.log.position
    direction = np.tanh(speed / joint.moving_speed)
    terms = np.stack((away, speed, direction, acceleration, position, np.sin(position), np.ones(len(speed))), axis=1)
    terms = np.nan_to_num(terms / np.maximum(np.nanmax(np.abs(terms), axis=0), 1e-12))
    known = np.isfinite(values) & np.isfinite(away)
    others = known.copy()
    for a, b in stretches:
        others[a:b] = False
    found = []
    for a, b in stretches:
        beside = known & ((np.arange(len(known)) < a) | (np.arange(len(known)) >= b))
        good = others if others.sum() >= MIN_SAMPLES else beside
        if good.sum() < MIN_SAMPLES:
            found.append(True)
            continue
        said = terms @ np.linalg.lstsq(terms[good], values[good], rcond=None)[0]
        scatter = NORMAL_OVER_MEDIAN * float(np.median(np.abs(values[good] - said[good])))
        change = float(np.ptp(np.quantile(np.clip(said[a:b], np.nanmin(values), np.nanmax(values)), (0.1, 0.9))))
        found.append(change > 4.0 * max(quantisation_step(values), scatter))
    return found


def _velocity(joint: JointContext, velocity: Array) -> Iterator[Finding]:
    known = np.isfinite(velocity)
    if (
        known.mean() < 0.5
        or joint.moving.sum() < MIN_SAMPLES
        or joint.span < 20 * joint.noise
        or np.ptp(velocity[known]) == 0
    ):
        return
    filled = velocity if known.all() else np.interp(joint.time, joint.time[known], velocity[known])
    lag = _beside_derivative(joint, filled, joint.log.position)
    if lag is None:
        return
    # Noise in the position shrinks the slope by 1 - r2 of its own share: the middle of both regressions.
    scale = float(lag.coefficients[0]) / np.sqrt(lag.r2)
    margin = 2.0 * float(lag.spread[0]) + 0.5 * (1.0 / np.sqrt(lag.r2) - 1.0)
    as_logged = float(lag.coefficients_now[0]) / np.sqrt(lag.r2)
    late = abs(lag.seconds) > LAG_TOLERANCE and lag.low * lag.high > 0 and (1 - lag.r2_now) > 1.3 * (1 - lag.r2)
    if (unit := velocity_unit(scale)) not in (None, "rad/s"):
        yield _in_unit(joint, "velocity", "position", unit, scale)
        return
    if same_unit(-scale):
        yield joint.fault(
            "velocity.sign", "error", "velocity", scale,
            f"has the wrong sign: it is {scale:.3g} times the derivative of the position.",
        )  # fmt: skip
        return
    if not same_unit(scale):
        yield joint.fault(
            "velocity.gear_side", "error", "velocity", scale,
            f"is {scale:.4g} times the derivative of the position: it belongs to the other side of a gear or to "
            "another unit.",
            low=scale * (1.0 - margin), high=scale * (1.0 + margin), cause="sensor.scale",
        )  # fmt: skip
        return
    if abs(scale - 1.0) > SCALE_TOLERANCE + margin or (late and abs(as_logged - 1.0) > SCALE_TOLERANCE):
        aligned = f"; {scale:.3f} once its delay of {lag.seconds * 1e3:.0f} ms is taken out" if late else ""
        value = as_logged if late else scale
        yield joint.fault(
            "velocity.scale", "warning", "velocity", value,
            f"is {value:.3f} times the derivative of the position{aligned}; use the position instead.",
            low=value - margin, high=value + margin, cause="sensor.scale",
        )  # fmt: skip
    if late:
        side = "late" if lag.seconds > 0 else "early"
        yield joint.fault(
            "velocity.lag", "warning", "velocity", lag.seconds,
            f"is {abs(lag.seconds) * 1e3:.1f} ms {side} of the position's derivative ({abs(lag.low) * 1e3:.1f} to "
            f"{abs(lag.high) * 1e3:.1f} ms); use the position instead.",
            low=lag.low, high=lag.high, cause="sensor.delay",
        )  # fmt: skip


def _goal_velocity(joint: JointContext, goal: Array, velocity: Array) -> Iterator[Finding]:
    """A commanded velocity that is the goal's derivative in another unit.

    What is commanded need not be that derivative: another ratio may be what the drive was told, so it stays.
    """
    good = np.isfinite(goal) & np.isfinite(velocity)
    if not good.all() or np.ptp(goal) == 0.0 or np.ptp(velocity) == 0.0:
        return
    lag = _beside_derivative(joint, velocity, goal)
    if lag is None:
        return
    scale = float(lag.coefficients[0]) / np.sqrt(lag.r2)
    if scale > 0.0 and (unit := velocity_unit(scale)) not in (None, "rad/s"):
        yield _in_unit(joint, "goal_velocity", "goal", unit, scale)
    elif not same_unit(scale):
        yield joint.remark(
            "goal_velocity.scale", "warning", "goal_velocity", scale,
            f"{joint.column('goal_velocity')} is {scale:.4g} times the derivative of the goal; it stays, as what the "
            "drive was told. If it is in another unit, or of the other side of a gear, correct it.",
        )  # fmt: skip


def _in_unit(joint: JointContext, signal: str, of: str, unit: str | None, scale: float) -> Finding:
    return joint.fault(
        "unit.velocity", "error", signal, scale,
        f"is in {unit}, not in rad/s: it is {scale:.4g} times the derivative of the {of}.",
        cause="sensor.scale" if signal == "velocity" else None,
    )  # fmt: skip


def _beside_derivative(joint: JointContext, velocity: Array, angle: Array) -> Lag | None:
    """How a velocity goes with the derivative of an angle; None where it is not that derivative."""
    travelled = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(joint.time))])
    # The same filter on both sides: the derivative of the integrated column against that of the angle.
    window = max(0.1, 9 * joint.period)
    column, derivative = (derivatives(joint.time, values, window)[1] for values in (travelled, angle))
    lag = fit_lag(joint.time, column, [derivative])
    return None if lag is None or lag.r2 < FOLLOWS_SHARE else lag


def check_unsigned(joints: Sequence[JointContext], run: str | None) -> Iterator[Finding]:
    """Yield the columns of one joint that are magnitudes without a sign in all of its runs.

    In one run, a load may hold a current on one side.
    """
    joints = [joint for joint in joints if not joint.still]
    for signal in ("current", "torque"):
        those = [joint for joint in joints if getattr(joint.log, signal) is not None]
        values = np.concatenate([np.zeros(0), *(getattr(joint.log, signal) for joint in those)])
        known = values[np.isfinite(values)]
        if len(known) < MIN_SAMPLES or np.ptp(known) == 0.0 or known.min() < 0.0:
            continue
        moving = np.concatenate([joint.moving for joint in those])
        pushes, speeds = (np.concatenate(part) for part in ([*map(_push, those)], [joint.velocity for joint in those]))
        if _goes_both_ways(pushes[moving]) and _goes_both_ways(speeds[moving]):
            joint = those[0]
            yield joint.fault(
                f"{signal}.unsigned", "warning", signal, float(known.min()),
                "is never negative although the drive pushes both ways: it is a magnitude without its sign.",
                run=run,
            )  # fmt: skip


def _push(joint: JointContext) -> Array:
    """Which way the drive pushes (n,), whatever its size."""
    if joint.log.duty is not None:
        return joint.log.duty
    if joint.log.torque_command is not None:
        return joint.log.torque_command  # which may hold a load on one side throughout
    return joint.velocity if joint.log.goal is None else joint.log.goal - joint.log.position


def _goes_both_ways(values: Array) -> bool:
    return len(values) > 0 and min((values > 0).mean(), (values < 0).mean()) > 0.1


def _voltage(joint: JointContext, voltage: Array, duty: Array) -> Iterator[Finding]:
    known = np.isfinite(voltage) & np.isfinite(duty)
    if known.sum() < MIN_SAMPLES:
        return
    volts, size = voltage[known], np.abs(duty[known])
    quiet = size <= max(0.05, float(np.quantile(size, 0.1)))
    rest = float(np.median(volts[quiet]))
    busy = size > 0.1
    if busy.sum() < 50:
        return
    margin = max(3.0 * float(np.std(volts[quiet])) * 0.5, 0.03 * rest)
    above = float((volts[busy] > rest + margin).mean())
    below = float((volts[busy] < rest - margin).mean())
    if above > 0.02 and above + below > 0.05:
        yield joint.fault(
            "voltage.aliased", "warning", "voltage", float(np.ptp(volts)),
            f"reads {volts.min():.3g} to {volts.max():.3g} V around {rest:.3g} V at rest, above it as well as below "
            "while the duty is on: it aliases the PWM ripple and shows no sag of the supply.",
        )  # fmt: skip
