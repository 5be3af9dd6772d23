"""Turn published recordings of real machines into measured logs. ``sealegs import --help``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from .ak80 import convert_ak80
from .so101 import convert_so101
from .xl330 import convert_xl330

CONVERTERS: dict[str, Callable[[Path, Path], list[Path]]] = {
    "xl330": convert_xl330,
    "so101": convert_so101,
    "ak80": convert_ak80,
}

__all__ = ["CONVERTERS", "convert_ak80", "convert_so101", "convert_xl330"]
