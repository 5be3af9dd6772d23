"""Motion of a robot sharper than its encoders show it: what smoothing takes from a joint is put back from its replay.

What a joint works against hangs on how the others accelerate. An acceleration from an encoder is smoothed over tens of
milliseconds, which flattens every step of a goal, and a payload that is fitted against flattened accelerations comes
out too heavy. The replay of a joint knows its accelerations without noise; only the part of them that smoothing removes
is taken, and only as far as the log agrees.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..checks.signal import derivatives
from ..log.types import Array, MeasuredRun
from .problem import JointProblem

EDGE = 8  # samples at both ends of a piece whose differences are not used
FAR = 0.3  # of a joint's motion: the error of a replay that is of another motion
LEAST = 1e-12  # [rad2] below which smoothing takes nothing


def flattened(
    runs: Sequence[MeasuredRun], problems: Mapping[str, JointProblem], values: Mapping[str, Mapping[str, float]]
) -> list[dict[str, Array]]:
    """What smoothing takes from position, speed and acceleration of each joint in each run (n, 3), in the log's frame.

    Args:
        runs: of the robot.
        problems: of joints that are replayed freely.
        values: of their parameters by path; what is believed where there are none.
    """
    found: list[dict[str, Array]] = [{} for _ in runs]
    for joint, problem in problems.items():
        # what moves the others is the link, wherever a spring lies between it and its motor
        channel = 1 if all(run.joints[joint].link_position is not None for run in runs) else 0
        reading = problem.simulate([values.get(joint, {})])[0, :, channel]
        error = problem.judged * (reading - problem.measured[:, channel])
        if not np.nanstd(error) < FAR * np.nanstd(problem.measured[problem.judged, channel]):
            continue  # it says nothing of this motion
        tables = [np.zeros((len(run.time), 3)) for run in runs]
        shown, expected, written = 0.0, 0.0, []
        for unit, a, b in zip(problem.units, problem.starts[:-1], problem.starts[1:], strict=True):
            if b - a <= 2 * EDGE:
                continue
            time, log = runs[unit.run].time[unit.start : unit.stop], runs[unit.run].joints[joint]
            sharp = _differences(time, reading[a:b]) - np.stack(derivatives(time, reading[a:b]), axis=1)
            inside = np.zeros(b - a, bool)
            inside[EDGE : b - a - EDGE] = True
            judged = problem.judged[a:b] & inside
            written.append((unit, sharp, inside & ~judged, judged))
            link = log.position if log.link_position is None else log.link_position
            measured = link[unit.start : unit.stop]
            taken = measured - derivatives(time, measured)[0]
            good = judged & np.isfinite(taken)
            shown += float(taken[good] @ sharp[good, 0])
            expected += float(sharp[judged, 0] @ sharp[judged, 0])
        for which in (2, 3):  # what is replayed twice counts where it is judged
            for piece in written:
                unit, sharp, rows = piece[0], piece[1], np.flatnonzero(piece[which])
                tables[unit.run][unit.start + rows] = sharp[rows]
        agreed = min(max(shown / expected, 0.0), 1.0) if expected > LEAST else 0.0
        for table, each in zip(tables, found, strict=True):
            each[joint] = agreed * table
    return found


def _differences(time: Array, values: Array) -> Array:
    """Values without noise and their derivatives by neighbours (n, 3)."""
    speed = np.gradient(values, time)
    before, after = np.diff(time)[:-1], np.diff(time)[1:]
    change = np.diff(values) / np.diff(time)
    turning = np.zeros_like(values)
    turning[1:-1] = 2.0 * np.diff(change) / (before + after)
    return np.stack([values, speed, turning], axis=1)
