"""Joints and sensors as the host sees them: which servo, where its zero is, which way it counts, how far it goes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...common.errors import SealegsError, nearest
from ...configs.check import Count, checked, checked_fields
from ...envs.described.robot_entries import ServoEntry
from ...envs.described.robot_within import fits, fitting
from ...envs.engine.robot import Robot
from ..bus.interface import Address
from ..bus.registers import ServoModel, load_model
from ..bus.servo_state import ServoState


class CalibrationError(SealegsError):
    """A calibration that is none, or does not fit the robot."""


@dataclass(frozen=True)
class Line:
    """One bus of a robot, on an adapter of its own.

    Attributes:
        name: "" for the first one, which is on the port that port= names.
        number: 0 for the first one.
        servo: model of its servos; None: that of the robot.
        port: path; None: that port= names.
        baudrate: [bit/s]; None: as of the first one.
        joints: and sensors that are on it; all others are on the first one.
    """

    name: str = ""
    number: int = 0
    servo: ServoModel | None = None
    port: str | None = None
    baudrate: int | None = None
    joints: tuple[str, ...] = ()

    def address(self, id: int) -> int:
        """Of a servo on it."""
        return Address(self.number, self.name, id) if self.number else id

    def model(self, otherwise: ServoModel) -> ServoModel:
        """Of its servos."""
        return otherwise if self.servo is None else self.servo


MAIN = Line()


def table(config: Mapping[str, Any], key: str) -> dict[str, Any]:
    """A table of a robot's file, such as ``buses``, by name; empty where it is left out.

    Raises:
        SealegsError: it is none.
    """
    return checked(f"robot.{key}", config.get(key) or {}, dict[str, Any])


@dataclass(frozen=True)
class _Bus:
    servo: str
    joints: list[Any]
    port: str | None = None
    baudrate: Count | None = None


def read_lines(config: Mapping[str, Any], names: Sequence[str]) -> tuple[Line, ...]:
    """``buses`` of a robot's file: adapters beside the first one.

    Args:
        config: by name of the bus: servo, port, baudrate, joints.
        names: of the robot's joints and sensors.

    Raises:
        SealegsError: a bus lacks its servos or its joints, has a key or a value that is none, or a joint is unknown or
            on two of them.
    """
    found: list[Line] = []
    taken: dict[str, str] = {}
    for number, (name, row) in enumerate(config.items(), 1):
        bus = checked_fields(f"robot.buses.{name}", row, _Bus)
        joints = tuple(str(joint) for joint in bus.joints)
        for joint in joints:
            if joint not in names:
                raise CalibrationError(f"robot.buses.{name}: there is no joint '{joint}'{nearest(joint, names)}.")
            if joint in taken:
                raise CalibrationError(f"joint {joint} is on the buses {taken[joint]} and {name}; name it once.")
            taken[joint] = str(name)
        found.append(Line(str(name), number, load_model(bus.servo), bus.port, bus.baudrate, joints))
    return tuple(found)


def line_of(name: str, lines: Sequence[Line]) -> Line:
    """The bus that a joint or sensor is on."""
    return next((line for line in lines if name in line.joints), MAIN)


@dataclass(frozen=True)
class Joint:
    """One joint and its servo.

    Attributes:
        name: as in the robot.
        id: of the servo.
        zero: step of the encoder at which the joint is at 0 rad.
        direction: 1 where growing steps are the joint's positive direction, -1 where they are its negative one.
        low, high: range of the joint [rad].
        homing_offset: of the servo as it was calibrated [step], which shifts its steps; None: not known.
        per_radian: how far the joint moves per radian of the servo's shaft, behind a gear or a screw [rad or m].
        line: the bus that its servo is on.
        turning: whether its goals are speeds: it is a wheel, and its range is of these [rad/s].
    """

    name: str
    id: int
    zero: int
    direction: int
    low: float
    high: float
    homing_offset: int | None = None
    per_radian: float = 1.0
    line: Line = MAIN
    turning: bool = False

    @property
    def address(self) -> int:
        """Of its servo, among all buses of the robot."""
        return self.line.address(self.id)


@dataclass(frozen=True)
class Sensor:
    """An encoder on the bus that drives nothing: a servo without torque, or a board that speaks like one.

    Attributes:
        name: ``<joint>.link`` for the far side of a joint's spring, or a quantity of the base such as ``base_z`` or
            ``body.pitch`` (:mod:`sealegs.envs.engine.base`).
        id: on the bus.
        zero: step at which what it measures is 0.
        per_radian: how far what it measures moves per radian of its own, with its sign [rad or m].
        line: the bus that it is on.
    """

    name: str
    id: int
    zero: int
    per_radian: float
    line: Line = MAIN

    @property
    def address(self) -> int:
        """Of its encoder, among all buses of the robot."""
        return self.line.address(self.id)


def check_joints(
    joints: Sequence[Joint], robot: Robot, servo: ServoModel, params: Mapping[str, float], port: str | None = None
) -> None:
    """Refuse joints that cannot be.

    Args:
        joints: of the robot.
        robot: that has them.
        servo: model on the first bus.
        params: numbers of the robot other than its own.
        port: path of the first bus; None: not known.

    Raises:
        CalibrationError: a joint is missing, unknown or doubled, two have one id, or a range cannot be reached.
    """
    wanted = [item.name for item in robot.coordinates]
    for joint in joints:
        if joint.name not in wanted:
            raise CalibrationError(f"robot '{robot.name}' has no joint '{joint.name}'{nearest(joint.name, wanted)}.")
    if (missing := [name for name in wanted if name not in [joint.name for joint in joints]]) or [
        joint.name for joint in joints
    ] != wanted:
        raise CalibrationError(
            f"robot '{robot.name}' has the joints {', '.join(wanted)}; "
            + (f"{', '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing." if missing else "order them so.")
        )
    users: dict[int, str] = {}
    limits = robot.goal_limits(robot.parameters(params))
    for joint in joints:
        model, unit = joint.line.model(servo), robot.unit(joint.name)
        if not 0 <= joint.id <= model.high_id:
            raise CalibrationError(f"joint {joint.name} has the id {joint.id}; ids are 0 to {model.high_id}.")
        if joint.address in users:
            raise CalibrationError(
                f"joints {users[joint.address]} and {joint.name} both have the servo with id {joint.address}; "
                "give each servo an id of its own (sealegs scan id=... new_id=...)."
            )
        users[joint.address] = joint.name
        if joint.direction not in (-1, 1):
            raise CalibrationError(f"joint {joint.name} has the direction {joint.direction}; it is 1 or -1.")
        if not (math.isfinite(joint.low) and math.isfinite(joint.high) and joint.low < joint.high):
            raise CalibrationError(
                f"joint {joint.name} has the range {joint.low} to {joint.high} {unit}, which is none."
            )
        if joint.turning:
            continue
        _check_reach(joint, model, unit, joint.line.port if joint.line.name else port)
        low, high = limits[joint.name]
        if joint.high <= low or joint.low >= high:
            raise CalibrationError(
                f"joint {joint.name} has the range {joint.low:.2f} to {joint.high:.2f} {unit}, but robot "
                f"'{robot.name}' works between {low:.2f} and {high:.2f} {unit}; zero or direction is wrong: "
                "calibrate it again."
            )


def _check_reach(joint: Joint, model: ServoModel, unit: str, port: str | None) -> None:
    """Refuse a range that leaves the turn of the joint's encoder."""
    scale = joint.direction / (joint.per_radian * model.step)
    places = [joint.zero + scale * angle for angle in (joint.low, joint.high)]
    if (wide := abs(places[1] - places[0])) > model.steps:
        raise CalibrationError(
            f"joint {joint.name} goes from {joint.low:.2f} to {joint.high:.2f} {unit}, {wide / model.resolution:.2f} "
            f"turns of its servo, of which it has {model.steps / model.resolution:.3g} in position mode; give a "
            "smaller range, or a gear."
        )
    for angle, place in zip((joint.low, joint.high), places, strict=True):
        if not -0.5 <= place <= model.steps - 0.5:
            raise CalibrationError(
                f"joint {joint.name} cannot reach {angle:.3f} {unit}: its encoder ends at step 0 and "
                f"{model.steps - 1}, and that is step {place:.0f}; "
                f"{homing(model, joint.id, sum(places) / 2.0, joint.homing_offset, port)}mount the horn so that the "
                "range keeps clear of the encoder's seam, and calibrate again, or give a smaller range."
            )


