"""Real-time priority of the loop, so that other programs do not delay it."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator

from ..actuators.errors import SealegsError


@contextlib.contextmanager
def realtime(priority: int | None) -> Iterator[None]:
    """Run with a first-in-first-out priority of 1 to 99 for the length of a ``with``; None: as any program.

    Raises:
        SealegsError: the system has none, or does not grant it.
    """
    if priority is None:
        yield
        return
    if not hasattr(os, "sched_setscheduler"):
        raise SealegsError("realtime= needs Linux; leave it out here.")
    if not 1 <= priority <= 99:
        raise SealegsError(f"realtime is {priority}; it must be between 1 and 99.")
    policy, before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except PermissionError:
        raise SealegsError(
            f"the system grants no real-time priority {priority}; allow it in this terminal: `sudo prlimit --pid $$ "
            f"--rtprio={priority}`, or leave realtime= out."
        ) from None
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, policy & ~os.SCHED_RESET_ON_FORK, before)
