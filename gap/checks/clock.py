"""Checks of the time stamps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..log.finding import Finding
from ..log.gaps import GAP_PERIODS, gaps
from ..log.parts import WARM_UP
from ..log.types import MeasuredRun

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
