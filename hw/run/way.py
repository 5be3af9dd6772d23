"""The slow way to where a motion begins."""

from __future__ import annotations

from collections import deque

import numpy as np

from ..machine.robot import ServoRobot

SPEED = 1.0  # [rad/s] of the servos' shafts
KEPT = 500  # cycles
ARRIVED = 0.15  # [rad] of the shaft that counts as there: friction and load leave a position servo short of its goal


class Way:
    """From where a robot is to where it shall be, at :data:`SPEED` of the shaft that turns furthest.

    Attributes:
        span: time that it takes [s].
        noted: the latest :data:`KEPT` cycles: time, goals and positions.
    """

    def __init__(self, robot: ServoRobot, first: np.ndarray, last: np.ndarray) -> None:
        """Plan it, from the goals ``first`` to ``last`` (k,) [rad or m]."""
        self._per_radian = np.array([joint.per_radian for joint in robot.joints])
        self._first, self._last, self._turning = first, last, robot.turning
        self.noted: deque[list[float]] = deque(maxlen=KEPT)
        self.span = float((np.abs(last - first) / self._per_radian).max()) / SPEED

    def goal(self, now: float) -> np.ndarray:
        """At ``now`` [s] since it began (k,) [rad or m]."""
        return self._first + (self._last - self._first) * min(now / max(self.span, 1e-9), 1.0)

    def note(self, now: float, goal: np.ndarray, position: np.ndarray | None) -> None:
        """Keep where the robot was told to be and was (k,) [rad or m], for a run that ends on the way; None: unread."""
        if position is not None:
            self.noted.append([round(now, 4), *np.round([*goal, *position], 5).tolist()])

    def is_there(self, position: np.ndarray) -> bool:
        """Whether all joints, at ``position`` (k,) [rad or m], are close to its end."""
        away = np.where(self._turning, 0.0, np.abs(position - self._last))
        return bool((away < ARRIVED * self._per_radian).all())
