"""What tasks of any robot share: goals within the robot's ranges, and what servos alone can measure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self, cast

import numpy as np

from ...actuators import Drivetrain
from ...common.errors import SealegsError
from ..bench.robot import BENCH
from ..engine.model_poses import stand
from ..engine.robot import Robot
from ..engine.task import Motion, Task, drawn, option
from ..robots import get_robot


@dataclass(frozen=True)
class AnyRobotTask(Task):
    """A task that says nothing of which robot it is for: its environment takes a ``robot``, a name or a file.

    Positions and their errors count as shares of half a joint's range, so that joints of any size and unit, rad or m,
    weigh the same.

    Attributes:
        per_joint: uniform random numbers that one start needs for each driven coordinate.
        per_robot: further ones that it needs, which come last.
    """

    tolerance: float = option(0.05, "see Rewards: scale of an error, as a share of half the range")
    tracking_weight: float = 1.0
    smooth_weight: float = 0.05
    energy_weight: float = option(0.0, "see Rewards", "1/W")
    start_noise: float = option(0.02, "see Starting State")

    robot = BENCH
    any_robot = True
    per_joint: ClassVar[int] = 2
    per_robot: ClassVar[int] = 0

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        cls.draws = cls.per_joint * len(cls.robot.coordinates) + cls.per_robot

    @classmethod
    def on(cls, robot: Robot | str | Path) -> type[Self]:
        robot = robot if isinstance(robot, Robot) else get_robot(robot)
        body = {"robot": robot, "__doc__": cls.__doc__, "__module__": cls.__module__}
        return cast(type[Self], type(cls.__name__, (cls,), body))

    # --- the robot's ranges ------------------------------------------------------------------------------------

    @property
    def names(self) -> list[str]:
        """Of the driven coordinates, in the order of goals."""
        return [item.name for item in self.robot.coordinates]

    @cached_property
    def half(self) -> np.ndarray:
        """Half of each coordinate's range (k,) [rad or m]."""
        low, high = self._ends()
        return 0.5 * (high - low)

    @cached_property
    def centre(self) -> np.ndarray:
        """Where motions are about (k,) [rad or m]: the robot's start, at least a quarter of the range from its ends.

        One that stands on its legs keeps its start as it is.
        """
        low, high = self._ends()
        start = self.robot.start
        file = self.robot.file
        turning = () if file is None else {item.name for item in file.joints if item.by_speed}
        own = [0.0 if name in turning else start.get(name, 0.5 * (a + b))
               for name, a, b in zip(self.names, low, high, strict=True)]  # fmt: skip
        aside = 0.25 * (high - low) if file is None or file.height is None else 0.0
        return np.clip(own, low + aside, high - aside)

    @cached_property
    def room(self) -> np.ndarray:
        """How far motions about the centre may go (k,) [rad or m]: a quarter of the range, or to its nearer end."""
        low, high = self._ends()
        return np.minimum(0.5 * self.half, np.minimum(self.centre - low, high - self.centre))

    def _ends(self) -> tuple[np.ndarray, np.ndarray]:
        limits = self.robot.limits
        ends = np.array([limits[name] for name in self.names])
        return ends[:, 0], ends[:, 1]

    def named(self, *patterns: tuple[str, str]) -> tuple[str, ...]:
        """Observation names of each coordinate: ``("target", "{unit}")`` becomes ``target of elbow [rad]``."""
        return tuple(
            f"{word} of {name} [{unit.format(unit=self.robot.unit(name))}]"
            for word, unit in patterns
            for name in self.names
        )

    def of_joints(self) -> tuple[str, ...]:
        """Name and unit of each driven coordinate."""
        return tuple(f"{name} [{self.robot.unit(name)}]" for name in self.names)

    # --- what tasks of the kind do alike -----------------------------------------------------------------------

    def per_coordinate(self, random: np.ndarray) -> np.ndarray:
        """The uniform numbers of m starts (m, draws) by coordinate (m, k, per_joint)."""
        count = self.per_joint * len(self.names)
        return random[:, :count].reshape(len(random), len(self.names), self.per_joint)

    def placed(self, drivetrain: Drivetrain, angles: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Put the coordinates of m robots to ``angles`` (m, k) [rad or m], at rest; the goals that hold them there.

        Joints that nothing drives, a free base too, stand as in the keyframe that the robot's start is from.
        """
        stand(drivetrain.model, self.robot.pose, qpos)
        for column, name in enumerate(self.names):
            drivetrain.set_position(name, qpos, angles[:, column])
        qvel[:] = 0.0
        return angles

    def closeness(self, motion: Motion, target: np.ndarray) -> dict[str, np.ndarray]:
        """Terms of the reward: near the target (n, k) [rad or m], smooth, at little power."""
        error = np.abs(motion.link - target) / self.half
        change = motion.action - motion.previous_action
        power = np.abs(motion.torque * motion.motor_speed).sum(axis=1)
        return {
            "reward_tracking": self.tracking_weight * np.exp(-error / self.tolerance).mean(axis=1),
            "reward_smooth": -self.smooth_weight * (change**2).mean(axis=1),
            "reward_energy": -self.energy_weight * power,
        }

    def away(self, motion: Motion, target: np.ndarray) -> dict[str, np.ndarray]:
        """Root mean square errors of joints that turn and of joints that slide from their targets (n, k)."""
        error = motion.link - target
        return {name: np.sqrt((error[:, columns] ** 2).mean(axis=1)) for name, columns in self._by_unit.items()}

    @cached_property
    def _by_unit(self) -> dict[str, np.ndarray]:
        """Which coordinates turn and which slide (k,), by the name of their error, found once and not in each step."""
        said = {"rad": "joints from their targets", "m": "slides from their targets"}
        units = np.array([self.robot.unit(name) for name in self.names])
        return {f"{words} [{unit}]": units == unit for unit, words in said.items() if (units == unit).any()}

    def failed(self, motion: Motion) -> np.ndarray:
        return np.zeros(len(motion.action), dtype=bool)


class Commanded(AnyRobotTask):
    """A task that is told where to go: a command is uniform in its ranges, or 0 in a share of the episodes.

    Attributes:
        scales: names of numbers that errors count as shares of.
    """

    stand_share: float
    scales: ClassVar[tuple[str, ...]] = ("tolerance", "turn_tolerance")

    def __post_init__(self) -> None:
        for name in self.scales:
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise SealegsError(f"{name} is {value:g}; it must be above 0.")
        if self.command_interval < 0.0:
            raise SealegsError(f"command_interval is {self.command_interval:g} s; it must be above 0, or 0 for none.")

    def span(self, name: str) -> float | Sequence[float]:
        """A commanded number, or from which to which."""
        return getattr(self, name)

    def commands(self, random: np.ndarray) -> np.ndarray:
        draws = random[:, -self.per_robot :]
        asked = np.stack([drawn(self.span(name), draws[:, k]) for k, name in enumerate(self.ranges)], axis=1)
        return np.where(draws[:, -1:] < self.stand_share, 0.0, asked)


def columns(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Arrays (m, k) side by side (m, k times their number)."""
    return np.concatenate(parts, axis=1)


Numbers = Mapping[str, float]
"""Numbers of the robot by name."""
