"""The robot of an import: what its file says of joints, and what lies far outside of their ranges."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ....actuators.stages.controller import UNLIMITED
from ....common.errors import nearest
from ....envs.described.robot_file import RobotFile, is_robot_file, load_robot_file
from ....envs.robots import NAMES, get_robot
from ..types import Array, LogError
from .positions import PERCENT
from .recording import STRAY_SHARE

POSITIONS = ("position", "goal", "link_position")
HALF_TURN = math.pi
"""[rad] by which a hinge may lie beyond its range: an unknown zero turns a joint by no more."""


@dataclass(frozen=True)
class Robot:
    """A robot by its word.

    Attributes:
        word: name or path, empty where nobody says one.
        file: what its file says, None where the word is of no file that is there.
    """

    word: str = ""
    file: RobotFile | None = None

    @cached_property
    def joints(self) -> frozenset[str]:
        """Joints of its file, its model's too."""
        return frozenset({*self.file.model.joints, *(one.name for one in self.file.joints)} if self.file else ())

    @cached_property
    def slides(self) -> frozenset[str]:
        kinds = [*self.file.model.joints.values(), *self.file.joints] if self.file else []
        return frozenset(joint.name for joint in kinds if joint.kind == "slide")

    @cached_property
    def limits(self) -> dict[str, float]:
        """Largest torques that the file gives the drives of joints [N.m]."""
        drives = {joint.name: joint.chain.find("ideal") for joint in self.file.joints} if self.file else {}
        return {name: drive.torque_limit for name, drive in drives.items() if drive and drive.torque_limit < UNLIMITED}

    @cached_property
    def ranges(self) -> dict[str, tuple[float, float, str]]:
        """Lower and upper end [rad or m] and kind of each joint that has a range; of a belt over several there is
        none."""
        if self.file is None:
            return {}
        ranges = {name: (*joint.range, joint.kind) for name, joint in self.file.model.joints.items() if joint.range}
        own = dict(ranges)
        for joint in self.file.joints:
            own.pop(joint.name, None)
            name, factor = joint.terms[0]
            if len(joint.terms) == 1 and name in ranges:
                low, high = sorted(factor * end for end in ranges[name][:2])
                own[joint.name] = (low, high, joint.kind)
        return own

    def check_file(self, run: str) -> None:
        """Refuse a file that is not there.

        Raises:
            LogError: the word is a file's, and there is no such file.
        """
        if is_robot_file(self.word) and self.file is None:
            raise LogError(f"{run}: there is no robot's file {self.word}; correct the key robot.")

    def check_joints(self, run: str, joints: Iterable[str]) -> None:
        """Refuse joints that the file does not have.

        Raises:
            LogError: there is one; the message names the nearest that it has.
        """
        for joint in joints if self.file else ():
            if joint not in self.joints:
                raise LogError(
                    f"{run}: {Path(self.word).name} has no joint '{joint}'{nearest(joint, self.joints)}; it has "
                    f"{', '.join(sorted(self.joints))}. Rename it under columns in the mapping, or leave it out."
                )

    def check_shares(self, joints: Collection[str]) -> None:
        """Refuse a share of a range that nobody says.

        Raises:
            LogError: no robot's file is given, or it has no range for a joint that is in percent.
        """
        by_hand = "write low + <column>/100*(high - low) in the mapping"
        for joint in joints:
            if self.file is None:
                raise LogError(
                    f"unit={PERCENT} is of the range that a joint has in the model of its robot, and no robot's file "
                    f"is given: add robot=my_arm.yaml, or {by_hand}."
                )
            if joint in self.joints and joint not in self.ranges:
                raise LogError(
                    f"unit={PERCENT}: {self.file.model.path.name} gives the joint '{joint}' no range that it could be "
                    f"a share of; add one there, or {by_hand}."
                )

    def far(self, columns: Iterable[tuple[str, Array]]) -> tuple[str, ...]:
        """A sentence for each column of a log, in rad or m, that lies far outside its joint's range."""
        said: dict[str, str] = {}
        for name, values in columns:
            joint, _, signal = name.rpartition(".")
            finite = values[np.isfinite(values)]
            if signal not in POSITIONS or joint not in self.ranges or not len(finite) or name in said:
                continue
            low, high, kind = self.ranges[joint]
            least, most = (float(np.quantile(finite, share)) for share in (STRAY_SHARE, 1.0 - STRAY_SHARE))
            beyond, unit = (HALF_TURN, "rad") if kind == "hinge" else (high - low, "m")
            if least < low - beyond or most > high + beyond:
                said[name] = (
                    f"{name} goes from {least:.3g} to {most:.3g} {unit}, far outside the range that "
                    f"{Path(self.word).name} gives the joint, {low:.3g} to {high:.3g} {unit}; correct its unit or its "
                    "zero in its line"
                )
        return tuple(said.values())


def robot_of(word: str | None, out: Path) -> Robot:
    """The robot of a word, with its file from here or from the folder of the logs, which need not exist yet."""
    if not word or not is_robot_file(word):
        return Robot(word or "")
    paths = (Path(word), Path(os.path.normpath(out / word)))
    path = next((path for path in paths if os.path.isfile(path)), None)
    return Robot(word, load_robot_file(path) if path else None)


def has_model(word: str) -> bool:
    """Whether a word is a robot's of the collection or a file's; a word of one's own names no model."""
    return word in NAMES or is_robot_file(word)


def asked_robot(word: str | None, out: Path) -> Robot:
    """The robot that a call asks for.

    Raises:
        SealegsError: there is no robot of that name, or no such file.
    """
    if word is None or not is_robot_file(word):
        return Robot(get_robot(word).name if word else "")
    robot = robot_of(word, out)
    if robot.file is None:
        raise LogError(f"robot={word}: there is no such file; give the path of your robot's .yaml, .xml or .urdf.")
    return robot
