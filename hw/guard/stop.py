"""A person's wish to stop, however it comes."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator
from typing import Any


class Stop:
    """A person's wish to stop: Ctrl-C, a closed terminal, a polite kill, or the dead-man's switch let go.

    Attributes:
        reason: None while nobody wants to stop.
        asked: how often it was asked for; once more ends what the first one began, such as a wait.
        emergency: whether torque must go off at once, however the run was to end.
    """

    def __init__(self) -> None:
        self.reason: str | None = None
        self.asked = 0
        self.emergency = False

    def ask(self, reason: str) -> None:
        """Stop at the end of the cycle."""
        self.reason = self.reason or reason
        self.asked += 1

    def press(self, reason: str) -> None:
        """Stop now, without sitting down or holding."""
        self.emergency = True
        self.reason = self.reason or reason  # it ends no wait: who presses wants the servos released

    @contextlib.contextmanager
    def on_signals(self) -> Iterator[None]:
        """Turn signals into a wish to stop; a second Ctrl-C cannot break off the way to a safe end."""
        names = {"SIGINT": "Ctrl-C", "SIGTERM": "SIGTERM", "SIGHUP": "the terminal was closed"}
        previous: dict[int, Any] = {}
        for name, reason in names.items():
            if (number := getattr(signal, name, None)) is not None:
                with contextlib.suppress(ValueError):  # not in the main thread: whoever runs it there stops it himself
                    previous[number] = signal.signal(number, lambda *_, reason=reason: self.ask(reason))
        try:
            yield
        finally:
            for number, handler in previous.items():
                signal.signal(number, handler)
