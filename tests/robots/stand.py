"""A task of a user's own: stand still and level, as the IMU says it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from sealegs.envs.any_robot.reach import ReachTask
from sealegs.envs.engine.task import Motion


@dataclass(frozen=True)
class Stand(ReachTask):
    """The base stays level; it has failed once it lies."""

    episode_steps = 200

    def observation_names(self) -> tuple[str, ...]:
        seen = [f"gravity along {axis} [-]" for axis in "xyz"] + [f"turn rate about {axis} [rad/s]" for axis in "xyz"]
        return (*seen, *super().observation_names())

    def observe(self, motion: Motion) -> tuple[np.ndarray, ...]:
        return motion.gravity, motion.turn_rate, *super().observe(motion)

    def rewards(self, motion: Motion) -> dict[str, np.ndarray]:
        return {"reward_level": -motion.gravity[:, 2], "reward_still": -0.1 * (motion.turn_rate**2).sum(axis=1)}

    def failed(self, motion: Motion) -> np.ndarray:
        return motion.gravity[:, 2] > -0.5
