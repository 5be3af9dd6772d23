"""Real-time priority of the loop, so that other programs do not delay it."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence

from ...common.errors import SealegsError


@contextlib.contextmanager
def realtime(priority: int | None, threads: Sequence[int] = ()) -> Iterator[None]:
    """Run with a first-in-first-out priority of 1 to 99 for the length of a ``with``; None: as any program.

    Threads and processes that are started meanwhile, such as one that draws, are as those of any program.

    Args:
        priority: 1 to 99.
        threads: further threads of this process that a cycle waits for, or that end it, as the system numbers them.

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
    everyone = (0, *threads)  # 0: the thread that calls
    before = [(os.sched_getscheduler(thread), os.sched_getparam(thread)) for thread in everyone]

    def give_back() -> None:
        for thread, (policy, parameters) in zip(everyone, before, strict=True):
            with contextlib.suppress(OSError):  # a thread may have ended
                os.sched_setscheduler(thread, policy & ~os.SCHED_RESET_ON_FORK, parameters)

    try:
        for thread in everyone:
            os.sched_setscheduler(thread, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except PermissionError:
        give_back()
        raise SealegsError(
            f"the system grants no real-time priority {priority}; allow it in this terminal: `sudo prlimit --pid $$ "
            f"--rtprio={priority}`, or leave realtime= out."
        ) from None
    try:
        yield
    finally:
        give_back()
