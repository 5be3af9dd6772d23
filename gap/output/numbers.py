"""Numbers for people: rounded by their interval, with a real minus sign, never apart from their unit."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from ..measure.named import Value

MINUS = "\N{MINUS SIGN}"
GLUE = "\N{NO-BREAK SPACE}"
INTERVAL_DIGITS = 2  # significant digits of half an interval's width that a value is rounded to
UNIT = re.compile(r"(?<=\d) (?=(?:%|per mille|[mk]?(?:rad|N\.m|N|s|m|g|A|V|W|Hz|K|kg|ohm)(?![A-Za-z])|1/))")


def number(value: float, digits: int = 4) -> str:
    """A number to that many significant digits."""
    if not math.isfinite(value):
        return "none"
    return f"{value:.{digits}g}".replace("-", MINUS)


def percent(share: float) -> str:
    """A share: whole percent, tenths below ten; what is not zero is never told as zero."""
    if 0.0 < share < 5e-4:
        return "< 0.1 %"
    return f"{100.0 * share:.0f} %" if share >= 0.0995 or share == 0.0 else f"{100.0 * share:.1f} %"


def sureness(confidence: float) -> str:
    """A confidence in whole percent; no resampling makes one certain."""
    return f"{math.floor(100.0 * min(max(confidence, 0.0), 0.99) + 1e-9)} %"


def decimals(value: Value) -> int | None:
    """Places behind the point that the interval is worth; None where it has no width."""
    half = 0.5 * (value.high - value.low)
    if not math.isfinite(half) or half <= 0.0:
        return None
    return INTERVAL_DIGITS - 1 - math.floor(math.log10(half))


def rounded(value: Value) -> tuple[str, str, str]:
    """Value, low and high end, to two significant digits of half the interval's width."""
    places = decimals(value)
    if places is None:
        return number(value.value), number(value.low), number(value.high)
    return _fixed(value.value, places), _fixed(value.low, places), _fixed(value.high, places)


class ToldValue(NamedTuple):
    """A value as text: rounded, with its interval (empty where that has no width), unit, and what the model had."""

    value: str
    interval: str
    unit: str
    nominal: str

    @property
    def size(self) -> str:
        """With its unit."""
        return f"{self.value} {self.unit}".rstrip()


def told_value(value: Value) -> ToldValue:
    """A value for people; without a unit for a number that has none."""
    found, low, high = rounded(value)
    interval = f"{low} to {high}" if value.low < value.high else ""
    return ToldValue(found, interval, "" if value.unit in ("1", "-") else value.unit, number(value.nominal))


def glued(text: str) -> str:
    """Text in which no line ends between a value and its unit."""
    return UNIT.sub(GLUE, text)


def _fixed(value: float, places: int) -> str:
    if places > 8:  # an interval that narrow is told by powers of ten
        return number(value, 6)
    value = round(value, places) + 0.0  # no minus before a zero
    return f"{value:.{max(places, 0)}f}".replace("-", MINUS)
