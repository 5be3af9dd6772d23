"""How long work tells a person what it does."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str], None]
"""Is told what goes on now; a :class:`Milestone` is to stay in sight."""


class Milestone(str):
    """Something that was reached: it stays in sight when the next thing goes on."""
