"""A dead-man's switch on the keyboard: the run goes on only while a key is pressed again and again."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import time
from collections.abc import Callable, Iterator

from ..actuators.errors import SealegsError

KEY = b" "
PATIENCE = 0.7  # [s] without the key; a held key repeats after at most half a second
START = 5.0  # [s] to press it for the first time


class DeadMan:
    """Asked in every cycle; never blocks."""

    def __init__(self, descriptor: int, clock: Callable[[], float] = time.monotonic) -> None:
        """Watch the keys that arrive on ``descriptor``."""
        self._descriptor, self._clock = descriptor, clock
        self._until: float | None = None  # nobody has asked yet

    def __call__(self) -> str | None:
        """None while the key is pressed; else why the run is to end."""
        if self._until is None:
            self._until = self._clock() + START
        while select.select([self._descriptor], [], [], 0.0)[0]:
            keys = os.read(self._descriptor, 64)
            if not keys:
                return "the terminal was closed"
            if KEY in keys:
                self._until = self._clock() + PATIENCE
        return None if self._clock() < self._until else "the dead-man's switch was let go"


@contextlib.contextmanager
def keyboard(wanted: bool) -> Iterator[Callable[[], str | None]]:
    """A dead-man's switch on this terminal, or, where it is not ``wanted``, one that never lets go.

    Raises:
        SealegsError: there is no keyboard.
    """
    if not wanted:
        yield lambda: None
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
