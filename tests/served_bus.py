"""A virtual bus served by a thread of the test, in stepped time: quick to start, and its inside can be looked at."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from typing import Any

from envs.robots import get_robot
from hw.registers import load_model
from hw.virtual.machine import Machine
from hw.virtual.rig import Rig, mounts
from hw.virtual.server import Server
from hw.virtual.wire import Wire


@contextlib.contextmanager
def served(robot: str = "hopper", servos: dict[str, Any] | None = None, model: str = "sts3215") -> Iterator[Server]:
    """A server in stepped time, every SYNC_READ 10 ms after the other."""
    table = load_model(model)
    machine = Machine(get_robot(robot))
    server = Server(Wire(Rig(machine, table, mounts(machine.names, servos, table))), stepped=True)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.stop()
        thread.join(5.0)
