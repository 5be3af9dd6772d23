"""An emergency stop: a key, or a file descriptor that somebody else's button writes to or closes.

It waits in a thread of its own and switches torque off itself, without waiting for the loop's cycle to end. Where the
loop is over or dead, the supervisor looks at the descriptor.
"""

from __future__ import annotations

import contextlib
import os
import select
import stat
import threading
from collections.abc import Callable, Iterator, Sequence

from ...common.errors import SealegsError
from ..bus.interface import Bus
from .stop import Stop
from .supervisor import Supervisor

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
