"""How a diagnosis is shown: numbers rounded by their interval, never apart from their unit, and how much at once."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
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


# --- how much of a diagnosis is shown at once: nothing is decided by these numbers, which were chosen by eye ----------


@dataclass(frozen=True)
class Layout:
    """Bounds of what a person sees.

    Attributes:
        narrowest: columns of a terminal below which lines are allowed to run over.
        widest: longer lines are hard to read.
        page_samples: of a zoomable plot over all joints; keeps the page small enough to send.
        plot_samples: of one joint, at least.
        moment: that is shown of a log [s], where it is not slow.
        moment_samples: of it, at least.
        response: that is shown of a joint's answer [s].
        pause: drawn between runs [s].
        bin_samples: in a bin, at least.
        causes: with a row of their own.
        candidates: of a round.
        bar: height of one, in rows.
        wide, tall, alone: sizes of a report's first picture [inch].
    """

    narrowest: int = 40
    widest: int = 100
    page_samples: int = 16_000
    plot_samples: int = 2_000
    moment: float = 1.2
    moment_samples: int = 80
    response: float = 0.4
    pause: float = 0.5
    bin_samples: int = 12
    causes: int = 5
    candidates: int = 7
    bar: float = 0.66
    wide: tuple[float, float] = (11.0, 3.5)
    tall: tuple[float, float] = (5.2, 6.6)
    alone: tuple[float, float] = (6.0, 2.6)


LAYOUT = Layout()
