"""Check of the goals: a column that holds the reading itself was never a command."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..log.finding import Finding
from ..log.types import READING_SHARE, Array
from .context import JointContext
from .signal import quantisation_step

MIN_MOVING_SAMPLES = 100
"""Samples in motion from which that is told."""
ROUNDING_SHARE = 1e-6
"""Of the range of motion: difference that writing a number down makes."""
ROUNDING_STEPS = 0.51
"""Of the quantisation steps of both columns: difference that rounding one of two equal columns makes."""
STEADY_LAG = 2e-3  # [s] within which no servo holds its lag at all speeds; assumed: 0.4 of the delay of sts3215
FAST_SPEED_QUANTILE = 0.75  # quantile of the speeds in motion above which the fast ones are


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
        name, of_what = joint.column("goal"), joint.column("position")
        next_row = " of the next row" if ahead else ""
        yield Finding(
            "goal.is_position", "error", joint.name, name,
            f"{name} equals {of_what}{next_row} in {share:.0%} of the samples in motion, which no servo does: it is "
            "the reading and not the command, or the position repeats the goal; log the goal as it was sent.",
            value=share, data_error=True,
        )  # fmt: skip
        return


def _equal(joint: JointContext, goal: Array, position: Array, ahead: int) -> float:
    """Share of the samples in motion, drive on, in which the goal is the reading so many rows later."""
    last = len(goal) - ahead
    counts = (joint.moving & joint.on)[:last]
    if counts.sum() < MIN_MOVING_SAMPLES:
        return 0.0
    apart = np.abs(goal[:last] - position[ahead:])[counts]
    exact = float((apart <= ROUNDING_SHARE * joint.span).mean())
    within = ROUNDING_STEPS * (joint.step + quantisation_step(goal))
    fast = float(np.quantile(np.abs(joint.velocity[:last][counts]), FAST_SPEED_QUANTILE))
    if exact >= READING_SHARE or fast * STEADY_LAG < within:  # slower motion hides a lag within the rounding
        return exact
    return float((apart <= within).mean())
