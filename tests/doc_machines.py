"""Machines for whoever types the commands of the docs: servos on a virtual bus, a hand to move them, a served port."""

from __future__ import annotations

import contextlib
import functools
import signal
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

from sealegs.commands import cli
from sealegs.hw.bus import servo_bus as servo_bus
from sealegs.hw.machine import calibration
from sealegs.hw.virtual import VirtualBus

PORT = "port=/dev/ttyUSB0"
DYNAMIXEL = {
    "model": "xl330_m288",
    "actuator": "xl330",
    "servos": {"joint": {"id": 2}},
    "registers": {"baud_rate": 3},  # 1 Mbit/s, set with the manufacturer's tool
}
MOVES = ((0.0,), (0.5,), (-0.8, 0.8))
"""What a calibration of the bench asks for: hanging, to its positive side, from stop to stop [rad]."""
PASSING = 0.1  # [s] of a stepped bus that nobody asks
SERVER = "import sys; from sealegs.commands.cli import main; sys.exit(main())"


class PatientBus(servo_bus.ServoBus):
    """A bus on a busy computer, with at most two servos; the latest one opened is the hand's."""

    opened: Any = None

    def __init__(self, port: str, *arguments: Any, **keys: Any) -> None:
        super().__init__(port, *arguments, **{**keys, "timeout": 1.0})
        PatientBus.opened = self

    def scan(self, ids: Iterable[int] = range(3)) -> dict[int, int]:
        """The others are known to be absent, and would cost time."""
        return super().scan(ids)


@dataclass
class Machines:
    """What stands on the reader's desk; a bus is started where a command names its port, and lives as long as the page.

    Attributes:
        folder: of the reader.
        stack: of all that must be ended.
    """

    folder: Path
    stack: contextlib.ExitStack
    buses: dict[str, VirtualBus] = field(default_factory=dict)

    def serve(self, arguments: list[str]) -> None:
        """``sealegs virtual``: serves until Ctrl-C, which comes where the page ends."""
        command = [sys.executable, "-c", SERVER, "virtual", *arguments, "time=stepped"]
        server = self.stack.enter_context(
            subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=self.folder, start_new_session=True)
        )
        assert server.stdout is not None and server.stdout.readline().startswith("port: ")
        self.stack.callback(_interrupted, server)

    def done(self, word: str, arguments: list[str]) -> int:
        """Exit status of a command, with a bus on the port that it names."""
        if PORT not in arguments:
            return cli.main([word, *arguments])
        virtual = self._bus("xl330" if any("xl330" in item for item in arguments) else "sts3215")
        arguments = [f"port={virtual.port}" if item == PORT else item for item in arguments]
        if word == "scan":
            with passing(virtual):
                return cli.main([word, *arguments])
        if word != "calibrate":
            return cli.main([word, *arguments])
        moves = [*MOVES]

        def moved(question: str) -> str:
            bus = PatientBus.opened
            (servo,) = bus.scan()
            for angle in moves.pop(0):
                bus.torque_on([servo])
                bus.write_goals([servo], [angle])
                virtual.advance(1.0)
            return ""

        guide = functools.partial(calibration.guide, ask=moved)
        with patch.object(servo_bus, "ServoBus", PatientBus), patch.object(calibration, "guide", guide):
            return cli.main([word, *arguments])

    def _bus(self, servo: str) -> VirtualBus:
        if servo not in self.buses:
            keys: dict[str, Any] = DYNAMIXEL if servo == "xl330" else {}
            self.buses[servo] = self.stack.enter_context(VirtualBus(time="stepped", cycle=0.0, **keys))
        return self.buses[servo]


@contextlib.contextmanager
def passing(virtual: VirtualBus) -> Iterator[None]:
    """Time passes on a stepped bus while nobody asks it: a servo that restarts is silent for a while."""
    ended = threading.Event()

    def steps() -> None:
        while not ended.wait(PASSING):
            virtual.advance(PASSING)

    thread = threading.Thread(target=steps)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _interrupted(server: subprocess.Popen[str]) -> None:
    server.send_signal(signal.SIGINT)
    assert server.wait(10.0) == 130


@contextlib.contextmanager
def machines(folder: Path) -> Iterator[Machines]:
    """An empty desk; whatever is put on it is ended with the block."""
    with contextlib.ExitStack() as stack:
        yield Machines(folder, stack)
