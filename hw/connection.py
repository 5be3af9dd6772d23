"""From ``hw=virtual`` or ``hw=feetech port=...`` to an open bus; nothing behind it knows which."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ..actuators.errors import SealegsError
from .bus import ServoBus
from .packets import ConfigurationError
from .registers import ServoModel
from .robot import Joint, ServoRobot

SHORT = 16  # steps by which a servo may stop short of its joint's range


@dataclass(frozen=True)
class Opened:
    """A port that is there.

    Attributes:
        port: its path.
        let_go: takes away the hand that holds a virtual machine; does nothing on a real one.
    """

    port: str
    let_go: Callable[[], None] = lambda: None


@contextlib.contextmanager
def opened_port(
    hw: Mapping[str, Any],
    port: str | None,
    robot: ServoRobot,
    truth: Any,
    period: float = 0.01,
    params: Mapping[str, float] | None = None,
    pose: Mapping[str, float] | None = None,
) -> Iterator[Opened]:
    """The port to use, and a virtual machine behind it where one is asked for.

    Args:
        hw: of ``configs/hw``.
        port: that the person named.
        robot: as the host sees it; a virtual machine has its servos mounted like that.
        truth: chain of a virtual machine, before what it hides.
        params: numbers of a virtual machine, before what it hides; None: those of ``robot``.
        period: of the loop [s]; a virtual machine in stepped time advances by it in each cycle.
        pose: in which a hand holds a virtual machine until the run begins; None: as it is, until torque comes on.

    Raises:
        SealegsError: no port is named, or the virtual machine does not start.
    """
    if hw["virtual"] is None:
        if port is None:
            raise SealegsError("port=<path> is missing: name the adapter's port, such as port=/dev/ttyUSB0.")
        yield Opened(port)
        return
    if port is not None:
        raise SealegsError(
            "hw=virtual starts a bus of its own; to use one that runs already, give hw=feetech port=<path>."
        )
    from .virtual import VirtualBus

    mounts: dict[str, dict[str, float]] = {
        j.name: {"id": j.id, "zero": j.zero, "direction": j.direction, "per_radian": j.per_radian} for j in robot.joints
    }
    mounts |= {s.name: {"id": s.id, "zero": s.zero, "direction": 1 if s.per_radian > 0 else -1} for s in robot.sensors}
    known = {
        "robot": robot.robot.source,
        "params": robot.params if params is None else dict(params),
        "servos": mounts,
        "model": robot.servo.name,
        "held": "order" if pose else "torque",
        "pose": dict(pose or {}),
        "cycle": period,
        "registers": {**ready_at(robot.servo, int(hw["baudrate"])), **robot.registers},
    }
    if robot.sensors:
        known["sensors"] = {sensor.name: abs(sensor.per_radian) for sensor in robot.sensors}
    if truth is not None:
        known["actuator"] = truth
    with VirtualBus(**{**known, **hw["virtual"]}) as bus:
        yield Opened(bus.port, bus.let_go)


def ready_at(model: ServoModel, baudrate: int) -> dict[str, int]:
    """Registers of virtual servos whose factory settings nobody would work with: another baud rate, slow replies."""
    if model.protocol != "dynamixel":
        return {}
    if baudrate not in model.baud_rates:
        raise SealegsError(f"hw.baudrate is {baudrate}; a {model.name} knows {', '.join(map(str, model.baud_rates))}.")
    return {"baud_rate": model.baud_rates.index(baudrate), "return_delay_time": 0}


def check_joint(bus: ServoBus, joint: Joint) -> None:
    """Make sure that a servo is set up as it was when its joint was calibrated, and can reach the joint's range.

    Raises:
        ConfigurationError: it is not.
    """
    model = bus.model
    calibrated, offset = joint.homing_offset, bus.read_role(joint.id, "homing_offset")
    if calibrated is not None and calibrated != offset:
        raise ConfigurationError(
            f"servo {joint.id} has homing_offset {offset}, and {calibrated} when joint {joint.name} was calibrated: "
            "another program changed it, so the zero is elsewhere now; calibrate again.",
            [joint.id],
        )
    names = [model.role(role) or "" for role in ("min_angle", "max_angle")]
    low, high = (bus.read_register(joint.id, name) for name in names)
    steps = joint.direction / (model.step * joint.per_radian)
    first, last = sorted(round(joint.zero + steps * angle) for angle in (joint.low, joint.high))
    if low == high == 0:
        raise ConfigurationError(
            f"servo {joint.id} counts turns, since its registers {names[0]} and {names[1]} are 0; write 0 and "
            f"{model.steps - 1} (bus.write_register).",
            [joint.id],
        )
    if first < low - SHORT or last > high + SHORT:
        raise ConfigurationError(
            f"servo {joint.id} keeps its goals between the steps {low} and {high}, but joint {joint.name} goes from "
            f"{first} to {last}; widen its registers {names[0]} and {names[1]} (bus.write_register), or calibrate "
            "again.",
            [joint.id],
        )


def opened_bus(hw: Mapping[str, Any], port: str, robot: ServoRobot) -> ServoBus:
    """The bus, with every servo of the robot there and set up.

    Raises:
        BusError: the port cannot be opened, or a servo is missing or set up otherwise.
    """
    watchdog = hw.get("watchdog")
    bus = ServoBus(port, int(hw["baudrate"]), robot.servo.name, float(hw["timeout"]), watchdog=watchdog)
    try:
        bus.check(robot.all_ids)
        for joint in robot.joints:
            check_joint(bus, joint)
    except BaseException:
        bus.close()
        raise
    return bus
