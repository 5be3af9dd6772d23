"""Servos on a machine: carries both to any time together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from ...common.errors import SealegsError, nearest
from ..bus.registers import ServoModel
from .dynamixel import DynamixelServo
from .firmware import OFF, TICK
from .machine import SHORTEST_STEP, Machine
from .servo import Servo

Held = Literal["torque", "order"]
PROFILE_STEP = 0.001  # [s] between two moves of a set-point that is on its way; assumed


@dataclass(frozen=True)
class Mount:
    """How a servo sits on its joint.

    Attributes:
        id: of the servo.
        zero: step at which the joint is at 0 rad.
        direction: +1 where growing steps turn the joint in its positive sense, else -1.
        bus: name of the line that it is on; "": the first.
        per_radian: how far the joint moves per radian of the servo's shaft [rad or m].
    """

    id: int
    zero: int
    direction: int = 1
    bus: str = ""
    per_radian: float = 1.0


def mounts(
    joints: list[str],
    given: Mapping[str, Any] | None,
    model: ServoModel,
    others: Mapping[str, ServoModel] | None = None,
) -> list[Mount]:
    """A mount for each joint: ids from 1 in the order of joints, zero at the centre, unless ``given`` by joint.

    Args:
        joints: by name.
        given: id, zero, direction and bus by joint.
        model: of the servos on the first line.
        others: models on further lines, by their names.

    Raises:
        SealegsError: a joint that the robot does not have, or a key or value that a mount cannot take.
    """
    found = {name: Mount(number, model.centre) for number, name in enumerate(joints, 1)}
    for name, row in (given or {}).items():
        if name not in found:
            raise SealegsError(f"servos: there is no joint '{name}'{nearest(str(name), joints)}; there are {joints}.")
        if not isinstance(row, Mapping) or set(row) - {"id", "zero", "direction", "bus", "per_radian"}:
            raise SealegsError(f"servos: '{name}' takes id, zero, direction, bus and per_radian, not {row!r}.")
        bus = str(row.get("bus") or "")
        if bus and bus not in (others or {}):
            raise SealegsError(f"servos: '{name}' is on bus '{bus}'{nearest(bus, others or {})}, which there is not.")
        centre = (others or {}).get(bus, model).centre
        mount = replace(found[name], **{"zero": centre, **{str(key): value for key, value in row.items()}, "bus": bus})
        if not all(isinstance(value, int) for value in (mount.id, mount.zero, mount.direction)):
            raise SealegsError(f"servos: '{name}' takes whole numbers, not {row!r}.")
        if not isinstance(mount.per_radian, int | float) or not mount.per_radian > 0.0:
            raise SealegsError(f"servos: '{name}' needs a per_radian above 0, not {row!r}.")
        if not 0 <= mount.id <= 253 or mount.direction not in (-1, 1):
            raise SealegsError(f"servos: '{name}' needs an id from 0 to 253 and a direction of 1 or -1, not {row!r}.")
        found[name] = mount
    return list(found.values())


class Rig:
    """A machine and the servos on it.

    Attributes:
        machine: the simulated robot.
        servos: one per joint, in their order.
        mounts: of the servos.
        volts: supply voltage that a fault forces on each servo [V]; None: the chain's.
        held: whether a hand holds the robot still: not at all (None), until a servo's torque is first switched on
            ("torque"), or until it lets go ("order").
        history: (time [s], id, torque on) whenever a servo's torque was switched.
    """

    def __init__(
        self,
        machine: Machine,
        model: ServoModel,
        mounted: list[Mount],
        held: Held | None = None,
        others: Mapping[str, ServoModel] | None = None,
        registers: Mapping[str, Mapping[str, int]] | None = None,
    ) -> None:
        """Mount servos.

        Args:
            machine: the simulated robot.
            model: of the servos on the first line.
            mounted: one per joint and encoder.
            held: how long a hand holds the robot still.
            others: models on further lines, by their names.
            registers: counts that somebody set for good, by name of the line.
        """
        self.held = held
        self.machine, self.mounts = machine, mounted
        self.models = {"": model, **(others or {})}
        self.servos = [self._servo(mount, joint) for joint, mount in enumerate(mounted)]
        self.volts: list[float | None] = [None] * len(mounted)
        self.history: list[tuple[float, int, bool]] = []
        self.since = [0.0] * len(mounted)
        self._on = [False] * len(mounted)
        self._next_tick = TICK
        self.sense()
        for servo in self.servos:
            servo.allow_voltage(servo.sensors.voltage)
            if machine.by_speed(servo.joint):
                servo.turn_wheel()
            for name, count in (registers or {}).get(servo.bus, {}).items():
                servo.model[name].encode(count)
                servo.set_up(name, count)
            servo.boot(0.0, 0.0)
            servo.target = float(servo.sensors.steps)
        self.apply()

    def _servo(self, mount: Mount, joint: int) -> Servo | DynamixelServo:
        model = self.models[mount.bus]
        kind = DynamixelServo if model.protocol == "dynamixel" else Servo
        return kind(model, mount.id, joint, mount.bus)

    @property
    def time(self) -> float:
        """Of the machine [s]."""
        return self.machine.time

    def advance(self, time: float) -> None:
        """Carry machine and firmware to ``time`` [s]; earlier times do nothing."""
        while time - self.machine.time > SHORTEST_STEP:
            now = self.machine.time
            end = min(time, self._next_tick)
            if self.machine.imu is not None:
                end = min(end, max(self.machine.imu.next_at, now))
            moving = [servo for servo in self.servos if servo.in_profile]
            if moving:
                end = min(end, now + PROFILE_STEP)
                for servo in moving:
                    servo.move_target(end - now)
                    self._steer(servo)
            if self.held == "torque" and any(self._on):
                self.held = None
            if self.held is not None:
                self.machine.data.time = end
            else:
                self.machine.advance(end)
            while self.machine.imu is not None and self.machine.imu.next_at <= end + SHORTEST_STEP:
                self.machine.imu.take()
            if end >= self._next_tick - 1e-9:
                self._next_tick += TICK
                self.sense()
                for servo in self.servos:
                    servo.tick(end, self.machine.resistance(servo.joint))
                self.apply()

    def sense(self) -> None:
        """Bring all servos' sensors up to date."""
        machine = self.machine
        for servo in self.servos:
            joint = servo.joint
            sensors, direction = servo.sensors, self.mounts[joint].direction
            sensors.steps = self.steps(joint, machine.reading(joint)) if servo.frozen is None else servo.frozen
            sensors.duty = direction * machine.duty(joint)
            sensors.current = direction * machine.current(joint)
            sensors.voltage = machine.voltage(joint)

    def apply(self) -> None:
        """Hand the servos' goals and limits to the machine; after every request that may have changed them."""
        for servo in self.servos:
            drive = servo.drive(self.volts[servo.joint])
            self._steer(servo)
            self.machine.set_drive(servo.joint, drive)
            on = servo.get("torque_enable") != OFF and drive.connected
            if on != self._on[servo.joint]:
                self._on[servo.joint], self.since[servo.joint] = on, self.time
                self.history.append((self.time, servo.id, on))

    def torque(self, joint: int) -> bool:
        """Whether the servo of a joint drives it."""
        return self._on[joint]

    def _steer(self, servo: Servo | DynamixelServo) -> None:
        mount = self.mounts[servo.joint]
        if self.machine.by_speed(servo.joint):
            speed = mount.direction * mount.per_radian * servo.speed * servo.model.step
            self.machine.set_goal(servo.joint, speed)
            return
        goal = servo.goal_steps()
        if servo.frozen is not None:  # its loop sees the error to where the sensor is stuck
            goal += self.steps(servo.joint, self.machine.reading(servo.joint)) - servo.frozen
        angle = mount.direction * mount.per_radian * (goal - mount.zero) * servo.model.step
        self.machine.set_goal(servo.joint, angle)

    def steps(self, joint: int, angle: float) -> int:
        """Step of the servo's encoder at a position of its joint [rad or m], turns counted."""
        mount = self.mounts[joint]
        return round(mount.zero + mount.direction * angle / (mount.per_radian * self.models[mount.bus].step))
