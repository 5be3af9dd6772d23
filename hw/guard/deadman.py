"""A dead-man's switch on the keyboard: the run goes on only while a key is pressed again and again."""

from __future__ import annotations

import contextlib
import math
import os
import select
import sys
import time
from collections.abc import Callable, Iterator

from ...common.errors import SealegsError

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
