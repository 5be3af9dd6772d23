"""What a task is: pure functions over a batch from motion to observation, reward, failure and new starts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from actuators import Drivetrain
from envs.robot import Robot


@dataclass(slots=True)
class Motion:
    """What happened to n simulations of k coordinates in one control step; not to be written to.

    Attributes:
        qpos: true positions (n, nq), joints in the order of the model.
        qvel: true speeds (n, nv).
        link: link encoder (n, k) [rad].
        link_speed: its difference over the control step (n, k) [rad/s].
        reading: motor encoder as the host receives it: late, quantised, with its offset (n, k) [rad].
        reading_speed: its difference over the control step (n, k) [rad/s].
        torque: motor torque on the coordinate, dry friction excluded (n, k) [N.m].
        motor_speed: true speed of the motor side (n, k) [rad/s].
        action: of this step (n, k), within [-1, 1].
        previous_action: of the step before (n, k).
        command: what the episode asks for (n, c), as the task drew it at the start.
        time: since the episode started (n,) [s].
        numbers: of the robot, by name.
    """

    qpos: np.ndarray
    qvel: np.ndarray
    link: np.ndarray
    link_speed: np.ndarray
    reading: np.ndarray
    reading_speed: np.ndarray
    torque: np.ndarray
    motor_speed: np.ndarray
    action: np.ndarray
    previous_action: np.ndarray
    command: np.ndarray
    time: np.ndarray
    numbers: Mapping[str, float]


class Task(ABC):
    """A robot and what it is asked to do. Subclasses are frozen dataclasses of weights; their methods know no single
    simulation.

    Attributes:
        robot: that the task is for.
        draws: uniform random numbers that one start needs.
        ranges: arguments that may be a pair, low and high, instead of one number.
    """

    robot: ClassVar[Robot]
    draws: ClassVar[int]
    ranges: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def observation_names(self) -> tuple[str, ...]:
        """Name and unit of each element of the observation, in order."""

    @abstractmethod
    def commands(self, random: np.ndarray) -> np.ndarray:
        """What m new episodes ask for (m, c), from uniform numbers in [0, 1), (m, draws)."""

    @abstractmethod
    def place(
        self,
        drivetrain: Drivetrain,
        numbers: Mapping[str, float],
        random: np.ndarray,
        qpos: np.ndarray,
        qvel: np.ndarray,
    ) -> np.ndarray:
        """Write m starts into ``qpos`` (m, nq) and ``qvel`` (m, nv), which hold the model's defaults.

        Args:
            drivetrain: robot with its actuators.
            numbers: of the robot, by name.
            random: the same uniform numbers, (m, draws).
            qpos: to edit.
            qvel: to edit.

        Returns:
            The goals that the actuators hold at the start (m, k) [rad].
        """

    def reference(
        self, time: np.ndarray, command: np.ndarray, numbers: Mapping[str, float]
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Goals that actions correct, and how far they do; None: actions of -1 and 1 are the limits of the goals.

        Args:
            time: since the episodes started (n,) [s].
            command: what they ask for (n, c).
            numbers: of the robot, by name.

        Returns:
            Goals at action 0 (n, k) [rad], and the change of the goal per unit of action (k,) [rad].
        """
        del time, command, numbers
        return None

    @abstractmethod
    def observe(self, motion: Motion) -> tuple[np.ndarray, ...]:
        """Parts of the observation, (n,) or (n, j) each, in the order of :meth:`observation_names`."""

    @abstractmethod
    def rewards(self, motion: Motion) -> dict[str, np.ndarray]:
        """Terms of the reward by name, (n,) each; the reward is their sum."""

    @abstractmethod
    def failed(self, motion: Motion) -> np.ndarray:
        """Whether the episode ends here for good, (n,)."""
