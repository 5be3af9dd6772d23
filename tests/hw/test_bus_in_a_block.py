"""What becomes of torque when an exception ends ``with ServoBus(...)``."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.virtual.faults import fault_from
from sealegs.hw.virtual.server import Server

from tests.served_bus import served

TIMEOUT = 0.1  # [s]


@pytest.fixture
def server() -> Iterator[Server]:
    with served() as found:
        yield found


def torque(server: Server) -> list[int]:
    return [servo.get("torque_enable") for servo in server.wire.rig.servos]


def test_an_exception_switches_off_what_the_bus_has_switched_on(server: Server) -> None:
    with ServoBus(server.port, timeout=TIMEOUT) as other:
        other.torque_on([2])
    with pytest.raises(KeyboardInterrupt), ServoBus(server.port, timeout=TIMEOUT) as bus:
        bus.torque_on([1])
        raise KeyboardInterrupt
    assert torque(server) == [0, 1], "2 was not its own"


def test_a_block_that_ends_as_planned_leaves_torque_as_it_is(server: Server) -> None:
    with ServoBus(server.port, timeout=TIMEOUT) as bus:
        bus.torque_on([1])
        bus.write_register(2, "torque_enable", 1)
        bus.torque_off([2])
    assert torque(server) == [1, 0]


@pytest.mark.parametrize("dead", ["silent", "closed"])
def test_a_dead_bus_does_not_hide_the_exception(server: Server, dead: str) -> None:
    with pytest.raises(ValueError, match="a bug") as raised, ServoBus(server.port, timeout=TIMEOUT) as bus:
        bus.torque_on([1])
        if dead == "silent":
            server.wire.faults.append(fault_from({"kind": "drop"}))
        else:
            bus.close()
        raise ValueError("a bug")
    assert "TORQUE MAY BE ON at servo(s) 1: CUT THE POWER" in raised.value.__notes__[0]
