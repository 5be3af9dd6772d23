"""Logs of the hidden bench with other columns than were recorded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from sealegs.gap.log.types import MeasuredRun

JOINT = "servo"
"""Joint of the hidden bench."""


def with_log(run: MeasuredRun, **signals: np.ndarray | None) -> MeasuredRun:
    """The run with other columns of its joint, each (n,); None: without it."""
    return replace(run, joints={JOINT: replace(run.joints[JOINT], **signals)})


def signal(run: MeasuredRun, name: str) -> np.ndarray:
    """A column of the run's joint (n,)."""
    return run.joints[JOINT].signals()[name]
