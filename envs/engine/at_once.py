"""Stops a run whose simulations break at once in every episode: nothing can be learned there."""

from __future__ import annotations

import numpy as np

from ...common.errors import SealegsError

AT_ONCE = 3  # control steps within which an episode breaks at once; assumed
EPISODES = 5  # in a row, of every simulation, that break at once, before a run stops; assumed


class BreaksAtOnce:
    """Counts such episodes of n simulations."""

    def __init__(self, robot: str, num_envs: int) -> None:
        """Count for the robot of that name."""
        self._robot = robot
        self._latest = np.zeros(num_envs, dtype=np.int64)

    def see(self, unstable: np.ndarray, steps: np.ndarray, timestep: float) -> None:
        """One control step.

        Args:
            unstable: whether each simulation broke in it (n,).
            steps: of each running episode (n,).
            timestep: of the simulation [s].

        Raises:
            SealegsError: every simulation broke at once, in each of its latest episodes.
        """
        soon = steps <= AT_ONCE
        self._latest = np.where(soon, self._latest + unstable, 0)
        if self._latest.min() >= EPISODES:
            raise SealegsError(
                f"the simulation of robot '{self._robot}' breaks within the first {AT_ONCE} control steps of every "
                f"episode; make its timestep shorter than {1e3 * timestep:g} ms, take another integrator, or write its "
                "file anew with sealegs new-robot, which tries both."
            )
