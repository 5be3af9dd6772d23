"""The compiler of the loops that replay a joint without an engine."""

from __future__ import annotations

from typing import Any

from ...actuators.compiled import Compiler
from ...actuators.compiled import pointer as _pointer

compiled = Compiler("the replay of a joint", "about a minute")
pointer: Any = _pointer  # a type checker sees two arguments, of which numba gives the first

__all__ = ["compiled", "pointer"]
