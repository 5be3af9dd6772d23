"""An emergency stop: a key, or a file descriptor that somebody else's button writes to or closes.

It waits in a thread of its own and switches torque off itself, without waiting for the loop's cycle to end.
"""

from __future__ import annotations

import contextlib
import os
import select
import threading
from collections.abc import Callable, Iterator

from .stop import Stop

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
        ready, _, _ = select.select([self._descriptor, self._wake], [], [])
        if self._wake not in ready:
            self._stop.press(REASON)
            self._act()
            with contextlib.suppress(OSError):
                os.read(self._descriptor, 64)  # a key is for nobody else

    def close(self) -> None:
        """Watch no longer."""
        os.close(self._woken)  # its other end becomes readable
        self._thread.join(1.0)
        os.close(self._wake)


@contextlib.contextmanager
def emergency_stop(descriptor: int | None, stop: Stop, act: Callable[[], object]) -> Iterator[list[int]]:
    """Watch ``descriptor`` for the length of a ``with``, which gets the thread that does so; None: nothing."""
    if descriptor is None:
        yield []
        return
    with contextlib.closing(EmergencyStop(descriptor, stop, act)) as watcher:
        yield [watcher.thread]
