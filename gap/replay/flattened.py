"""Motion of a robot sharper than its encoders show it: what smoothing takes from a joint is put back from its replay.

What a joint works against hangs on how the others accelerate. An acceleration from an encoder is smoothed over tens of
milliseconds, which flattens every step of a goal, and a payload that is fitted against flattened accelerations comes
out too heavy. The replay of a joint knows its accelerations without noise; only the part of them that smoothing removes
is taken, and only as far as the log agrees.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

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
        reading = problem.simulate([values.get(joint, {})])[0, :, 0]
        error = problem.judged * (reading - problem.measured[:, 0])
        if not np.nanstd(error) < FAR * np.nanstd(problem.measured[problem.judged, 0]):
            continue  # it says nothing of this motion
        tables = [np.zeros((len(run.time), 3)) for run in runs]
        shown, expected = 0.0, 0.0
        for judged in (False, True):  # what is replayed twice counts where it is judged
            for unit, a, b in zip(problem.units, problem.starts[:-1], problem.starts[1:], strict=True):
                rows = np.flatnonzero(problem.judged[a:b] == judged)
                rows = rows[(rows >= EDGE) & (rows < b - a - EDGE)]
                if not len(rows):
                    continue
                run = runs[unit.run]
                time = run.time[unit.start : unit.stop]
                sharp = _differences(time, reading[a:b]) - np.stack(derivatives(time, reading[a:b]), axis=1)
                tables[unit.run][unit.start + rows] = sharp[rows]
                if judged:
                    log = run.joints[joint]
                    measured = (log.position if log.link_position is None else log.link_position)[
                        unit.start : unit.stop
                    ]
                    taken = measured - derivatives(time, measured)[0]
                    good = rows[np.isfinite(taken[rows])]
                    shown += float(taken[good] @ sharp[good, 0])
                    expected += float(sharp[good, 0] @ sharp[good, 0])
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


def with_terms(problem: Any, terms: Sequence[Array]) -> Any:
    """A joint's problem that works against other terms, given for whole runs (n, T_COLUMNS)."""
    return replace(problem, terms=np.concatenate([terms[unit.run][unit.start : unit.stop] for unit in problem.units]))
