"""Reach a pose and hold it: a target for each coordinate, new in every episode."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...actuators import Drivetrain
from ..engine.task import Motion, option
from .task import AnyRobotTask, Numbers


@dataclass(frozen=True)
class ReachTask(AnyRobotTask):
    """The options of :class:`sealegs.envs.any_robot.env.ReachEnv`."""

    reach: float = option(0.8, "see Starting State")

    def observation_names(self) -> tuple[str, ...]:
        return self.named(
            ("target", "{unit}"), ("motor reading", "{unit}"), ("motor speed", "{unit}/s"), ("last action", "-")
        )

    def asked_names(self) -> tuple[str, ...]:
        return self.of_joints()

    def commands(self, random: np.ndarray) -> np.ndarray:
        middle = sum(self._ends()) / 2.0
        return middle + self.reach * self.half * (2.0 * self.per_coordinate(random)[:, :, 0] - 1.0)

    def place(
        self, drivetrain: Drivetrain, numbers: Numbers, random: np.ndarray, qpos: np.ndarray, qvel: np.ndarray
    ) -> np.ndarray:
        del numbers
        noise = self.start_noise * self.half * (2.0 * self.per_coordinate(random)[:, :, 1] - 1.0)
        return self.placed(drivetrain, self.centre + noise, qpos, qvel)

    def observe(self, motion: Motion) -> tuple[np.ndarray, ...]:
        return motion.command, motion.reading, motion.reading_speed, motion.action

    def rewards(self, motion: Motion) -> dict[str, np.ndarray]:
        return self.closeness(motion, motion.command)

    def errors(self, motion: Motion) -> dict[str, np.ndarray]:
        return self.away(motion, motion.command)
