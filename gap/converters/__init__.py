"""Turn published recordings of real machines into measured logs. ``python -m gap.converters --help``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from gap.converters.ak80 import convert_ak80
from gap.converters.so101 import convert_so101
from gap.converters.xl330 import convert_xl330

CONVERTERS: dict[str, Callable[[Path, Path], list[Path]]] = {
    "xl330": convert_xl330,
    "so101": convert_so101,
    "ak80": convert_ak80,
}

__all__ = ["CONVERTERS", "convert_ak80", "convert_so101", "convert_xl330"]
