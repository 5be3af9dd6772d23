"""A person's wish to stop, however it comes."""

from __future__ import annotations

import contextlib
import math
import os
import select
import signal
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from ...common.errors import SealegsError
from ..bus.interface import Bus
from .supervisor import Supervisor


class Stop:
    """A person's wish to stop: Ctrl-C, a closed terminal, a polite kill, or the dead-man's switch let go.

    Attributes:
        reason: None while nobody wants to stop.
        asked: how often it was asked for; once more ends what the first one began, such as a wait.
        emergency: whether torque must go off at once, however the run was to end.
    """

    def __init__(self) -> None:
        self.reason: str | None = None
        self.asked = 0
        self.emergency = False

    def ask(self, reason: str) -> None:
        """Stop at the end of the cycle."""
        self.reason = self.reason or reason
        self.asked += 1

    def press(self, reason: str) -> None:
        """Stop now, without sitting down or holding."""
        self.emergency = True
        self.reason = self.reason or reason  # it ends no wait: who presses wants the servos released

    @contextlib.contextmanager
    def on_signals(self) -> Iterator[None]:
        """Turn signals into a wish to stop; a second Ctrl-C cannot break off the way to a safe end."""
        names = {"SIGINT": "Ctrl-C", "SIGTERM": "SIGTERM", "SIGHUP": "the terminal was closed"}
        previous: dict[int, Any] = {}
        for name, reason in names.items():
            if (number := getattr(signal, name, None)) is not None:
                with contextlib.suppress(ValueError):  # not in the main thread: whoever runs it there stops it himself
                    previous[number] = signal.signal(number, lambda *_, reason=reason: self.ask(reason))
        try:
            yield
        finally:
            for number, handler in previous.items():
                signal.signal(number, handler)


# --- an emergency stop: a key, or a file descriptor that somebody else's button writes to or closes ------------------
#
# It waits in a thread of its own and switches torque off itself, without waiting for the loop's cycle to end. Where
# the loop is over or dead, the supervisor looks at the descriptor.

REASON = "the emergency stop was pressed"


class EmergencyStop:
    """Watches one descriptor until it is closed.

    Attributes:
        thread: number of the thread that does so, as the system counts.
    """

    def __init__(self, descriptor: int, stop: Stop, act: Callable[[], object]) -> None:
        """Watch from now on.

        Args:
            descriptor: that becomes readable, or is closed at its other end.
            stop: told.
            act: switches torque off; called from another thread.
        """
        self._descriptor, self._stop, self._act = descriptor, stop, act
        self._wake, self._woken = os.pipe()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()
        self.thread = self._thread.native_id or 0

    def _watch(self) -> None:
        try:
            poll = select.poll()
            for descriptor in (self._descriptor, self._wake):
                poll.register(descriptor, select.POLLIN)
            found = dict(poll.poll())
        except Exception:  # whatever it is: an emergency stop that breaks must stop
            found = {}
        if self._wake in found:
            return
        self._stop.press(REASON)
        self._act()
        if found.get(self._descriptor, 0) & select.POLLIN:
            with contextlib.suppress(OSError):
                os.read(self._descriptor, 64)  # a key is for nobody else

    def close(self) -> None:
        """Watch no longer."""
        os.close(self._woken)  # its other end becomes readable
        self._thread.join(1.0)
        os.close(self._wake)


def check_descriptor(number: int) -> None:
    """Make sure that a button can be behind a file descriptor.

    Raises:
        SealegsError: it is not open, or a file on a disk, which nobody presses.
    """
    try:
        mode = os.fstat(number).st_mode
    except (OSError, OverflowError):
        raise SealegsError(
            f"estop is {number}, but no file descriptor {number} is open; open it in the same command, such as "
            "estop=3 3< /dev/hidraw0."
        ) from None
    if stat.S_ISREG(mode) or stat.S_ISDIR(mode):
        raise SealegsError(
            f"estop is {number}, but file descriptor {number} is a file on a disk; give a button's device or a pipe."
        )


def release(supervisor: Supervisor | None, bus: Bus, ids: Sequence[int]) -> None:
    """Switch torque off; a supervisor hears first, since it goes on where the bus cannot."""
    if supervisor is not None:
        supervisor.release_only()
        supervisor.resting()
    bus.torque_off(ids)


@contextlib.contextmanager
def emergency_stop(descriptor: int | None, stop: Stop, act: Callable[[], object]) -> Iterator[list[int]]:
    """Watch ``descriptor`` for the length of a ``with``, which gets the thread that does so; None: nothing."""
    if descriptor is None:
        yield []
        return
    with contextlib.closing(EmergencyStop(descriptor, stop, act)) as watcher:
        yield [watcher.thread]


# --- A dead-man's switch on the keyboard: the run goes on only while a key is pressed again and again ----------------

KEY = b" "
LET_GO = "the dead-man's switch was let go"
PATIENCE = 0.7  # [s] without the key; a held key repeats after at most half a second
START = 5.0  # [s] to press it for the first time; no torque comes on before
ASKING = 0.05  # [s] between two looks whether somebody else ends the wait


class DeadMan:
    """Asked in every cycle; never blocks."""

    def __init__(self, descriptor: int, clock: Callable[[], float] = time.monotonic) -> None:
        """Watch the keys that arrive on ``descriptor``."""
        self._descriptor, self._clock = descriptor, clock
        self._until = -math.inf  # not pressed yet

    def armed(self, stopped: Callable[[], bool] = lambda: False) -> str | None:
        """As when called, but waits :data:`START` for the first press, unless somebody stops that."""
        end = self._clock() + START
        while self._until == -math.inf and self() == LET_GO:
            if stopped():
                return None
            if self._clock() >= end:
                return f"space was not pressed within {START:g} s"
            select.select([self._descriptor], [], [], ASKING)
        return self()

    def __call__(self) -> str | None:
        """None while the key is pressed; else why the run is to end."""
        while select.select([self._descriptor], [], [], 0.0)[0]:
            keys = os.read(self._descriptor, 64)
            if not keys:
                return "the terminal was closed"
            if KEY in keys:
                self._until = self._clock() + PATIENCE
        return None if self._clock() < self._until else LET_GO


@contextlib.contextmanager
def keyboard(wanted: bool) -> Iterator[DeadMan | None]:
    """A dead-man's switch on this terminal; None where it is not ``wanted``.

    Raises:
        SealegsError: there is no keyboard.
    """
    if not wanted:
        yield None
        return
    with pressed_key("dead_man=true") as descriptor:
        yield DeadMan(descriptor)


@contextlib.contextmanager
def pressed_key(key: str = "estop=key") -> Iterator[int]:
    """The terminal's keyboard, each key at once, as a file descriptor.

    Args:
        key: that asked for it, for the message.

    Raises:
        SealegsError: there is no keyboard.
    """
    try:
        import termios
        import tty

        descriptor = sys.stdin.fileno()
        before = termios.tcgetattr(descriptor)
    except (ImportError, OSError, ValueError, termios.error):  # pyright: ignore[reportPossiblyUnboundVariable]
        raise SealegsError(f"{key} needs a terminal with a keyboard; there is none here.") from None
    tty.setcbreak(descriptor)
    try:
        yield descriptor
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
