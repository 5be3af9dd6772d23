"""The process behind the port: bytes in, bytes out, and a machine that moves meanwhile."""

from __future__ import annotations

import heapq
import os
import select
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from . import protocol
from .control import ControlSocket
from .faults import fault_from, first
from .protocol import Request
from .terminal import Terminal
from .wire import Wire

IDLE = 0.005  # [s] after which the machine moves on though nobody asks


class Server:
    """Serves one port until it is told to stop; leaving its ``with`` removes port and control socket."""

    def __init__(
        self,
        wire: Wire,
        *,
        stepped: bool = False,
        cycle: float = 0.01,
        latency: float = 0.0,
        link: Path | None = None,
        linger: float | None = None,
    ) -> None:
        """Open port and control socket.

        Args:
            wire: servos and their line.
            stepped: whether time advances by transactions alone, instead of with the clock.
            cycle: in stepped time, every SYNC_READ waits for the next multiple of this [s]; 0: it does not.
            latency: of the adapter, on every reply [s].
            link: fixed name of the port.
            linger: end so long after the standard input is closed [s]; None: do not look at it.
        """
        self.wire, self.stepped, self.cycle, self.latency = wire, stepped, cycle, latency
        self._link = link
        self._terminal: Terminal | None = Terminal(link)
        self._control = ControlSocket()
        self._stream = bytearray()
        self._outgoing: list[tuple[float, int, bytes]] = []
        self._sequence = 0
        self._stepped_now = 0.0
        self._start = time.monotonic()
        self._linger = linger
        self._parent = sys.stdin.fileno() if linger is not None else None
        self._end: float | None = None
        self._running = True

    @property
    def port(self) -> str:
        """Path that clients open."""
        return self._terminal.path if self._terminal else str(self._link)

    @property
    def control(self) -> str:
        """Path of the control socket."""
        return self._control.path

    def now(self) -> float:
        """Time on the machine's clock [s]."""
        return self._stepped_now if self.stepped else time.monotonic() - self._start

    # --- loop --------------------------------------------------------------------------------------------------

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *_: object) -> None:
        self._control.close()
        if self._terminal is not None:
            self._terminal.close()

    def run(self) -> None:
        """Serve until told to stop."""
        while self._running:
            self._wait()

    def stop(self) -> None:
        """End :meth:`run`."""
        self._running = False

    def disturb(self, data: bytes) -> None:
        """Put bytes on the line that no servo sent."""
        if self._terminal is not None:
            self._terminal.write(data)

    def _wait(self) -> None:
        readers: list[Any] = self._control.readers()
        if self._terminal is not None:
            readers.append(self._terminal.master)
        if self._parent is not None:
            readers.append(self._parent)
        ready, _, _ = select.select(readers, [], [], self._pause())
        if self._terminal is not None and self._terminal.master in ready:
            self._receive()
        if self._parent is not None and self._parent in ready and not os.read(self._parent, 64):
            self._parent, self._end = None, time.monotonic() + (self._linger or 0.0)
        self._control.serve(ready, self._command)
        if self._end is not None and time.monotonic() > self._end:
            self.stop()
        if not self.stepped:
            self._flush(self.now())
            if not ready:
                self._carry_on(self.now())

    def _pause(self) -> float:
        if self.stepped:
            return 0.1
        if not self._outgoing:
            return IDLE
        return min(max(self._outgoing[0][0] - self.now(), 0.0), IDLE)

    def _carry_on(self, now: float) -> None:
        self.wire.apply_faults(now)
        self.wire.rig.advance(now)
        self.wire.rig.apply()
        unplugged = first(self.wire.faults, "unplug", now) is not None
        if unplugged and self._terminal is not None:
            self._terminal.close()
            self._terminal = None
            self._outgoing.clear()
            self._stream.clear()
        elif not unplugged and self._terminal is None:
            self._terminal = Terminal(self._link)

    def _receive(self) -> None:
        assert self._terminal is not None
        try:
            data = os.read(self._terminal.master, 4096)
        except (BlockingIOError, OSError):
            return
        if first(self.wire.faults, "echo", self.now()) is not None:
            self._terminal.write(data)
        self._stream += data
        for request in self.wire.requests(self._stream):
            self._handle(request)
            if self._terminal is None:
                return

    def _handle(self, request: Request) -> None:
        assert self._terminal is not None
        if self.stepped and request.instruction == protocol.SYNC_READ and self.cycle > 0.0:
            cycles = int(self._stepped_now / self.cycle + 1e-6) + 1
            self._stepped_now = cycles * self.cycle
            self._flush(self._stepped_now)
        self._carry_on(self.now())
        if self._terminal is None:
            return
        baudrate = self._terminal.baudrate()
        for at, packet in self.wire.exchange(request, self.now(), baudrate):
            heapq.heappush(self._outgoing, (at + self.latency, self._sequence, packet))
            self._sequence += 1
        for servo in self.wire.rig.servos:
            if servo.refused is not None:
                print(servo.refused, file=sys.stderr, flush=True)
                servo.refused = None
        if self.stepped:
            self._stepped_now = max(self._stepped_now, self.wire.free_at)
            self._flush(self._stepped_now + self.latency + 1e-9)

    def _flush(self, now: float) -> None:
        data = b""
        while self._outgoing and self._outgoing[0][0] <= now:
            data += heapq.heappop(self._outgoing)[2]
        if data and self._terminal is not None:
            self._terminal.write(data)

    # --- control -----------------------------------------------------------------------------------------------

    def _command(self, order: dict[str, Any]) -> dict[str, Any]:
        commands: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
            "status": self._status,
            "fault": self._fault,
            "clear": self._clear,
            "advance": self._advance,
            "let_go": self._let_go,
            "stop": self._stop,
        }
        name = str(order.get("do"))
        if name not in commands:
            return {"error": f"there is no order '{name}'; there are {', '.join(commands)}."}
        return commands[name](order)

    def _status(self, _: dict[str, Any]) -> dict[str, Any]:
        rig, now = self.wire.rig, self.now()
        if not self.stepped:
            self._carry_on(now)
        rig.sense()
        servos = {}
        for servo, name in zip(rig.servos, rig.machine.encoders, strict=True):
            since = rig.since[servo.joint]
            servos[str(servo.id)] = {
                "joint": name,
                "torque": rig.torque(servo.joint),
                "since": since,
                "since_monotonic": None if self.stepped else self._start + since,
                "angle": rig.machine.position(servo.joint),
                "steps": servo.sensors.steps,
                "goal": servo.get("goal_position"),
                "duty": servo.sensors.duty,
                "current": servo.sensors.current,
                "voltage": servo.sensors.voltage,
                "temperature": servo.shown_temperature(),
                "status": servo.status(now),
            }
        return {
            "time": now,
            "port": self.port,
            "plugged": self._terminal is not None,
            "requests": self.wire.heard,
            "servos": servos,
            "history": rig.history[-1000:],
            "faults": [{**vars(fault), "done": sorted(fault.done)} for fault in self.wire.faults],
            "qpos": rig.machine.data.qpos.tolist(),
            "qvel": rig.machine.data.qvel.tolist(),
        }

    def _fault(self, order: dict[str, Any]) -> dict[str, Any]:
        row = {key: value for key, value in order.items() if key != "do"}
        self.wire.faults.append(fault_from(row, self.now()))
        self._carry_on(self.now())
        return {"time": self.now()}

    def _clear(self, _: dict[str, Any]) -> dict[str, Any]:
        self.wire.faults.clear()
        self._carry_on(self.now())
        return {"time": self.now(), "port": self.port}

    def _advance(self, order: dict[str, Any]) -> dict[str, Any]:
        if not self.stepped:
            return {"error": "time runs with the clock here; start the virtual bus with time=stepped."}
        self._stepped_now += float(order.get("seconds", 0.0))
        self._carry_on(self._stepped_now)
        self._flush(self._stepped_now)
        return {"time": self._stepped_now}

    def _let_go(self, _: dict[str, Any]) -> dict[str, Any]:
        if not self.stepped:
            self._carry_on(self.now())
        self.wire.rig.held = None
        return {"time": self.now()}

    def _stop(self, _: dict[str, Any]) -> dict[str, Any]:
        self.stop()
        return {}


def announce(server: Server) -> None:
    """Print where clients find the server, one fact a line."""
    print(f"port: {server.port}", f"control: {server.control}", sep="\n")
    sys.stdout.flush()
