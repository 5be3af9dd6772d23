"""Samples that a recording lacks: what was commanded meanwhile is not known.

A goal pulls a joint back to where it would have been. A torque does not: what acted meanwhile stays in the speed for
good, so that a joint that follows torques begins anew behind a gap, where it was measured.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .parts import LEAST_START, SPEED_REACH, WARM_UP, Unit, within
from .types import Array, MeasuredRun

GAP_PERIODS = 3.5  # between two samples, from which some lack


def gaps(time: Array) -> np.ndarray:
    """Last samples before the gaps of a clock (n,) [s]."""
    steps = np.diff(time)
    return np.flatnonzero(steps > GAP_PERIODS * np.median(steps))


def lost(time: Array, command: Array) -> np.ndarray:
    """Last samples before gaps (n,) in which the command changed."""
    missing = gaps(time)
    return missing[command[missing] != command[missing + 1]]


def known_commands(time: Array, command: Array, forgotten: float = WARM_UP) -> np.ndarray:
    """Samples (n,) whose motion follows from commands that were logged.

    A replay holds the last command across a gap. Where the next one differs, what came between is unknown, and its
    motion is forgotten some time after; where gaps follow each other faster, half of what lies between them still
    counts.

    Args:
        time: of the samples (n,) [s].
        command: goal [rad] or torque [N.m] (n,).
        forgotten: time until then [s].
    """
    known = np.ones(len(time), bool)
    ends = lost(time, command)
    for k, end in zip(ends, [*time[ends[1:]], time[-1]], strict=False):
        first = time[k + 1]
        known[(time >= time[k] - SPEED_REACH) & (time < first + min(forgotten, 0.5 * (end - first)))] = False
    return known


def between_gaps(runs: Sequence[MeasuredRun], joint: str, units: Sequence[Unit]) -> list[Unit]:
    """Pieces of a joint that follows torques, cut where a recording lacks some; what is too short to judge is left out.

    They begin where no reading of the neighbours' accelerations reaches across the gap.

    Args:
        runs: of one machine.
        joint: that is judged.
        units: of :func:`sealegs.gap.log.parts.cut`.
    """
    found: list[Unit] = []
    for unit in units:
        time, log = runs[unit.run].time, runs[unit.run].joints[joint]
        command = log.torque_command
        ends = np.zeros(0, int) if command is None else lost(time, command)
        ends = ends[(ends >= unit.start) & (ends < unit.stop - 1)]
        if not len(ends):
            found.append(unit)
            continue
        begins = np.searchsorted(time, time[ends + 1] + SPEED_REACH)
        for start, stop in zip([unit.start, *begins], [*(ends + 1), unit.stop], strict=True):
            found += within(unit, int(start), int(stop), time, log.position, LEAST_START)
    return found
