"""The slow way to where a motion begins."""

from __future__ import annotations

import numpy as np

from .robot import ServoRobot

SPEED = 1.0  # [rad/s] of the servos' shafts
ARRIVED = 0.15  # [rad] of the shaft that counts as there: friction and load leave a position servo short of its goal


class Way:
    """From where a robot is to where it shall be, at :data:`SPEED` of the shaft that turns furthest.

    Attributes:
        span: time that it takes [s].
    """

    def __init__(self, robot: ServoRobot, first: np.ndarray, last: np.ndarray) -> None:
        """Plan it, from the goals ``first`` to ``last`` (k,) [rad or m]."""
        self._per_radian = np.array([joint.per_radian for joint in robot.joints])
        self._first, self._last = first, last
        self.span = float((np.abs(last - first) / self._per_radian).max()) / SPEED

    def goal(self, now: float) -> np.ndarray:
        """At ``now`` [s] since it began (k,) [rad or m]."""
        return self._first + (self._last - self._first) * min(now / max(self.span, 1e-9), 1.0)

    def is_there(self, position: np.ndarray) -> bool:
        """Whether all joints, at ``position`` (k,) [rad or m], are close to its end."""
        return bool((np.abs(position - self._last) < ARRIVED * self._per_radian).all())
