"""The file of a calibration, as it is read: which servo each joint has, and where its zero is."""

from __future__ import annotations

import glob
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date, datetime
from pathlib import Path
from typing import Any, Literal

from ...common.atomic import STAMP
from ...common.documents import DocumentError, read_yaml
from ...common.errors import SealegsError
from ...configs.check import Natural, Positive, checked, checked_fields
from ...envs.engine.robot import Robot
from ..bus.registers import ServoModel
from .joints import MAIN, CalibrationError, Joint, Line, line_of, turning_joints

PAIR = "{} is {!r}; it takes two numbers, the lower one first, such as [-1.0, 1.0]."


@dataclass(frozen=True)
class _File:
    robot: str
    joints: dict[str, Any]
    servo: str | None = None
    date: Any = None


@dataclass(frozen=True)
class _Row:
    id: Natural
    zero: int
    direction: Literal[1, -1]
    range: Any
    homing_offset: int | None = None
    per_radian: Positive = 1.0
    servo: str | None = None  # of another bus


def read_joints(path: Path, robot: Robot, servo: ServoModel, lines: Sequence[Line] = ()) -> list[Joint]:
    """Joints from a calibration file.

    Args:
        path: of the file.
        robot: whose it must be.
        servo: model on the first bus.
        lines: buses beside the first one.

    Raises:
        CalibrationError: the file cannot be read, is of another robot or of other servos, or a row is wrong.
    """
    try:
        document = read_yaml(path, "it")
        file = checked_fields("", document, _File)
        if file.robot != robot.name:
            raise CalibrationError(f"{path} is the calibration of robot '{file.robot}', not of '{robot.name}'.")
        rows = {name: checked_fields(f"joints.{name}", row, _Row) for name, row in file.joints.items()}
        joints = [_joint(str(name), row, line_of(str(name), lines)) for name, row in rows.items()]
    except CalibrationError:
        raise
    except DocumentError as error:
        raise CalibrationError(f"the calibration {path} {error.problem}; correct it, or calibrate again.") from None
    except SealegsError as error:
        why = " ".join(str(error).split()).rstrip(".")
        raise CalibrationError(f"{path} is no calibration ({why}); correct it, or calibrate again.") from None
    for joint, row in zip(joints, rows.values(), strict=True):
        said, model = row.servo or (file.servo if joint.line == MAIN else None), joint.line.model(servo)
        if said not in (None, model.name):
            raise CalibrationError(
                f"{path}: joint {joint.name} was calibrated with servo {said} and has {model.name} now, whose steps "
                "may mean other angles: calibrate again, or correct the servo that is wrong."
            )
    limits, wheels = robot.limits, turning_joints(robot)
    return [
        replace(joint, turning=True, low=limits[joint.name][0], high=limits[joint.name][1])
        if joint.name in wheels
        else joint
        for joint in joints
    ]


def _joint(name: str, row: _Row, line: Line) -> Joint:
    where = f"joints.{name}.range"
    low, high = checked(where, row.range, tuple[float, float], PAIR.format(where, row.range))
    if low >= high:
        raise SealegsError(PAIR.format(where, row.range))
    return Joint(
        name,
        id=row.id,
        zero=row.zero,
        direction=row.direction,
        low=low,
        high=high,
        homing_offset=row.homing_offset,
        per_radian=row.per_radian,
        line=line,
    )


# --- which of a robot's calibrations holds: the one made last, as the files say themselves ---------------------------
#
# Times of files on the disk say nothing: a copy, a checkout or a touch would bring back an old zero, on real servos.

FOLDER = Path("calibrations")
LENGTH = len("20260101-000000")
REMEDY = "repair it, move it elsewhere, or give calibration=<file>."


def newest(robot: str, folder: Path = FOLDER) -> Path | None:
    """The latest calibration of a robot; None where there is none.

    Args:
        robot: its name.
        folder: with files ``<robot>-*.yaml``. Whose they are and when they were made, they say themselves; where one
            has no date, the stamp in its name counts.

    Raises:
        CalibrationError: one that may be the latest cannot be read, or does not say when it was made.
    """
    dated: list[tuple[datetime, Path]] = []
    doubted: list[tuple[datetime | None, str]] = []
    undated: list[Path] = []
    for path in sorted(folder.glob(f"{glob.escape(robot)}-*.yaml")):
        try:
            whose, made = _whose_and_when(path)
        except CalibrationError as error:
            made, rest = _stamp(path), path.stem.removeprefix(f"{robot}-")
            if made is None or len(rest) == LENGTH:  # else its name is that of another robot's, <robot>-left
                doubted.append((made, str(error)))
            continue
        if whose != robot:
            continue
        if made is None:
            undated.append(path)
        else:
            dated.append((made, path))
    latest = max(dated, default=None)
    for made, sentence in doubted:
        if made is None or latest is None or made >= latest[0]:
            raise CalibrationError(sentence)
    if undated and len(undated) + len(dated) > 1:
        raise CalibrationError(
            f"{undated[0]} says no date, so which calibration of robot '{robot}' is the newest cannot be told; write "
            "date: <such as 2026-01-31T12:00:00> into it, move it elsewhere, or give calibration=<file>."
        )
    return undated[0] if undated else None if latest is None else latest[1]


def _whose_and_when(path: Path) -> tuple[str, datetime | None]:
    """Robot of a calibration, and when it was made; None: neither the file nor its name says.

    Raises:
        CalibrationError: it cannot be read.
    """
    try:
        document: Any = read_yaml(path)
        if not isinstance(document, dict) or not isinstance(document.get("robot"), str):
            raise ValueError("it does not say whose it is, as robot: <name>")
        said = document.get("date")
        return document["robot"], _stamp(path) if said is None else _time(said)
    except DocumentError as error:
        raise CalibrationError(f"the calibration {path} {error.problem}; {REMEDY}") from None
    except (ValueError, OverflowError) as error:
        raise CalibrationError(f"{path} is no calibration ({' '.join(str(error).split())}); {REMEDY}") from None


def _time(said: Any) -> datetime:
    """A date of a file, which YAML may have read as one; of the local clock where it names no zone.

    Raises:
        ValueError: it is none.
    """
    if isinstance(said, date) and not isinstance(said, datetime):
        said = said.isoformat()
    return (said if isinstance(said, datetime) else datetime.fromisoformat(str(said))).astimezone()


def _stamp(path: Path) -> datetime | None:
    """When a file was made by the end of its name; None: it does not say."""
    try:
        return datetime.strptime(path.stem[-LENGTH:], STAMP).astimezone()
    except ValueError:
        return None
