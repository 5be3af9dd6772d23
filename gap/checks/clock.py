"""Checks of the time stamps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..log.finding import Finding
from ..log.parts import GAP_PERIODS, WARM_UP, gaps
from ..log.types import Array, MeasuredRun
from .context import JointContext
from .signal import OTHER_ERROR_RATIO, derivatives

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
