"""When a row's columns were read: once the goal of the row acts, or before, under the goal of the row before.

Most loops read their drives and then write the goals, so that a column answers to the goal of the row before. That
looks like a slow drive and is none. Along a measured motion nothing else tells of the true delay.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..checks.recording import DRIVE_LOOP_PERIOD, a_moment_tells
from ..log.torque_side import SURE, numbers_and_spread
from ..log.types import Array
from .driven import DrivenProblem, with_shown_side

LEAST = 200  # samples from which it can be told
HALF = 0.5  # of a row, within which the age of a goal must be one


def as_read(problem: DrivenProblem, *, told: bool) -> DrivenProblem:
    """The problem whose goals act as late as its columns were read early, if they were.

    Args:
        problem: with the goals as logged.
        told: whether the checks of the log say so already.
    """
    if not told and not read_before_goal(problem):
        return problem
    # what a torque is of is shown by replays, which must have the goals in force
    return with_shown_side(replace(_with_goals_before(problem), read_early=not told))


def read_before_goal(problem: DrivenProblem) -> bool:
    """Whether what is judged answers to the goal of the row before, by nominal replays with either.

    Their difference is what a goal's age of one row changes, so its share in the column is that age in rows. Gains,
    damping, the part of an integral, and what is inside or outside of a torque may be wrong beside it.
    """
    good = problem.judged & problem.on & np.isfinite(problem.measured[:, 0])
    if not problem.first or good.sum() < LEAST or not _shows(problem):
        return False
    now = problem.simulate([{}])[0, good, 0]
    change = _with_goals_before(problem).simulate([{}])[0, good, 0] - now
    if np.ptp(change) == 0.0:
        return False
    motion = problem.link[good]
    free = [now, change, motion, np.sign(motion[:, 1])]
    if any(model.chain.find("position_pi") is not None for model in problem.models):
        free.append(now - problem.simulate([{"position_pi.integral": 0.0}])[0, good, 0])
    unit = np.repeat(np.arange(len(problem.units)), np.diff(problem.starts))[good]
    table = _about_means(np.column_stack([problem.measured[good, 0], *free]), unit)
    numbers, spread = numbers_and_spread(table[:, 1:], table[:, 0], problem.block[good])
    scale = abs(float(numbers[0]))
    if scale <= SURE * spread[0]:
        return False
    rows = float(numbers[1] / numbers[0])
    return abs(rows - 1.0) + SURE * float(spread[1]) / scale < HALF


def _about_means(table: Array, unit: np.ndarray) -> Array:
    """Columns (n, k) less their means in each unit (n,): every piece of a log may have offsets of its own."""
    rows = np.maximum(np.bincount(unit), 1)
    means = np.stack([np.bincount(unit, column) / rows for column in table.T], axis=1)
    return table - means[unit]


def _shows(problem: DrivenProblem) -> bool:
    """Whether a moment makes a goal one row older, in every unit."""
    return all(
        a_moment_tells(problem.time[a:b], problem.models[unit.run].value("delay.seconds"))
        for unit, a, b in zip(problem.units, problem.starts, problem.starts[1:], strict=False)
    )


def _with_goals_before(problem: DrivenProblem) -> DrivenProblem:
    """The problem whose columns are read a moment before the goals of their rows act."""
    late = [
        model.with_values({"delay.seconds": model.value("delay.seconds") + DRIVE_LOOP_PERIOD})
        for model in problem.models
    ]
    return replace(problem, models=tuple(late))