def homing(model: ServoModel, servo: int, middle: float, offset: int | None, port: str | None) -> str:
    """The beginning of a sentence about a range over the seam: what moves the seam opposite to its ``middle`` [step].

    Args:
        model: of the servo.
        servo: id.
        middle: of the range, as the servo counts; over the seam it goes on.
        offset: homing offset with which it counts so; None: not known.
        port: path of its bus; None: not known.
    """
    count = None if offset is None else model.centring(middle, offset)
    if count is None:
        return ""
    setting = model.setting(servo, {model.role("homing_offset") or "": count}, port or "<path>")
    return f"move the seam away ({setting}), or "


def nominal_joints(
    robot: Robot,
    servo: ServoModel,
    params: Mapping[str, float],
    gears: Mapping[str, float] | None = None,
    lines: Sequence[Line] = (),
) -> list[Joint]:
    """Joints of a machine built as drawn, or as the robot's file says.

    As drawn: ids 1, 2, ... on each bus, zero at the encoder's centre, range of the robot's goals.

    Args:
        robot: that has them.
        servo: on each, but for those on other buses.
        params: numbers of the robot other than its own.
        gears: how far a joint moves per radian of its servo, by pattern of names; 1 where none fits. The middle of
            such a joint's range is at the encoder's centre, unless the robot's file says where its zero is.
        lines: buses beside the first one.
    """
    limits = robot.goal_limits(robot.parameters(params))
    said = {} if robot.file is None else {item.name: item.servo for item in robot.file.joints}
    numbers: dict[str, int] = {}
    found = []
    for item in robot.coordinates:
        line = line_of(item.name, lines)
        model = line.model(servo)
        number = numbers[line.name] = numbers.get(line.name, 0) + 1
        mounted, goals = said.get(item.name) or ServoEntry(number), limits[item.name]
        gear = gear_of(item.name, gears or {})
        scale = mounted.direction * (1.0 if gear is None else gear) * model.step
        zero = model.centre if gear is None else round(model.centre - 0.5 * (goals[0] + goals[1]) / scale)
        zero = zero if mounted.zero is None else mounted.zero
        low, high = sorted(scale * (at - zero) for at in (0, model.steps - 1))
        turning = item.name in turning_joints(robot)
        low, high = goals if turning else (max(goals[0], low), min(goals[1], high))
        per_radian = abs(scale) / model.step
        found.append(
            Joint(
                item.name,
                id=mounted.id,
                zero=zero,
                direction=mounted.direction,
                low=low,
                high=high,
                homing_offset=None,
                per_radian=per_radian,
                line=line,
                turning=turning,
            )
        )
    return found


