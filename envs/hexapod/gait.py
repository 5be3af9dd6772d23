"""The reference controller: a tripod gait with double stance (paper 001, 7.1).

Legs 0, 2, 4 and legs 1, 3, 5 take turns. Printed: the gait, a heading velocity of 1.5 cm/s, a cycle of 12 s, a double
stance, new references every 10 ms; vertical references stand still in support and move quickly in the transfer, while
horizontal ones always move (7.2). The paper leaves the gait algorithm to its references, so the rest is assumed: at
other speeds the steps stay as long and the cycle follows, and the transfer has no jumps of speed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .kinematics import joints_from_foot, leg_angle
from .parameters import LEGS

PERIOD = 0.01  # [s] between references, 2.2
SPEED = 0.015  # [m/s], 7.1
CYCLE = 12.0  # [s] at that speed, 7.1


@dataclass(frozen=True)
class Tripod:
    """Parameters of the gait.

    Attributes:
        speed: heading velocity [m/s].
        double_stance: share of the cycle, twice in it, in which all legs stand; assumed.
        lift: of the foot in the transfer [m], assumed.
        lifting: share of the transfer in which a foot rises, and that in which it sinks; assumed.
    """

    speed: float = SPEED
    double_stance: float = 1.0 / 12.0
    lift: float = 0.04
    lifting: float = 0.3

    @property
    def cycle(self) -> float:
        """Time of a step cycle [s]."""
        return CYCLE * SPEED / abs(self.speed)

    @property
    def transfer(self) -> float:
        """Share of the cycle in which a leg is in the air."""
        return 0.5 - self.double_stance

    def phase(self, leg: int, time: np.ndarray | float) -> np.ndarray:
        """Share of the cycle since the leg last lifted off; time 0 lies in the middle of a double stance."""
        return (np.asarray(time) / self.cycle - 0.5 * self.double_stance + 0.5 * (leg % 2)) % 1.0

    def in_transfer(self, leg: int, time: np.ndarray | float) -> np.ndarray:
        """Whether the leg is in the air."""
        return self.phase(leg, time) < self.transfer

    def foot(self, leg: int, time: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """Way of the foot ahead of the middle of its support, and its height over the ground [m]."""
        phase, air, ground = self.phase(leg, time), self.transfer, 1.0 - self.transfer
        stroke = self.speed * ground * self.cycle
        standing = 0.5 - (phase - air) / ground
        s = np.clip(phase / air, 0.0, 1.0)
        slope = -air / ground  # a foot leaves and meets the ground with the ground's speed
        ahead = -0.5 + slope * s + (1.0 - slope) * s**2 * (3.0 - 2.0 * s)
        rise = np.clip(np.minimum(s, 1.0 - s) / self.lifting, 0.0, 1.0)
        moving = phase < air
        return stroke * np.where(moving, ahead, standing), np.where(
            moving, 0.5 * self.lift * (1.0 - np.cos(np.pi * rise)), 0.0
        )

    def goals(self, values: Mapping[str, float], time: np.ndarray | float) -> np.ndarray:
        """References of all joints (..., 18) at times (...) [rad, m], in the robot's order."""
        columns: list[np.ndarray] = []
        for leg in range(LEGS):
            ahead, height = self.foot(leg, time)
            angle = leg_angle(leg)
            x = values["stance_radius"] - values["leg_radius"] + ahead * np.cos(angle)
            z = values["foot_radius"] - values["stance_height"] + height
            joints = joints_from_foot(values, x, -ahead * np.sin(angle), z)
            columns += [np.broadcast_to(value, np.shape(ahead)) for value in joints]
        return np.stack(columns, axis=-1)
