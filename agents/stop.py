"""Stop requests: after the first, the current step ends; the second does not wait."""

from __future__ import annotations

import signal
import sys
import threading
from types import FrameType
from typing import Any


class StopSignals:
    """Context in which Ctrl-C and SIGTERM set ``asked`` instead of interrupting a step; a second Ctrl-C interrupts it.

    Attributes:
        asked: whether a stop was asked for.
    """

    def __init__(self) -> None:
        self.asked = False
        self._waits = True
        self._previous: dict[int, Any] = {}

    def __enter__(self) -> StopSignals:
        if threading.current_thread() is threading.main_thread():  # Python lets no other thread set handlers
            for number in (signal.SIGINT, signal.SIGTERM):
                self._previous[number] = signal.signal(number, self._ask)
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def at_once(self) -> None:
        """From here on the first stop interrupts: nothing is in progress that would be lost.

        Raises:
            KeyboardInterrupt: a stop was requested before.
        """
        if self.asked:
            raise KeyboardInterrupt
        self._waits = False

    def _ask(self, number: int, frame: FrameType | None) -> None:
        if self.asked or not self._waits:
            raise KeyboardInterrupt
        self.asked = True
        print("\nStopping after this step; once more to stop at once.", file=sys.stderr, flush=True)
