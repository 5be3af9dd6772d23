"""The compiler of the loops that replay a joint without an engine."""

from __future__ import annotations

from ...actuators.compiled import Compiler, pointer

compiled = Compiler("the replay of a joint", "about a minute")

__all__ = ["compiled", "pointer"]
