"""The hidden machines of a checkout's ``testbed/``: written down as their makers publish them, recorded, and run."""

from __future__ import annotations

import importlib
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from ...common.atomic import write_text
from ...common.errors import SealegsError, nearest

ROBOTS = ("bench", "pan_tilt", "leg", "gripper", "arm")
"""Machines of ``testbed/everyday`` that can be drawn."""
REACH = 1.6  # range of the goals either side of the middle, in parts of how far the recorded motion goes; assumed


@dataclass(frozen=True)
class Hidden:
    """One machine.

    Attributes:
        robot: of :data:`ROBOTS`.
        number: which of its machines.
        seed: of the first one.
    """

    robot: str
    number: int
    seed: int

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"{self.robot}-{self.seed + self.number}"


def testbed(part: str) -> Any:
    """A module of the testbed.

    Raises:
        SealegsError: there is none: it comes with a checkout.
    """
    checkout = Path(__file__).resolve().parents[2]
    if (checkout / "testbed").is_dir() and str(checkout) not in sys.path:
        sys.path.append(str(checkout))
    try:
        return importlib.import_module(f"testbed.{part}")
    except ModuleNotFoundError as missing:
        if missing.name not in ("testbed", f"testbed.{part}"):
            raise
        raise SealegsError(
            "the hidden machines come with a checkout, not with an installed sealegs: clone the repository, run make "
            "setup there, and make transfer."
        ) from None


def check_robot(name: str) -> None:
    """Raises:
    SealegsError: there are no machines of that name.
    """
    if name not in ROBOTS:
        raise SealegsError(
            f"there are no hidden machines '{name}'{nearest(name, ROBOTS)}; there are {', '.join(ROBOTS)}."
        )


def case_of(hidden: Hidden) -> Any:
    """The machine with all that it hides (``testbed.everyday.Drawn``)."""
    place = ROBOTS.index(hidden.robot)
    return testbed("everyday").drawn(len(ROBOTS) * hidden.number + place, hidden.seed + hidden.number)


def publish(hidden: Hidden, folder: Path) -> Path:
    """Write the machine as its maker publishes it: model, ranges and the servos that are believed; the robot's file."""
    everyday, machine = testbed("everyday"), case_of(hidden).machine
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "machine.xml", everyday.mjcf(machine), replace=True)
    joints = {
        name: {
            "chain": everyday.nominal_chain(),
            "range": [round(middle - REACH * reach, 6), round(middle + REACH * reach, 6)],
            "start": middle,
        }
        for name, reach, middle in zip(machine.joints, machine.reach, machine.middle, strict=True)
    }
    file = folder / "robot.yaml"
    text = yaml.safe_dump({"model": "machine.xml", "base": "fixed", "joints": joints}, sort_keys=False)
    write_text(file, text, replace=True)
    return file


def recorded(hidden: Hidden, folder: Path) -> Any:
    """Logs of the machine as a hobbyist makes them."""
    recordings, _ = testbed("everyday").record_drawn(case_of(hidden), folder)
    recordings = [one._replace(robot=str(folder / "machine.xml"), robot_params={}) for one in recordings]
    logs = testbed("logs")
    from ...gap.log.types import MeasuredSet

    return MeasuredSet(tuple(map(logs.measured_run, recordings)), hidden.name)


def running(hidden: Hidden, count: int, dt: float, seed: int) -> Any:
    """Copies of the machine that run."""
    return testbed("everyday").Running(case_of(hidden), count, dt, seed)


def hidden_in(hidden: Hidden) -> list[dict[str, Any]]:
    """What a machine hides, what moves its log most first: name, joint, size, rms change of each joint's log [rad]."""
    case = case_of(hidden)
    moved = testbed("everyday.recorded").effect_of_each(case)
    rows = [
        {
            "name": name,
            "joint": "all" if joint < 0 else case.machine.joints[joint],
            "size": size,
            "moves": dict(zip(case.machine.joints, map(float, row), strict=True)),
        }
        for (name, joint, size), row in zip(case.effects, moved, strict=True)
    ]
    return sorted(rows, key=lambda row: -max(row["moves"].values()))
