"""A robot as data: a YAML beside an MJCF or URDF, which says what drives each joint and whose numbers count.

    model: my_arm.xml               # relative to this file
    joints:
      shoulder: {chain: sts3215, range: [-1.5, 1.5]}
      elbow: {chain: sts3215, range: [-2.0, 2.0], unknown: [friction]}

A bare model file is a robot too: what it leaves open is assumed, and :attr:`RobotFile.said` tells what.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...common.documents import DocumentError, read_yaml
from ...common.errors import SealegsError
from ...configs.check import checked_fields
from ..engine.numbers import RobotError
from .model_file import SUFFIXES
from .robot_assembly import assembled
from .robot_choice import passive_sentence
from .robot_described import RobotFile
from .robot_entries import YAML_SUFFIXES, FileEntry


def is_robot_file(name: str | Path) -> bool:
    """Whether a word for a robot is the path of a robot file rather than the name of a built-in robot."""
    return Path(name).suffix.lower() in (*YAML_SUFFIXES, *SUFFIXES)


def load_robot_file(path: str | Path) -> RobotFile:
    """Read a robot from its YAML, or from a bare MJCF or URDF.

    Raises:
        RobotError: a file is missing or damaged, or what it says does not fit; the message names file and key.
    """
    path = Path(path).absolute()
    if path.suffix.lower() in SUFFIXES:
        beside = path.with_suffix(".yaml")
        said = [f"{path.name} is taken as it is; `sealegs new-robot {path.name}` writes what is assumed into a file."]
        if os.path.isfile(beside):
            said = [f"{beside} lies beside {path.name} and is not read: give it as the robot to use it."]
        return assembled(path, FileEntry(path.name), said)
    if path.suffix.lower() not in YAML_SUFFIXES:
        known = ", ".join((*YAML_SUFFIXES, *SUFFIXES))
        raise RobotError(f"{path} is no file of a robot; give one that ends in {known}.")
    try:
        entry = checked_fields("", read_document(path), FileEntry)
        file = assembled(path, entry, [])
    except RobotError:
        raise
    except SealegsError as error:
        raise RobotError(f"{path}: {error}") from None
    if entry.joints is None:  # assembling told it
        return file
    driven = [name for joint in file.joints for name, _ in joint.terms]
    return replace(file, said=(*file.said, *passive_sentence(file.model, driven)))


# --- the document ----------------------------------------------------------------------------------------------------


def read_document(path: Path) -> Any:
    """What stands in the YAML of a robot.

    Raises:
        RobotError: it is missing, cannot be read, or has a key twice.
    """
    try:
        return read_yaml(path)
    except DocumentError as error:
        if error.missing:
            raise RobotError(f"there is no robot file {path}; sealegs new-robot <model> writes one.") from None
        raise RobotError(f"{error}.") from None
