"""A port with virtual servos behind it in the same process, in simulated time: no pseudo-terminal, no waiting.

Time passes only while bytes are on the wire, while a reply is waited for, and while somebody sleeps. Time-outs, round
trips and overruns are therefore those of the simulated clock, equal in every run, whatever else the computer does.
"""

from __future__ import annotations

import errno
import heapq
import threading

from ...common.alarm import to_stderr
from ..bus.port import WAIT, BusPort, Echo
from .faults import first
from .wire import Wire

STEP = 0.005  # [s] between two looks at the faults while nobody asks


class SimulatedClock:
    """The time of one machine, for all ports to it.

    Attributes:
        time: [s].
        wires: lines to its servos.
        lock: for who lets it pass: an emergency stop is a thread of its own.
    """

    def __init__(self, time: float) -> None:
        self.time = time
        self.wires: list[Wire] = []
        self.lock = threading.RLock()


class SimulatedPort(BusPort):
    """The port of a :class:`~sealegs.hw.bus.servo_bus.ServoBus` (``opened=``), and the clock of its loop.

    Attributes:
        wire: servos and their line.
        clock: shared by all ports to one machine.
        latency: of the adapter, on every reply and echo [s].
    """

    simulated = True

    def __init__(
        self,
        wire: Wire,
        reply_timeout: float = 0.02,
        baudrate: int = 1_000_000,
        latency: float = 0.0,
        clock: SimulatedClock | None = None,
    ) -> None:
        self.port_name, self.baudrate = "simulated", baudrate
        self.reply_timeout, self.latency = reply_timeout, latency
        self.wire = wire
        self.is_open, self.is_using = True, False
        self.discarded = self.received = 0
        self.tx_time_per_byte = 10_000.0 / baudrate  # [ms]
        self.ser = None
        self.clock = clock or SimulatedClock(wire.rig.time)
        if wire not in self.clock.wires:
            self.clock.wires.append(wire)
        self._deadline = 0.0
        self._coming: list[tuple[float, int, bytes]] = []
        self._sequence = 0
        self._buffer = bytearray()
        self.echo, self._ready = Echo(), bytearray()

    # --- clock -------------------------------------------------------------------------------------------------

    def now(self) -> float:
        """Of the simulated clock [s]."""
        return self._time

    def sleep(self, seconds: float) -> None:
        """Let time pass; the machine moves on."""
        end = self._time + max(seconds, 0.0)
        while self._time < end:
            with self.clock.lock:
                self._time = min(self._time + STEP, end)
                for wire in self.clock.wires:
                    wire.apply_faults(self._time)
                self.wire.rig.advance(self._time)
                self.wire.rig.apply()

    # --- port --------------------------------------------------------------------------------------------------

    def closePort(self) -> None:
        """Close the device."""
        self.is_open = self.is_using = False

    def reopened(self) -> SimulatedPort:
        """Another port of the same wire, at the same time, as another program would open it."""
        return SimulatedPort(self.wire, self.reply_timeout, self.baudrate, self.latency, self.clock)

    @property
    def _time(self) -> float:
        return self.clock.time

    @_time.setter
    def _time(self, time: float) -> None:
        self.clock.time = time

    def waiting(self) -> bytes:
        """What has come in."""
        self._arrive()
        data = bytes(self._buffer)
        self._buffer.clear()
        return data

    def writePort(self, packet: list[int]) -> int:
        """Carry a request to the servos."""
        self._require_adapter()
        data = bytes(packet)
        if first(self.wire.faults, "echo", self._time) is not None:
            self._push(self._time + self.latency, data)
        with self.clock.lock:
            for request in self.wire.requests(bytearray(data)):
                for at, reply in self.wire.exchange(request, self._time, self.baudrate):
                    self._push(at + self.latency, reply)
        for servo in self.wire.servos:
            if servo.refused is not None:
                to_stderr(servo.refused)
                servo.refused = None
        return len(data)

    def take(self, length: int) -> bytes:
        """Up to ``length`` bytes; waits for the first as long as a real port does."""
        self._require_adapter()
        self._arrive()
        if not self._buffer:
            end = self._time + WAIT
            if self._time <= self._deadline < end:
                end = self._deadline + 1e-9
            self._time = max(self._time, min(end, self._coming[0][0])) if self._coming else end
            self._arrive()
        data = bytes(self._buffer[:length])
        del self._buffer[:length]
        return data

    def setPacketTimeoutMillis(self, msec: float) -> None:
        """Start a timeout of so many milliseconds."""
        self._deadline = self._time + 1e-3 * msec

    def isPacketTimeout(self) -> bool:
        """Whether the timeout is over."""
        return self._time > self._deadline

    def _push(self, at: float, data: bytes) -> None:
        heapq.heappush(self._coming, (at, self._sequence, data))
        self._sequence += 1

    def _arrive(self) -> None:
        while self._coming and self._coming[0][0] <= self._time:
            self._buffer += heapq.heappop(self._coming)[2]

    def _require_adapter(self) -> None:
        if first(self.wire.faults, "unplug", self._time) is not None:
            raise OSError(errno.EIO, "the adapter is gone")
