"""What the machine alone costs a loop: a process that only wakes at the same rate and spins, and time stolen from it.

A loop that shares its computer, or whose computer is a virtual machine, is late through no fault of its own. This one
has no bus, no log and no other process to wait for: what it misses, no loop of that rate and that much work keeps here.
"""

from __future__ import annotations

import multiprocessing
import signal
import time
from dataclasses import asdict
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from sealegs.hw.bus.clock import Metronome

STAT = Path("/proc/stat")
STEAL, COUNTED = 7, 8  # place of the stolen time behind the name of a row, and columns that add up to all time; proc(5)
NOWHERE = float("nan")


def spin(rate: float, seconds: float, need: float, connection: Connection) -> None:
    """Wake at a fixed rate and keep the processor for a while in each cycle; sends the timing.

    Args:
        rate: [Hz].
        seconds: for how long.
        need: processor time that a cycle takes [s].
        connection: for the timing.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # its parent ends it
    metronome = Metronome(rate)
    end = metronome.wait() + seconds
    while metronome.wait() < end:
        until = time.thread_time() + need  # who is interrupted has still to do the rest
        while time.thread_time() < until:
            pass
        metronome.done(NOWHERE, NOWHERE)
    connection.send(asdict(metronome.timing()))


def bare_loop(rate: float, seconds: float, need: float) -> dict[str, Any]:
    """Timing of :func:`spin` in a process of its own, with the share of stolen time meanwhile."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=spin, args=(rate, seconds, need, there), daemon=True)
    process.start()
    there.close()
    before = processor_times()
    try:
        timing = here.recv()
    finally:
        process.terminate()
        process.join()
    return {**timing, "need": need, "stolen": stolen_share(before, processor_times())}


def processor_times() -> tuple[int, int] | None:
    """Time that the hypervisor gave to others, and all time, of all processors [ticks]; None: nobody counts it."""
    try:
        columns = [int(word) for word in STAT.read_text().splitlines()[0].split()[1 : 1 + COUNTED]]
    except (OSError, ValueError, IndexError):
        return None
    return (columns[STEAL], sum(columns)) if len(columns) == COUNTED else None


def stolen_share(before: tuple[int, int] | None, after: tuple[int, int] | None) -> float | None:
    """Stolen time over all time between two counts; None: not known."""
    if before is None or after is None or after[1] <= before[1]:
        return None
    return (after[0] - before[0]) / (after[1] - before[1])
