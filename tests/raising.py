"""A function that fails, in the place of one that may."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def raising(error: Exception) -> Callable[..., Any]:
    def fails(*given: Any, **more: Any) -> Any:
        raise error

    return fails
