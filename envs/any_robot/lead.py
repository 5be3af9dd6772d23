"""How far ahead of a trajectory the goals must be, so that the servos are on it: measured on their own chains."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from ..engine.batch import BatchEngine

ROWS = 4  # trajectories
SETTLED, SECONDS = 0.5, 2.0  # [s] after which a trial counts, and that it lasts
LONGEST = 0.5  # [s] sought


def measured_lead(
    engine: BatchEngine, target: Callable[[np.ndarray, np.ndarray], np.ndarray], half: np.ndarray
) -> float:
    """The time [s] by which the joints are behind goals that are the trajectory itself; delay, gain and load make it.

    Args:
        engine: of :data:`ROWS` simulations in which goals at action 0 are the trajectory.
        target: the trajectory (n, k) [rad or m] at times (n,) [s], of commands (n, c).
        half: of each joint's range (k,) [rad or m].
    """
    engine.seed(0)
    engine.reset()
    still = np.zeros((ROWS, len(engine.action_names)))
    times, links, command = [], [], engine.motion(still).command.copy()
    for _ in range(round(SECONDS / engine.dt)):
        if engine.step(still).flags["unstable"].any():
            return 0.0
        times.append(engine.steps * engine.dt)
        links.append(engine.motion(still).link)
    kept = slice(round(SETTLED / engine.dt), None)
    link = np.array(links)[kept]

    def squares(late: float) -> float:
        wanted = np.array([target(time - late, command) for time in times[kept]])
        error = (link - wanted) / half
        return float(((error - error.mean(axis=0)) ** 2).sum())  # where gravity holds a joint is not a time

    found: Any = minimize_scalar(squares, bounds=(0.0, LONGEST), method="bounded")
    return round(float(found.x), 4)
