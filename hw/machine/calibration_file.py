"""The file of a calibration, as it is read: which servo each joint has, and where its zero is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

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
