"""A robot's servos and machine in this process and in simulated time, for a loop that need not wait for a clock."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..bus import ServoBus
from ..registers import ready_at
from ..robot import ServoRobot
from .machine import Machine
from .rig import Rig, mounts
from .simulated_port import SimulatedPort
from .wire import Wire

RATE = 1_000_000  # [bit/s]


def bus_in_process(
    robot: ServoRobot,
    truth: Any = None,
    *,
    hidden: str | None = None,
    pose: Mapping[str, float] | None = None,
    timeout: float = 0.02,
    latency: float = 0.0,
) -> tuple[ServoBus, Rig]:
    """An open bus with the robot's servos, mounted as the host believes, and the rig behind it.

    Args:
        robot: as the host sees it.
        truth: chains that the machine has before ``hidden``; None: those of ``robot``.
        hidden: file of what the machine really is.
        pose: in which a hand holds the robot until ``rig.held`` is None; None: until torque comes on.
        timeout: of the bus [s].
        latency: of the adapter, on every reply and echo [s].

    Raises:
        SealegsError: the machine cannot be built.
    """
    sensors = {sensor.name: abs(sensor.per_radian) for sensor in robot.sensors}
    chains = dict(robot.chains) if truth is None else truth
    machine = Machine(robot.robot, chains, hidden, robot.params, sensors, pose)
    placed: dict[str, dict[str, float]] = {
        j.name: {"id": j.id, "zero": j.zero, "direction": j.direction, "per_radian": j.per_radian} for j in robot.joints
    }
    placed |= {s.name: {"id": s.id, "zero": s.zero, "direction": 1 if s.per_radian > 0 else -1} for s in robot.sensors}
    mounted = mounts(machine.encoders, placed, robot.servo)
    registers = {"": {**ready_at(robot.servo, RATE), **robot.registers}}
    rig = Rig(machine, robot.servo, mounted, "order" if pose else "torque", registers=registers)
    port = SimulatedPort(Wire(rig, []), timeout, latency=latency)
    return ServoBus("simulated", model=robot.servo.name, timeout=timeout, opened=port), rig
