"""The process behind the port: bytes in, bytes out, and a machine that moves meanwhile."""

from __future__ import annotations

import array
import fcntl
import heapq
import os
import pty
import select
import sys
import termios
import time
import tty
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ...common.errors import SealegsError
from . import protocol
from .control import ControlSocket
from .imu import line_of
from .protocol import Request
from .wire import Wire, fault_from, first

IDLE = 0.005  # [s] after which the machine moves on though nobody asks


class Line:
    """One port, and the servos behind it.

    Attributes:
        wire: the servos' line.
        terminal: the port; None while the adapter is unplugged.
        stream: bytes of requests that are not complete.
    """

    def __init__(self, wire: Wire, link: Path | None) -> None:
        self.wire, self._link = wire, link
        self.terminal: Terminal | None = Terminal(link)
        self.stream = bytearray()
        self._outgoing: list[tuple[float, int, bytes]] = []
        self._sequence = 0

    @property
    def port(self) -> str:
        """Path that clients open."""
        return self.terminal.path if self.terminal else str(self._link)

    @property
    def next_due(self) -> float | None:
        """When the next reply is to be sent [s]; None: nothing waits."""
        return self._outgoing[0][0] if self._outgoing else None

    def send_at(self, time: float, packet: bytes) -> None:
        """Send a reply once its bytes have gone over the line [s]."""
        heapq.heappush(self._outgoing, (time, self._sequence, packet))
        self._sequence += 1

    def flush(self, now: float) -> None:
        """Send what is due."""
        data = b""
        while self._outgoing and self._outgoing[0][0] <= now:
            data += heapq.heappop(self._outgoing)[2]
        if data and self.terminal is not None:
            self.terminal.write(data)

    def plug(self, plugged: bool, name: str | None = None) -> None:
        """Unplug the adapter, or plug it in; ``name``: link under which it comes back, None: as before."""
        self._link = self._link if name is None else Path(name)
        if not plugged and self.terminal is not None:
            self.terminal.close()
            self.terminal = None
            self._outgoing.clear()
            self.stream.clear()
        elif plugged and self.terminal is None:
            self.terminal = Terminal(self._link)


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
        others: Sequence[Wire] = (),
    ) -> None:
        """Open port and control socket.

        Args:
            wire: servos and their line.
            stepped: whether time advances by transactions alone, instead of with the clock.
            cycle: in stepped time, every SYNC_READ waits for the next multiple of this [s]; 0: it does not.
            latency: of the adapter, on every reply and echo [s].
            link: fixed name of the port.
            others: further lines to the same machine, each on a port of its own; stepped time advances with the first.
            linger: end so long after the standard input is closed [s]; None: do not look at it.
        """
        self.stepped, self.cycle, self.latency = stepped, cycle, latency
        self.wire = wire
        self.lines = {"": Line(wire, link)}
        for other in others:
            beside = None if link is None else _beside(link, other.bus)
            self.lines[other.bus] = Line(other, beside)
        self.imu = None if wire.rig.machine.imu is None else Terminal(None if link is None else _beside(link, "imu"))
        self._control = ControlSocket()
        self._stepped_now = 0.0
        self._start = time.monotonic()
        self._linger = linger
        self._parent = sys.stdin.fileno() if linger is not None else None
        self._end: float | None = None
        self._running = True

    @property
    def port(self) -> str:
        """Path that clients open."""
        return self.lines[""].port

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
        for line in self.lines.values():
            line.plug(False)
        if self.imu is not None:
            self.imu.close()

    def run(self) -> None:
        """Serve until told to stop."""
        while self._running:
            self._wait()

    def stop(self) -> None:
        """End :meth:`run`."""
        self._running = False

    def disturb(self, data: bytes) -> None:
        """Put bytes on the line that no servo sent."""
        if (terminal := self.lines[""].terminal) is not None:
            terminal.write(data)

    def _wait(self) -> None:
        readers: list[Any] = self._control.readers()
        open_lines = {line.terminal.master: line for line in self.lines.values() if line.terminal is not None}
        readers += open_lines
        if self._parent is not None:
            readers.append(self._parent)
        ready, _, _ = select.select(readers, [], [], self._pause())
        for descriptor, line in open_lines.items():
            if descriptor in ready:
                self._receive(line)
        if self._parent is not None and self._parent in ready and not os.read(self._parent, 64):
            self._parent, self._end = None, time.monotonic() + (self._linger or 0.0)
        self._control.serve(ready, self._command)
        if self._end is not None and time.monotonic() > self._end:
            self.stop()
        if not self.stepped:
            for line in self.lines.values():
                line.flush(self.now())
            if not ready:
                self._carry_on(self.now())

    def _pause(self) -> float:
        if self.stepped:
            return 0.1
        due = [line.next_due for line in self.lines.values() if line.next_due is not None]
        return min(max(min(due) - self.now(), 0.0), IDLE) if due else IDLE

    def _carry_on(self, now: float) -> None:
        for line in self.lines.values():
            line.wire.apply_faults(now)
        self.wire.rig.advance(now)
        self.wire.rig.apply()
        self._send_samples(now)
        for line in self.lines.values():
            away = first(line.wire.faults, "unplug", now)
            line.plug(away is None, None if away is None else away.name)

    def _send_samples(self, now: float) -> None:
        """Send the lines of the IMU that are due."""
        if self.imu is not None and (imu := self.wire.rig.machine.imu) is not None:
            for sample in imu.due(now):
                self.imu.write(line_of(sample))

    def _receive(self, line: Line) -> None:
        if line.terminal is None:
            return
        try:
            data = os.read(line.terminal.master, 4096)
        except (BlockingIOError, OSError):
            return
        if first(line.wire.faults, "echo", self.now()) is not None:
            line.send_at(self.now() + self.latency, data)
            if self.stepped:  # nothing else sends what is no request
                line.flush(self._stepped_now + self.latency + 1e-9)
        line.stream += data
        for request in line.wire.requests(line.stream):
            self._handle(line, request)
            if line.terminal is None:
                return

    def _handle(self, line: Line, request: Request) -> None:
        wire = line.wire
        reads = request.instruction == protocol.SYNC_READ and wire is self.wire
        if self.stepped and reads and self.cycle > 0.0:
            cycles = int(self._stepped_now / self.cycle + 1e-6) + 1
            self._stepped_now = cycles * self.cycle
            line.flush(self._stepped_now)
        self._carry_on(self.now())
        if line.terminal is None:
            return
        for at, packet in wire.exchange(request, self.now(), line.terminal.baudrate()):
            line.send_at(at + self.latency, packet)
        for servo in wire.servos:
            if servo.refused is not None:
                print(servo.refused, file=sys.stderr, flush=True)
                servo.refused = None
        if self.stepped:
            self._stepped_now = max(self._stepped_now, wire.free_at)
            line.flush(self._stepped_now + self.latency + 1e-9)

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
            servos[f"{servo.bus}:{servo.id}" if servo.bus else str(servo.id)] = {
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
            "plugged": all(line.terminal is not None for line in self.lines.values()),
            "requests": sum(line.wire.heard for line in self.lines.values()),
            "servos": servos,
            "history": rig.history[-1000:],
            "faults": [
                {**vars(fault), "done": sorted(fault.done)}
                for line in self.lines.values()
                for fault in line.wire.faults
            ],
            "qpos": rig.machine.data.qpos.tolist(),
            "qvel": rig.machine.data.qvel.tolist(),
        }

    def _fault(self, order: dict[str, Any]) -> dict[str, Any]:
        row = {key: value for key, value in order.items() if key != "do"}
        for line in self.lines.values():
            fault = fault_from(row, self.now())
            if fault.bus in (None, line.wire.bus):
                line.wire.faults.append(fault)
        self._carry_on(self.now())
        return {"time": self.now()}

    def _clear(self, _: dict[str, Any]) -> dict[str, Any]:
        for line in self.lines.values():
            line.wire.faults.clear()
        self._carry_on(self.now())
        return {"time": self.now(), "port": self.port}

    def _advance(self, order: dict[str, Any]) -> dict[str, Any]:
        if not self.stepped:
            return {"error": "time runs with the clock here; start the virtual bus with time=stepped."}
        self._stepped_now += float(order.get("seconds", 0.0))
        self._carry_on(self._stepped_now)
        for line in self.lines.values():
            line.flush(self._stepped_now)
        return {"time": self._stepped_now}

    def _let_go(self, _: dict[str, Any]) -> dict[str, Any]:
        if not self.stepped:
            self._carry_on(self.now())
        self.wire.rig.held = None
        return {"time": self.now()}

    def _stop(self, _: dict[str, Any]) -> dict[str, Any]:
        self.stop()
        return {}


