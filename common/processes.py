"""Processes that work for another one, and the cores that they have."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager


def cores() -> int:
    """Cores that this process may use, which a container or a batch system may have made fewer than there are."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def end_with_parent(end: Callable[[], object]) -> None:
    """Call ``end`` once the process that started this one is gone, a killed one included: nobody waits for it."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def wait() -> None:
        parent.join()
        end()

    threading.Thread(target=wait, daemon=True).start()


def exit_with_parent() -> None:
    """End this process at once when the one that started it is gone."""
    end_with_parent(lambda: os._exit(1))


@contextmanager
def worker_pool(
    size: int, begin: Callable[..., object] = exit_with_parent, arguments: tuple[object, ...] = ()
) -> Iterator[ProcessPoolExecutor]:
    """So many fresh processes, each of which calls ``begin`` first; none outlives an exception or an interrupt."""
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(size, multiprocessing.get_context("spawn"), begin, arguments)
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
        raise
    pool.shutdown()
