"""How an IMU is turned, out of an accelerometer and a gyroscope alone: a complementary filter.

The gyroscope tells each turn, and the accelerometer slowly where up is, in moments without much other acceleration.
The heading is what the gyroscope adds up to, and drifts.
"""

from __future__ import annotations

import math

import numpy as np

from ...envs.engine import turns
from ...envs.engine.base import quaternion

GRAVITY = 9.81  # [m/s2]
TRUST = (
    1.0  # [s] in which an error of the tilt goes: of Mahony's filter with a gain of 1/s (Mahony, Hamel, Pflimlin, 2008)
)
QUIET = 0.2  # share of gravity by which a pull may differ from it and still tell where up is; assumed


class Tilt:
    """The filter, sample by sample."""

    def __init__(self, period: float) -> None:
        """Of samples that come every ``period`` [s]."""
        self._period = period
        self._turn: np.ndarray | None = None

    def after(self, pull: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """The turn (4,) with one more sample.

        Args:
            pull: of the accelerometer (3,) [m/s2], which points up at rest.
            rate: of the gyroscope (3,) [rad/s].
        """
        size = float(np.linalg.norm(pull))
        up = pull / max(size, 1e-9)
        if self._turn is None:
            roll, pitch = math.atan2(up[1], up[2]), math.atan2(-up[0], math.hypot(up[1], up[2]))
            self._turn = quaternion(roll, pitch, 0.0)
            return self._turn
        correction = np.zeros(3)
        if abs(size - GRAVITY) < QUIET * GRAVITY:
            correction = np.cross(up, -turns.projected_gravity(self._turn)) / TRUST
        turn = turns.multiply(self._turn, turns.of_vector((rate + correction) * self._period))
        self._turn = turn / np.linalg.norm(turn)
        return self._turn
