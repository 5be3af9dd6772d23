"""Reference gaits that a learner corrects: leg angles and leg shapes over a clock, without feedback.

All numbers are assumed. That a leg swings from behind to ahead while the other pushes back, as far as the commanded
speed and the cadence ask for, is all that walking is here; without corrections the biped falls within a few steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class WalkingGait:
    """One leg swings while the other stands; the left one in the first half of the clock's turn. All assumed.

    Attributes:
        lean: middle of the leg angles [rad].
        shape: of a standing leg [rad].
        lift: of the shape in the middle of the swing [rad].
    """

    lean: float = 0.0
    shape: float = 0.22
    lift: float = 0.22

    def goals(self, phase: np.ndarray, speed: np.ndarray, cadence: float, numbers: Mapping[str, float]) -> np.ndarray:
        """Leg angle and leg shape of the left, then of the right leg (n, 4) [rad].

        Args:
            phase: of the clock (n,) [rad].
            speed: commanded (n,) [m/s].
            cadence: turns of the clock per second, two steps each [Hz].
            numbers: of the robot, by name.
        """
        length = (numbers["thigh_length"] + numbers["shin_length"]) * np.cos(self.shape)
        reach = np.arcsin(np.clip(speed / (4.0 * cadence * length), -0.5, 0.5))  # a step is 2 length sin(reach)
        columns = []
        for turn in (phase, phase + np.pi):
            share = (turn / (2.0 * np.pi)) % 1.0
            swing = np.clip(2.0 * share, 0.0, 1.0)
            standing = np.clip(2.0 * share - 1.0, 0.0, 1.0)
            ahead = np.where(share < 0.5, -np.cos(np.pi * swing), 1.0 - 2.0 * standing)
            columns += [self.lean + reach * ahead, self.shape + self.lift * np.sin(np.pi * swing) ** 2]
        return np.stack(columns, axis=1)


@dataclass(frozen=True)
class HoppingGait:
    """Both legs, one ahead of the other, bend and stretch together.

    The spread is printed in (46). The others are assumed: near some that last for 5 s, of 32 drawn at random.

    Attributes:
        spread: between the legs [rad].
        lean: middle of the leg angles [rad].
        shape: middle of the leg shapes [rad].
        bend: by which they bend and stretch about it [rad].
    """

    spread: float = np.pi / 6.0
    lean: float = -0.09
    shape: float = 0.24
    bend: float = 0.12

    def goals(self, phase: np.ndarray) -> np.ndarray:
        """As :meth:`WalkingGait.goals`, for the phases of the clock (n,) [rad]."""
        shape = self.shape + self.bend * np.sin(phase)
        still = np.full_like(shape, self.lean)
        return np.stack([still - 0.5 * self.spread, shape, still + 0.5 * self.spread, shape], axis=1)