def _beside(link: Path, name: str) -> Path:
    """The link to a further port."""
    return link.with_name(f"{link.name}-{name}")


def announce(server: Server) -> None:
    """Print where clients find the server, one fact a line."""
    print(f"port: {server.port}", f"control: {server.control}", sep="\n")
    for name, line in server.lines.items():
        if name:
            print(f"port of {name}: {line.port}")
    if server.imu is not None:
        print(f"port of the IMU: {server.imu.path}")
    sys.stdout.flush()


# --- the pseudo-terminal that stands for the adapter's serial port ---------------------------------------------------


TCGETS2 = 0x802C542A  # Linux: termios with numeric speeds


class Terminal:
    """A pseudo-terminal, and optionally a link of a fixed name to it.

    Attributes:
        master: file descriptor of the servos' side.
        path: that clients open.
    """

    def __init__(self, link: Path | None = None) -> None:
        """Open it.

        Raises:
            SealegsError: the link's name is taken by something else, or cannot be made.
        """
        if link is not None and link.exists() and not link.is_symlink():
            raise SealegsError(f"the link {link} would replace a file; choose another name.")
        self.master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        self._link = link
        name = os.ttyname(self._slave)
        self.path = name
        if link is not None:
            try:
                if link.is_symlink():
                    link.unlink()
                link.symlink_to(name)
            except OSError as error:
                raise SealegsError(f"the link {link} cannot be made: {error.strerror}.") from None
            self.path = str(link)

    def baudrate(self, otherwise: int = 1_000_000) -> int:
        """Speed that the client has set [bit/s]; ``otherwise`` where the system does not say."""
        if sys.platform != "linux":
            return otherwise
        buffer = array.array("I", [0] * 11)
        try:
            fcntl.ioctl(self._slave, TCGETS2, buffer)
        except OSError:
            return otherwise
        return buffer[10]

    def write(self, data: bytes) -> None:
        """Send bytes to the client; those that nobody reads are lost, as on a real line."""
        try:
            os.write(self.master, data)
        except BlockingIOError:
            termios.tcflush(self._slave, termios.TCIFLUSH)

    def close(self) -> None:
        """Hang up: whoever has the port open gets an error."""
        for descriptor in (self._slave, self.master):
            os.close(descriptor)
        if self._link is not None and self._link.is_symlink():
            self._link.unlink()
