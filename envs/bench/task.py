"""Bring the pendulum to an angle and hold it there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...actuators import Drivetrain
from ..engine.task import Motion, Task, option
from .robot import BENCH, JOINT


@dataclass(frozen=True)
class BenchTask(Task):
    """The options of :class:`sealegs.envs.bench.env.BenchEnv`."""

    target_range: float = option(1.2, "see Starting State", "rad")
    tracking_weight: float = 1.0
    energy_weight: float = option(0.02, "see Rewards", "1/W")
    start_noise: float = option(0.2, "see Starting State")

    robot = BENCH
    draws = 3

    def observation_names(self) -> tuple[str, ...]:
        return (
            "target [rad]",
            "link angle [rad]",
            "motor reading [rad]",
            "link speed [rad/s]",
            "motor speed [rad/s]",
            "last action",
        )

    def asked_names(self) -> tuple[str, ...]:
        return (f"{JOINT} [rad]",)

    def commands(self, random: np.ndarray) -> np.ndarray:
        return self.target_range * (2.0 * random[:, :1] - 1.0)

    def place(
        self,
        drivetrain: Drivetrain,
        numbers: Mapping[str, float],
        random: np.ndarray,
        qpos: np.ndarray,
        qvel: np.ndarray,
    ) -> np.ndarray:
        del numbers
        angle = self.start_noise * (2.0 * random[:, 1] - 1.0)
        drivetrain.set_position(JOINT, qpos, angle)
        qvel[:] = (self.start_noise * (2.0 * random[:, 2] - 1.0))[:, None]
        return angle[:, None]

    def observe(self, motion: Motion) -> tuple[np.ndarray, ...]:
        m = motion
        return m.command, m.link, m.reading, m.link_speed, m.reading_speed, m.action

    def rewards(self, motion: Motion) -> dict[str, np.ndarray]:
        error = np.abs(motion.link[:, 0] - motion.command[:, 0])
        power = np.abs(motion.torque[:, 0] * motion.motor_speed[:, 0])
        return {
            "reward_tracking": self.tracking_weight * (1.0 - np.minimum(error, 1.0)),
            "reward_energy": -self.energy_weight * power,
        }

    def failed(self, motion: Motion) -> np.ndarray:
        return np.zeros(len(motion.qpos), dtype=bool)
