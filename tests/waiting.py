"""Waiting for what happens in another thread or process: a test asserts that it happened, and not when."""

from __future__ import annotations

import subprocess
import threading
import time
from collections.abc import Callable

import pytest

GIVE_UP = 300.0  # [s] after which a stuck test ends, however busy the machine is
PAUSE = 0.01  # [s] between two looks


def wait_until(
    happened: Callable[[], object],
    worker: subprocess.Popen[str] | threading.Thread | None = None,
    said: Callable[[], object] = str,
) -> None:
    """Wait for an event; the test fails where it cannot happen any more.

    Args:
        happened: whether it has.
        worker: who makes it happen: without it there is nothing to wait for.
        said: what tells a person more where it does not happen; of a process what it printed, where that is left out.
    """
    end = time.monotonic() + GIVE_UP
    while not happened():
        if worker is not None and not _works(worker) and not happened():
            printed = worker.communicate() if isinstance(worker, subprocess.Popen) else ""
            pytest.fail(f"it ended before what was waited for: {said()} {printed}")
        if time.monotonic() > end:
            pytest.fail(f"it did not happen in {GIVE_UP:g} s: {said()}")
        time.sleep(PAUSE)


def _works(worker: subprocess.Popen[str] | threading.Thread) -> bool:
    return worker.is_alive() if isinstance(worker, threading.Thread) else worker.poll() is None
