"""A bench with a Dynamixel instead of a Feetech servo, in simulated time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sealegs.envs.robots import get_robot
from sealegs.hw.bus.registers import load_model
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.virtual.faults import fault_from
from sealegs.hw.virtual.machine import Machine
from sealegs.hw.virtual.rig import Rig, mounts
from sealegs.hw.virtual.simulated_port import SimulatedPort
from sealegs.hw.virtual.wire import Wire

XL330 = load_model("xl330_m288")
RATE = 1_000_000  # [bit/s]
SET_UP = {"baud_rate": XL330.baud_rates.index(RATE), "return_delay_time": 0}


def wired(
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
