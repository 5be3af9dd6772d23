"""The robots that the project knows, by name."""

from __future__ import annotations

from ..actuators.errors import nearest
from .bench.robot import BENCH
from .biped.robot import BIPED
from .hexapod.robot import HEXAPOD
from .hopper.robot import HOPPER
from .robot import Robot, RobotError

ROBOTS: dict[str, Robot] = {robot.name: robot for robot in (BENCH, HOPPER, BIPED, HEXAPOD)}


def get_robot(name: str) -> Robot:
    """The robot of that name.

    Raises:
        RobotError: there is none; the message names the nearest one.
    """
    if name not in ROBOTS:
        known = ", ".join(ROBOTS)
        raise RobotError(f"there is no robot '{name}'{nearest(str(name), ROBOTS)}; robots are {known}.")
    return ROBOTS[name]
