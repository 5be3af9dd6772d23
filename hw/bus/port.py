"""The SDKs' serial port without its traps: bounded waits, no busy waiting, input that is really discarded."""

from __future__ import annotations

import errno
import sys
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import serial
from scservo_sdk import PortHandler

from .packets import PortBusyError, PortError, StalledError, UnpluggedError

GONE: tuple[type[Exception], ...] = (OSError, serial.SerialException)
if sys.platform != "win32":
    import termios

    GONE = (*GONE, termios.error)
"""What a port raises once its adapter is gone, depending on where it was noticed."""

RATES = (4800, 9600, 14400, 19200, 38400, 57600, 115200, 128000, 250000, 500000, 1000000)
"""Of Feetech's servos [bit/s]."""
WRITE_TIMEOUT = 0.5  # [s] for a full output queue; pyserial counts time in which this process did not run, too
SHARED = 0.15  # [s] that another program may have the port: a supervisor that holds servos looks at them now and then
WAIT = 0.002  # [s] that one read waits for its bytes: how finely the reply timeout is kept
UNRETURNED = 4  # latest packets that an adapter may still return


class Echo:
    """Takes out of what comes in what this host has sent: some adapters return it, always or from some moment on.

    One wire carries both directions, so a packet comes back before its answer. No answer equals its question: they
    differ in length (:meth:`sealegs.hw.bus.transactions.Transactions.no_late_length`).
    """

    def __init__(self) -> None:
        self._sent: deque[bytes] = deque(maxlen=UNRETURNED)
        self._held = b""

    def sent(self, packet: Sequence[int]) -> None:
        """A packet went out; it may come back."""
        self._sent.append(bytes(packet))

    def without(self, data: bytes, last: bool = False) -> bytes:
        """What came in, less what this host has sent.

        Args:
            data: that came in since the last time; a packet may come back in pieces.
            last: nothing more is waited for: the beginning of a packet is none.
        """
        data, self._held = self._held + data, b""
        while data:
            place = next((k for k, sent in enumerate(self._sent) if sent.startswith(data[: len(sent)])), None)
            if place is None:
                break
            if len(data) < len(self._sent[place]):
                self._held, data = (b"", data) if last else (data, b"")
                break
            data = data[len(self._sent[place]) :]
            for _ in range(place + 1):
                self._sent.popleft()
        return data


