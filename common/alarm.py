"""What a person must know at once, printed on stderr whatever becomes of the terminal.

A terminal may be closed (EIO), stopped by Ctrl-S, or stalled behind ssh. Who has a robot to stop must not fail or wait
for that: lines are printed by a thread of their own. Who prints elsewhere afterwards lets it :meth:`Alarm.flush` first.
"""

from __future__ import annotations

import atexit
import queue
import sys
import threading
from contextlib import suppress

LAST = 1.0  # [s] that the end of the process waits for lines


class Alarm:
    """Prints lines on stderr; never raises, never waits for long."""

    def __init__(self) -> None:
        self._lines: queue.SimpleQueue[tuple[str, threading.Event]] = queue.SimpleQueue()
        self._latest = threading.Event()
        self._latest.set()
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None

    def __call__(self, line: str) -> None:
        """Print a line soon; it is not waited for."""
        with self._lock:
            if self._thread is None:
                self._thread = threading.Thread(target=self._print, daemon=True)
                self._thread.start()
                atexit.register(self.flush)
            self._latest = threading.Event()
            self._lines.put((line, self._latest))

    def flush(self, seconds: float = LAST) -> None:
        """Wait at most so long [s] for the lines so far."""
        self._latest.wait(seconds)

    def _print(self) -> None:
        while True:
            line, printed = self._lines.get()
            with suppress(OSError, ValueError):  # ValueError: it was closed
                print(line, file=sys.stderr, flush=True)
            printed.set()


to_stderr = Alarm()
"""Prints what must not wait for the end of a run."""
