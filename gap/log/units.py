"""Units of angles, ways and their rates: the one table by which columns are converted."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from types import MappingProxyType

BEHIND: Mapping[str, str] = MappingProxyType(
    {
        "rad": "", "deg": "*pi/180", "mrad": "*1e-3", "turn": "*2*pi",
        "m": "", "mm": "*1e-3", "cm": "*1e-2",
        "rad/s": "", "deg/s": "*pi/180", "rpm": "*2*pi/60", "turn/s": "*2*pi", "mrad/s": "*1e-3",
        "m/s": "", "mm/s": "*1e-3",
    }
)  # fmt: skip
"""Expression behind a column of a unit that makes it rad, m, rad/s or m/s."""


def _factor(text: str) -> float:
    value = 1.0
    for sign, number in re.findall(r"([*/])([^*/]+)", text):
        size = math.pi if number == "pi" else float(number)
        value = value * size if sign == "*" else value / size
    return value


FACTOR: Mapping[str, float] = MappingProxyType({unit: _factor(text) for unit, text in BEHIND.items()})
"""The same as a number."""


def factors(*units: str) -> dict[str, float]:
    """The factors of some units."""
    return {unit: FACTOR[unit] for unit in units}
