"""A hopper on a virtual bus in a process of its own, made once for a test file; each test finds it released."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.virtual import VirtualBus


def hopper_bus(folder: Path) -> VirtualBus:
    """The bus, linked into a folder: after an unplugging, the system may give the port's number to another process."""
    return VirtualBus(robot="hopper", link=folder / "servos")


@contextmanager
def left_clean(machine: VirtualBus) -> Iterator[VirtualBus]:
    """The machine; afterwards it is released and without faults."""
    yield machine
    machine.clear()
    with ServoBus(machine.port, timeout=0.5) as bus:
        assert bus.torque_off([1, 2]) == {}
