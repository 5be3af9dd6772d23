"""The robots that the project knows, by name."""

from __future__ import annotations

import importlib

from ..actuators.errors import nearest
from . import ENVIRONMENTS
from .robot import Robot, RobotError


def _robot(name: str) -> Robot:
    return getattr(importlib.import_module(f".{name.lower()}.robot", __package__), name.upper())


ROBOTS: dict[str, Robot] = {robot.name: robot for robot in map(_robot, ENVIRONMENTS)}


def get_robot(name: str) -> Robot:
    """The robot of that name.

    Raises:
        RobotError: there is none; the message names the nearest one.
    """
    if name not in ROBOTS:
        known = ", ".join(ROBOTS)
        raise RobotError(f"there is no robot '{name}'{nearest(str(name), ROBOTS)}; robots are {known}.")
    return ROBOTS[name]
