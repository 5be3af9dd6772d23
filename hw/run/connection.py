"""From ``hw=virtual`` or ``hw=feetech port=...`` to an open bus; nothing behind it knows which."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any

from annotated_types import Gt, Le

from ...common.errors import SealegsError
from ...configs.check import Count, checked
from ..bus.adapters import Whereabouts
from ..bus.buses import BusGroup
from ..bus.imu import ImuSource
from ..bus.imu_chips import checked_part, open_imu
from ..bus.interface import Bus
from ..bus.packets import ConfigurationError
from ..bus.port import BusPort
from ..bus.registers import ready_at
from ..bus.servo_bus import ServoBus
from ..guard.supervisor import Bearable, Charge, Opening, Rest
from ..machine.limits import Limits
from ..machine.robot import Joint, ServoRobot

WATCHED_CYCLES = 3  # without a request, at least, before servos with a bus watchdog stop by themselves
LONGEST = 10.0  # [s] that a reply may take


def checked_hw(hw: Mapping[str, Any]) -> dict[str, Any]:
    """``configs/hw`` with the baud rate and the time for a reply as numbers.

    Raises:
        SealegsError: one is none.
    """
    timeout = checked("hw.timeout", hw["timeout"], Annotated[float, Gt(0.0), Le(LONGEST)])
    return {**hw, "baudrate": checked("hw.baudrate", hw["baudrate"], Count), "timeout": timeout}


@dataclass(frozen=True)
class Opened:
    """Ports that are there.

    Attributes:
        ports: their paths, by name of the bus.
        let_go: takes away the hand that holds a virtual machine; does nothing on a real one.
        imu: opens the robot's IMU; None: it has none.
        within: in stepped time the ports to servos in this process, which end with it, whatever ends it; empty: none.
    """

    ports: Mapping[str, str]
    let_go: Callable[[], None] = lambda: None
    imu: Callable[[], ImuSource] | None = None
    within: Mapping[str, BusPort] = field(default_factory=dict)


@contextlib.contextmanager
def opened_port(
    hw: Mapping[str, Any],
    port: str | None,
    robot: ServoRobot,
    truth: Any,
    params: Mapping[str, float] | None = None,
    pose: Mapping[str, float] | None = None,
) -> Iterator[Opened]:
    """The ports to use, and a virtual machine behind them where one is asked for.

    Args:
        hw: of ``configs/hw``, checked.
        port: that the person named.
        robot: as the host sees it; a virtual machine has its servos mounted like that.
        truth: chain of a virtual machine, before what it hides.
        params: numbers of a virtual machine, before what it hides; None: those of ``robot``.
        pose: in which a hand holds a virtual machine until the run begins; None: as it is, until torque comes on.

    Raises:
        SealegsError: no port is named, or the virtual machine does not start.
    """
    switches = [] if robot.imu is None else [switch.name for switch in robot.imu.switches]
    if hw["virtual"] is None:
        ports = {line.name: line.port if line.name else port for line in robot.lines}
        for name, path in ports.items():
            if path is None:
                key = f"robot.buses.{name}.port" if name else "port"
                raise SealegsError(f"{key}=<path> is missing: name the adapter's port, such as {key}=/dev/ttyUSB0.")
        imu = None
        if robot.imu is not None:
            checked_part(robot.imu.part, switches)
            imu = partial(open_imu, robot.imu.part, robot.imu.rate, switches)
        yield Opened({name: str(path) for name, path in ports.items()}, imu=imu)
        return
    if port is not None:
        raise SealegsError(
            "hw=virtual starts a bus of its own; to use one that runs already, give hw=feetech port=<path>."
        )
    from ...configs.compose import compose, split
    from ..virtual import VirtualBus
    from ..virtual.control import words
    from ..virtual.imu import FetchedImu
    from ..virtual.in_process import PLAIN, ports_of

    mounts: dict[str, dict[str, Any]] = {
        j.name: {"id": j.id, "zero": j.zero, "direction": j.direction, "per_radian": j.per_radian} for j in robot.joints
    }
    mounts |= {s.name: {"id": s.id, "zero": s.zero, "direction": 1 if s.per_radian > 0 else -1} for s in robot.sensors}
    for item in (*robot.joints, *robot.sensors):
        if item.line.name:
            mounts[item.name]["bus"] = item.line.name
    others = {line.name: line.model(robot.servo) for line in robot.lines if line.name}
    known = {
        "robot": robot.robot.source,
        "params": robot.params if params is None else dict(params),
        "servos": mounts,
        "model": robot.servo.name,
        "held": "order" if pose else "torque",
        "pose": dict(pose or {}),
        "registers": {**ready_at(robot.servo, hw["baudrate"]), **robot.registers},
        "buses": {name: model.name for name, model in others.items()},
        "bus_registers": {
            line.name: ready_at(others[line.name], line.baudrate or hw["baudrate"]) for line in robot.lines if line.name
        },
    }
    if robot.sensors:
        known["sensors"] = {sensor.name: abs(sensor.per_radian) for sensor in robot.sensors}
    if robot.imu is not None:
        known["imu"] = dict(robot.imu.said)
    if truth is not None:
        known["actuator"] = truth
    known |= hw["virtual"]
    if known.get("time") == "stepped":
        rates = {line.name: line.baudrate or hw["baudrate"] for line in robot.lines} | {"": hw["baudrate"]}
        ports = ports_of(compose("virtual", split(words(known), PLAIN)), rates, hw["timeout"])
        rig = ports[""].wire.rig
        used = {line.name: ports[line.name] for line in robot.lines}
        paths = {name: port.port_name for name, port in used.items()}
        there = rig.machine.imu
        imu = None if there is None else partial(FetchedImu, there, ports[""].now)
        yield Opened(paths, partial(setattr, rig, "held", None), imu, used)
        return
    with VirtualBus(**known) as bus:
        imu = None
        if robot.imu is not None:
            imu = partial(open_imu, {"name": "serial", "port": bus.imu_port}, robot.imu.rate, switches)
        yield Opened({line.name: bus.ports[line.name] for line in robot.lines}, bus.let_go, imu)


@contextlib.contextmanager
def opened_imu(opened: Opened) -> Iterator[ImuSource | None]:
    """The IMU, read from now on; None: the robot has none.

    Raises:
        SealegsError: it cannot be read.
    """
    source = None if opened.imu is None else opened.imu()
    try:
        yield source
    finally:
        if source is not None:
            source.close()


def check_joint(bus: ServoBus, joint: Joint) -> None:
    """Make sure that a servo is set up as it was when its joint was calibrated, and can reach the joint's range.

    Raises:
        ConfigurationError: it is not.
    """
    for error in bus.unfit(joint.id, turning=joint.turning):
        raise error
    if joint.turning:  # it has no place that it must reach
        return
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
    ends = (round(joint.zero + steps * angle) for angle in (joint.low, joint.high))
    first, last = sorted(min(max(end, 0), model.steps - 1) for end in ends)  # as goals are clipped
    if first < low - model.stops_short or last > high + model.stops_short:
        wider = model.setting(joint.id, dict(zip(names, (min(low, first), max(high, last)), strict=True)), bus.port)
        raise ConfigurationError(
            f"servo {joint.id} keeps its goals between the steps {low} and {high}, but joint {joint.name} goes from "
            f"{first} to {last}; widen its registers {names[0]} and {names[1]} ({wider}), or calibrate again.",
            [joint.id],
        )


def openings(
    hw: Mapping[str, Any], ports: Mapping[str, str] | Mapping[str, BusPort], robot: ServoRobot
) -> dict[str, Opening]:
    """How to open each bus of a robot, by its name; ``hw`` is checked."""
    found = {}
    for line in robot.lines:
        port, rate, servo = ports[line.name], line.baudrate or hw["baudrate"], line.model(robot.servo).name
        path, opened = (port, None) if isinstance(port, str) else (port.port_name, lambda _, port=port: port)
        found[line.name] = Opening(path, rate, servo, hw["timeout"], opened=opened)
    return found


def bus_watchdog(hw: Mapping[str, Any], period: float) -> float | None:
    """Time without a request after which servos that can do so stop by themselves [s]; None: never.

    Args:
        hw: of ``configs/hw``.
        period: of the loop [s].

    Raises:
        SealegsError: it is none.
    """
    seconds = checked("hw.watchdog", hw["watchdog"], float | None)
    if seconds is not None and seconds <= 0.0:
        raise SealegsError(f"hw.watchdog is {seconds:g} s; it must be above 0, or null: never.")
    return None if seconds is None else max(seconds, WATCHED_CYCLES * period)


def opened_bus(
    hw: Mapping[str, Any], ports: Mapping[str, str] | Mapping[str, BusPort], robot: ServoRobot, period: float
) -> Bus:
    """The bus, or several as one, with every servo of the robot there and set up.

    Args:
        hw: of ``configs/hw``.
        ports: by name of the bus: paths, or ports that are open.
        robot: on them.
        period: of the loop [s].

    Raises:
        BusError: a port cannot be opened, or a servo is missing or set up otherwise.
    """
    watchdog = bus_watchdog(hw, period)
    parts: dict[str, ServoBus] = {}
    try:
        for name, opening in openings(hw, ports, robot).items():
            parts[name] = opening()
            parts[name].watchdog = watchdog
        alone = set(parts) == {""}
        within = any(isinstance(port, BusPort) for port in ports.values())  # one clock, which passes with each word
        numbers = {line.name: line.number for line in robot.lines}
        bus = parts[""] if alone else BusGroup(parts, numbers, parallel=not within)
        bus.check(robot.all_ids, robot.turning_ids)
        for joint in robot.joints:
            check_joint(parts[joint.line.name], joint)
    except BaseException:
        for part in parts.values():
            part.close()
        raise
    return bus


def charge_of(
    config: Mapping[str, Any], ports: Mapping[str, str], robot: ServoRobot, rest: Rest, events: str, limits: Limits
) -> Charge:
    """What the supervisor of a run must know.

    Args:
        config: of ``configs/deploy.yaml``.
        ports: by name of the bus.
        robot: on them.
        rest: what becomes of the servos.
        events: file for events.
        limits: of the run.
    """
    ids = {line.name: [joint.id for joint in robot.joints if joint.line == line] for line in robot.lines}
    opening = openings(config["hw"], ports, robot)
    first = opening.get("", next(iter(opening.values())))
    others = [
        {"bus": name, "port": item.port, "baudrate": item.baudrate, "servo": item.servo, "ids": ids[name]}
        for name, item in opening.items()
        if name and ids[name]
    ]
    homes = {name: Whereabouts.of(item.port) for name, item in opening.items()}
    return Charge(
        first.port, baudrate=first.baudrate, servo=first.servo, timeout=first.timeout, ids=ids.get("", []), rest=rest,
        silence=config["silence"], loop=os.getpid(), events=events, patience=config["patience"], others=others,
        lasting=config["hw"]["virtual"] is None,
        bearable=Bearable(limits.temperature, limits.current, limits.current_time), homes=homes,
    )  # fmt: skip
