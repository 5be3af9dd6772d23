"""Samples that a recording lacks: what was commanded meanwhile is not known."""

from __future__ import annotations

import numpy as np

from .parts import WARM_UP
from .types import Array

PERIODS = 3.5  # between two samples, from which some lack
BEFORE = 0.04  # [s] over which speeds and accelerations are read off positions: they reach across a gap


def gaps(time: Array) -> np.ndarray:
    """Last samples before the gaps of a clock (n,) [s]."""
    steps = np.diff(time)
    return np.flatnonzero(steps > PERIODS * np.median(steps))


def known_commands(time: Array, command: Array) -> np.ndarray:
    """Samples (n,) whose motion follows from commands that were logged.

    A replay holds the last command across a gap. Where the next one differs, what came between is unknown, and its
    motion is forgotten after :data:`sealegs.gap.log.parts.WARM_UP`; where gaps follow each other faster, half of what
    lies between them still counts.

    Args:
        time: of the samples (n,) [s].
        command: goal [rad] or torque [N.m] (n,).
    """
    known = np.ones(len(time), bool)
    lost = gaps(time)
    lost = lost[command[lost] != command[lost + 1]]
    for k, end in zip(lost, [*time[lost[1:]], time[-1]], strict=False):
        first = time[k + 1]
        known[(time >= time[k] - BEFORE) & (time < first + min(WARM_UP, 0.5 * (end - first)))] = False
    return known