def turning_joints(robot: Robot) -> frozenset[str]:
    """Joints of a robot's file whose goals are speeds: its wheels."""
    return frozenset(() if robot.file is None else (item.name for item in robot.file.joints if item.by_speed))


@dataclass(frozen=True)
class _SensorEntry:
    id: int
    zero: int | None = None
    per_radian: float = 1.0


def read_sensors(
    config: Mapping[str, Any],
    joints: Sequence[Joint],
    servo: ServoModel,
    lines: Sequence[Line] = (),
    quantities: Sequence[str] = (),
) -> list[Sensor]:
    """Sensors of a robot's file.

    Args:
        config: ``sensors``, by name.
        joints: of the robot.
        servo: model on the first bus.
        lines: buses beside the first one.
        quantities: of the robot's base, as :mod:`sealegs.envs.engine.base` names them.

    Raises:
        CalibrationError: one measures nothing that there is, has the id of a joint or of another one, lacks something,
            or has a key or a value that is none.
    """
    found: list[Sensor] = []
    users = {joint.address: joint.name for joint in joints}
    known = [*(f"{joint.name}.link" for joint in joints), *quantities]
    for name, row in config.items():
        where, line = f"robot.sensors.{name}", line_of(str(name), lines)
        if str(name) not in known:
            raise CalibrationError(
                f"{where} measures nothing of this robot{nearest(str(name), known)}; there are {', '.join(known)}."
            )
        if not isinstance(row, Mapping) or (row.keys() <= {"zero", "per_radian"}):
            raise CalibrationError(f"{where} is {row!r}; it needs an id, and takes zero, per_radian.")
        if "direction" in row:
            raise CalibrationError(
                f"{where}.direction is unknown: an encoder that counts the other way has a negative per_radian, such "
                "as per_radian: -1."
            )
        try:
            entry = checked_fields(where, dict(row), _SensorEntry)
        except SealegsError as error:
            raise CalibrationError(str(error)) from None
        model = line.model(servo)
        if not 0 <= entry.id <= model.high_id:
            raise CalibrationError(f"{where}.id is {entry.id}; ids are 0 to {model.high_id}.")
        zero = model.centre if entry.zero is None else entry.zero
        sensor = Sensor(str(name), entry.id, zero, entry.per_radian, line)
        if sensor.address in users:
            raise CalibrationError(
                f"sensor {name} has the id {sensor.address}, and so has {users[sensor.address]}; ids are unique."
            )
        if sensor.per_radian == 0.0:
            raise CalibrationError(f"{where}.per_radian is 0; it must be another number.")
        users[sensor.address] = sensor.name
        found.append(sensor)
    return found


