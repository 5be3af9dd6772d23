"""Robots by name, or by the file that describes one."""

from __future__ import annotations

import functools
import importlib
import logging
from pathlib import Path

from ..common import plugins
from ..common.errors import SealegsError, nearest
from . import ENVIRONMENTS
from .described.as_robot import as_robot
from .described.robot_file import is_robot_file, load_robot_file
from .described.robot_imu import with_imu
from .engine.numbers import RobotError
from .engine.robot import Robot

LOGGER = logging.getLogger("sealegs")


def _robot(name: str) -> Robot:
    return getattr(importlib.import_module(f".{name.lower()}.robot", __package__), name.upper())


ROBOTS: dict[str, Robot] = {robot.name: robot for robot in map(_robot, ENVIRONMENTS)}
_FILES = sorted(Path(__file__).parent.glob("*/*.yaml"))
COLLECTION = {path.stem: path for path in _FILES if path.stem == path.parent.name}
"""Robots of ours that files alone describe: the YAML of each, by name."""
NAMES = (*ROBOTS, *COLLECTION)
"""Of all robots of ours."""
MISSPELT_LIKENESS = 0.8
"""Likeness from which a word for a robot is a known one, misspelt; any other is of a machine that is none of ours."""


def get_robot(name: str | Path) -> Robot:
    """The robot of that name, which may be an installed plugin's, or the one that a file describes: its YAML, or an
    MJCF or URDF.

    What a file leaves open is assumed, and told on the standard error as the file is first read.

    Raises:
        RobotError: there is none, the message names the nearest one; or its file is wrong.
    """
    if not isinstance(name, str | Path):
        raise RobotError(f"a robot is a name or the path of its file, not {name!r}; robots are {', '.join(NAMES)}.")
    if is_robot_file(name):
        return _described(Path(name).absolute(), _changed(Path(name)))
    if name in COLLECTION:
        return get_robot(COLLECTION[str(name)])
    if name not in ROBOTS and name in (added := plugins.installed("robots")):
        found = plugins.entry("robots", str(name))
        if isinstance(found, Robot):
            return found
        if is_robot_file(found):
            return get_robot(found)
        raise RobotError(
            f"what a plugin adds as the robot '{name}' ({added[str(name)].value}) is neither a Robot nor the path of a "
            "robot's file."
        )
    if name not in ROBOTS:
        known = ", ".join([*NAMES, *plugins.installed("robots")])
        raise RobotError(
            f"there is no robot '{name}'{nearest(str(name), NAMES)}; robots are {known}, or the path of a robot's "
            ".yaml, .xml or .urdf."
        )
    return ROBOTS[str(name)]


def robot_meant(word: str) -> str:
    """The robot of ours whose name a word is but for a slip, as the end of a sentence; empty for a word of its own."""
    known = not word.isalpha() or word in NAMES or is_robot_file(word)
    return "" if known else nearest(word, NAMES, MISSPELT_LIKENESS)


@functools.lru_cache(maxsize=32)
def _described(path: Path, changed: tuple[int, ...]) -> Robot:
    del changed  # a part of the key: files that were edited are read again
    file = load_robot_file(path)
    for sentence in file.said:
        LOGGER.warning("%s", sentence)
    try:
        return with_imu(as_robot(file), file.imu)
    except SealegsError as error:
        raise RobotError(f"{path}: {error}") from None


def _changed(path: Path) -> tuple[int, ...]:
    """When the files of a robot were written; other files of the folder count as well, since a YAML names one."""
    beside = sorted(path.parent.glob("*")) if path.parent.is_dir() else []
    return tuple(item.stat().st_mtime_ns for item in beside if is_robot_file(item) and item.is_file())
