"""Virtual servos without a process: asked directly, or served by a thread of the test in stepped time."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from sealegs.envs.robots import get_robot
from sealegs.hw.bus.registers import load_model
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.virtual import protocol
from sealegs.hw.virtual.in_process import SimulatedPort
from sealegs.hw.virtual.machine import Machine
from sealegs.hw.virtual.protocol import Request
from sealegs.hw.virtual.rig import Rig, mounts
from sealegs.hw.virtual.server import Server
from sealegs.hw.virtual.wire import Wire, fault_from

STS = load_model("sts3215")
STEP = 2.0 * math.pi / STS.resolution  # [rad]
RATE = 1_000_000  # [bit/s]


def wired(robot: str = "bench", servos=None, hidden=None, actuator=None, params=None) -> Wire:
    machine = Machine(get_robot(robot), actuator, hidden, params)
    return Wire(Rig(machine, STS, mounts(machine.names, servos, STS)))


def ask(wire: Wire, target: int, instruction: int, *parameters: int) -> list[bytes]:
    """Replies to one request, sent as soon as the line is free."""
    request = Request(target, instruction, bytes(parameters), 6 + len(parameters))
    return [packet for _, packet in wire.exchange(request, wire.rig.time, RATE)]


def write(wire: Wire, name: str, count: int, servo: int = 1) -> list[bytes]:
    register = STS[name]
    return ask(wire, servo, protocol.WRITE, register.address, *register.to_bytes(count))


def read(wire: Wire, name: str, servo: int = 1) -> int:
    register = STS[name]
    (packet,) = ask(wire, servo, protocol.READ, register.address, register.bytes)
    return register.read(packet[5:-1], register.address)


def switch_on(wire: Wire, servo: int = 1) -> None:
    write(wire, "goal_position", read(wire, "present_position", servo), servo)
    write(wire, "torque_enable", 1, servo)


def wait(wire: Wire, seconds: float) -> None:
    end = wire.rig.time + seconds
    while wire.rig.time < end - 1e-6:
        wire.apply_faults(wire.rig.time)
        wire.rig.advance(min(wire.rig.time + 0.01, end))
        wire.rig.apply()


@contextlib.contextmanager
def served(
    robot: str = "hopper", servos: dict[str, Any] | None = None, model: str = "sts3215", stepped: bool = True
) -> Iterator[Server]:
    """A server; in stepped time every SYNC_READ is 10 ms after the other."""
    table = load_model(model)
    machine = Machine(get_robot(robot))
    with Server(Wire(Rig(machine, table, mounts(machine.names, servos, table))), stepped=stepped) as server:
        thread = threading.Thread(target=server.run, daemon=True)
        thread.start()
        try:
            yield server
        finally:
            server.stop()
            thread.join(5.0)


XL330 = load_model("xl330_m288")
SET_UP = {"baud_rate": XL330.baud_rates.index(RATE), "return_delay_time": 0}


def dynamixels(
    robot: str = "bench",
    faults: Sequence[Mapping[str, Any]] = (),
    model: str = "xl330_m288",
    chain: str = "xl330",
) -> Wire:
    """Dynamixels at 1 Mbit/s that answer at once, one on each joint."""
    machine = Machine(get_robot(robot), chain)
    table = load_model(model)
    rig = Rig(machine, table, mounts(machine.encoders, None, table), registers={"": SET_UP})
    return Wire(rig, [fault_from(row) for row in faults])


def bus_on(wire: Wire, model: str = "xl330_m288", **keys: Any) -> ServoBus:
    """A bus of the project on that wire."""
    return ServoBus("simulated", model=model, opened=SimulatedPort(wire), **keys)
