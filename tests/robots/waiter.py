"""A task of a user's own: keep the last joint level while the others move as they like."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from sealegs.envs.any_robot.reach import ReachTask
from sealegs.envs.engine.task import Motion


@dataclass(frozen=True)
class Waiter(ReachTask):
    """Only the last joint counts, twice."""

    level: float = 0.0

    episode_steps = 40

    def rewards(self, motion: Motion) -> dict[str, np.ndarray]:
        error = motion.link[:, -1] - self.level
        return {**self.closeness(motion, motion.command), "reward_level": -2.0 * error**2}


class NotATask:
    """Something else."""