class BusPort(PortHandler):
    """A serial port for the SDKs' packet handlers.

    Unlike their own, a read waits in the kernel and not in a loop, time is monotonic, and writing cannot block for
    ever. No other program can share the port, and ``clearPort`` discards what has come in.

    Attributes:
        simulated: whether its time is simulated, and waits for whoever asks.
        reply_timeout: wait for the first byte of a reply beyond the time that its bytes take [s].
        discarded: bytes that the latest ``clearPort`` threw away, an echo left out.
        received: bytes that were read since.
        echo: takes out what the adapter returns of what was sent.
    """

    simulated = False

    def __init__(self, path: str, baudrate: int, reply_timeout: float, rates: Sequence[int] = RATES) -> None:
        """Open the port.

        Args:
            path: of the device.
            baudrate: of the bus [bit/s].
            reply_timeout: wait for the first byte of a reply beyond the time that its bytes take [s].
            rates: that a bus can have [bit/s].

        Raises:
            PortError: it does not exist or cannot be set up.
            PortBusyError: another program has it.
        """
        super().__init__(path)
        self.reply_timeout = reply_timeout
        self.discarded = self.received = 0
        self.echo, self._ready = Echo(), bytearray()
        self._deadline = 0.0
        self.ser: Any = None
        if baudrate not in rates:
            known = ", ".join(map(str, rates))
            raise PortError(f"the baud rate {baudrate} is not one of such a bus; the usual one is 1000000 ({known}).")
        self.baudrate = baudrate
        end = time.monotonic() + SHARED
        while True:
            try:
                self.setupPort(baudrate)
                return
            except GONE as error:
                named = _cannot_open(path, error)
            if not isinstance(named, PortBusyError) or time.monotonic() > end:
                raise named from None
            time.sleep(WAIT)

    def now(self) -> float:
        """The clock that replies are waited for by: the host's monotonic one [s]."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        time.sleep(seconds)

    def setupPort(self, cflag_baud: int) -> bool:
        """Open the device; called by the SDK too, when the baud rate changes."""
        if self.is_open:
            self.closePort()
        self.ser = serial.Serial(
            self.port_name,
            cflag_baud,
            timeout=WAIT,
            write_timeout=max(WRITE_TIMEOUT, self.reply_timeout),  # who waits long for replies has a slow host
            exclusive=None if sys.platform == "win32" else True,
        )
        self.is_open = True
        self.is_using = False
        self.ser.reset_input_buffer()
        self.tx_time_per_byte = 10_000.0 / cflag_baud  # [ms]
        return True

    def closePort(self) -> None:
        """Close the device; a port that is gone or closed already is no error."""
        self.is_open = self.is_using = False
        if self.ser is not None:
            with suppress(*GONE):
                self.ser.close()

    def clearPort(self) -> None:
        """Discard what has come in; the SDK calls this in front of every request."""
        self._ready += self.echo.without(self.waiting())
        self.received, self.discarded = 0, len(self._ready)
        self._ready.clear()

    def waiting(self) -> bytes:
        """What has come in, an echo with it."""
        return self.ser.read(count) if (count := self.ser.in_waiting) else b""

    def take(self, length: int) -> bytes:
        """Up to ``length`` bytes that have come in, an echo with them; waits a little for the first."""
        return self.ser.read(length)

    def readPort(self, length: int) -> bytes:
        """Up to ``length`` bytes, without an echo."""
        if not self._ready:
            self._ready += self.echo.without(self.take(length), self.isPacketTimeout())
        data = bytes(self._ready[:length])
        del self._ready[:length]
        self.received += len(data)
        return data

    def writePort(self, packet: list[int]) -> int:
        """Send a packet."""
        return self.ser.write(bytes(packet))

    # the SDK asks in milliseconds and for its own margin of 34 ms

    def setPacketTimeout(self, packet_length: int) -> None:
        """Start the timeout of a reply of so many bytes."""
        self._deadline = time.monotonic() + self.reply_timeout + 1e-3 * self.tx_time_per_byte * packet_length

    def setPacketTimeoutMillis(self, msec: float) -> None:
        """Start a timeout of so many milliseconds."""
        self._deadline = time.monotonic() + 1e-3 * msec

    def isPacketTimeout(self) -> bool:
        """Whether the timeout is over."""
        return time.monotonic() > self._deadline

    def settle(self, quiet: float = 0.004, longest: float = 0.05) -> int:
        """Discard input until none has come for ``quiet`` seconds, at most ``longest``; how many reads found any."""
        count, now = 0, self.now()
        silent_since, end = now, now + longest
        self._ready.clear()
        while now < min(end, silent_since + quiet):
            if found := self.take(256):
                silent_since = self.now()
                count += bool(self.echo.without(found))
            now = self.now()
        return count

    def named(self, error: Exception) -> PortError | None:
        """What the port raised, as an error of ours; None where it is something else."""
        if isinstance(error, serial.SerialTimeoutException):
            return StalledError(
                f"the adapter at {self.port_name} takes no more bytes; unplug it, plug it in again and restart."
            )
        # pyserial reads from None where another thread closed the port
        if isinstance(error, GONE) or (isinstance(error, TypeError) and not self.is_open):
            return UnpluggedError(
                f"the adapter at {self.port_name} is gone; plug it in, check its power, and start again."
            )
        return None


def _cannot_open(path: str, error: BaseException) -> PortError:
    number = getattr(error, "errno", None)
    if number in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK) or "exclusively lock" in str(error):
        return PortBusyError(f"another program has {path}; stop it, or give another port.")
    if number == errno.ENOENT:
        return PortError(f"there is no port {path}; plug the adapter in, or give its name as port=<path>.")
    if number == errno.EACCES:
        return PortError(f"you may not use {path}; join the group that owns it (on Debian: dialout), and log in again.")
    return PortError(f"{path} cannot be opened as a serial port: {error}.")