def checked_gears(gears: Mapping[str, Any], robot: Robot) -> dict[str, float]:
    """``gears`` of a robot's file: how far joints move per radian of their servos, by pattern of names.

    Raises:
        CalibrationError: a pattern fits no joint, or a value is none.
    """
    names = [item.name for item in robot.coordinates]
    found = {str(key): checked(f"robot.gears.{key}", value, float) for key, value in gears.items()}
    for key, value in found.items():
        if not any(fitting(names, key)):
            raise CalibrationError(f"robot.gears.{key} fits no joint of '{robot.name}'; it has {', '.join(names)}.")
        if value <= 0.0:
            raise CalibrationError(f"robot.gears.{key} is {value:g}; it must be above 0.")
    return found


def gear_of(name: str, gears: Mapping[str, float]) -> float | None:
    """How far a joint moves per radian of its servo [rad or m], from ``gears`` of a robot's file; None: not said."""
    return next((value for key, value in gears.items() if fits(name, key)), None)


def check_gears(joints: Sequence[Joint], gears: Mapping[str, float], path: Path) -> None:
    """Refuse joints that were calibrated behind other gears than the robot's file names.

    Args:
        joints: as calibrated.
        gears: of the robot's file.
        path: of the calibration.

    Raises:
        CalibrationError: one was; its goals and all its limits would be in wrong units.
    """
    for joint in joints:
        said = gear_of(joint.name, gears) or 1.0
        if not math.isclose(joint.per_radian, said, rel_tol=1e-6):
            raise CalibrationError(
                f"joint {joint.name} moves {joint.per_radian:g} per radian of its servo in {path}, and {said:g} by "
                "robot.gears: calibrate it again, or correct the one that is wrong."
            )


# --- one reading of a robot's servos, as angles of its joints --------------------------------------------------------


@dataclass(frozen=True)
class BaseTurn:
    """How the base of a robot turns.

    Attributes:
        time: clock of the host as the sample came [s].
        orientation: of the base in a world whose z axis points up, a quaternion, w first (4,).
        turn_rate: about the axes of the base (3,) [rad/s].
        fresh: whether the reading before had an older sample.
        switches: 1 where a contact switch is closed, else 0 (s,).
    """

    time: float
    orientation: np.ndarray
    turn_rate: np.ndarray
    fresh: bool = True
    switches: np.ndarray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class Reading:
    """One reading of all joints, in the order of the robot.

    Attributes:
        before: host's monotonic clock as the request went out [s].
        after: the same once all replies had come in [s].
        position: (k,) [rad].
        velocity: (k,) [rad/s].
        duty: (k,), 1 = full.
        current: (k,) [A].
        voltage: (k,) [V].
        temperature: (k,) [degC].
        link: position on the far side of a series spring (k,) [rad]; where nothing measures it, ``position``.
        base_position, base_velocity: of the robot's base, as far as it is measured (b,) [m or rad], per second.
        state: as the bus gave it; None in simulation.
        imu: how the base turns, as its IMU says; None: it has none, or that has said nothing yet.
        taken: when each servo and sensor of the robot was read last (n,) [s], before ``time`` where a reply is missing;
            None: all of them at ``time``.
    """

    before: float
    after: float
    position: np.ndarray
    velocity: np.ndarray
    duty: np.ndarray
    current: np.ndarray
    voltage: np.ndarray
    temperature: np.ndarray
    link: np.ndarray
    base_position: np.ndarray
    base_velocity: np.ndarray
    state: ServoState | None
    taken: np.ndarray | None = None
    imu: BaseTurn | None = None

    @property
    def time(self) -> float:
        """Middle of the transaction [s]: when the servos looked at their sensors, as well as the host can tell."""
        return 0.5 * (self.before + self.after)
