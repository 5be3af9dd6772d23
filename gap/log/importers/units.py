"""Units as foreign files write them, each understood to its last letter, and measured by pint.

A unit has one spelling here: ``deg``, ``mA``, ``kgf.cm``, ``0.1 deg``, ``deg/min``. A prefix or a number that is
dropped would make a wrong log, so what is not understood whole is no unit.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pint

from ....common.documents import read_yaml
from ..types import BEHIND

TABLE = read_yaml(Path(__file__).with_name("units.yaml"))


def _by_word(section: str) -> dict[str, str]:
    return {word: unit for unit, words in TABLE[section].items() for word in words.split()}


WORDS, ALONE, FORCES, ARMS = (_by_word(section) for section in ("words", "in_brackets", "forces", "arms"))
"""Units by the words that say them: anywhere, in brackets, and as force and arm of a torque."""
PREFIXES, PINT = _by_word("prefixes"), _by_word("pint")
UNIT_OR_NAME = ("rot", "rotation", "cycle", "cycles")
"""Words that, outside brackets, name a joint as often as they say turns."""
TEMPERATURES = {"degC": "{}", "0.1 degC": "{}*0.1", "degF": "({} - 32)/1.8", "K": "({} - 273.15)"}
"""Expression of a temperature by its unit."""
PREFIXED = ("rad", "deg", "turn", "m", "s", "A", "V", "N", "N.m", "rpm")
"""Units that stand behind a prefix."""
QUANTITIES = {"way": "meter", "speed": "meter/second", "rate": "1/second", "time": "second", "current": "ampere",
              "voltage": "volt", "angle": "radian", "force": "newton", "torque": "newton*meter"}  # fmt: skip
"""Quantities by a unit of each."""
_BASE = "[numcdk]?(?:rad|deg|turn|rpm|[msAVN])|arcmin|arcsec|min|[hd]|in|ft|kgf|gf|lbf|ozf"
SPELT = re.compile(rf"(?:{_BASE})(?:\.(?:{_BASE}))?(?:/(?:s|min|h))?")
"""Units in their spelling here."""
DIGITS = r"(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?"
_FORCE, _ARM = ("|".join(sorted(words, key=len, reverse=True)) for words in (FORCES, ARMS))
TORQUE = re.compile(
    rf"(?P<force>{_FORCE})[ .*·⋅_-]?(?P<arm>{_ARM})|(?P<arm2>in|ft|foot|inch)[ .*·⋅_-]?(?P<force2>lbs?|lbf|ozf?)"
)
NUMBER = re.compile(r"(10(?:\^|\*\*)[-+]?\d+|\d*[.,]?\d+(?:e[-+]?\d+)?|pi|π|1/\d+)\s*[*x·]?\s*(?=[^\d\s.,/^*])")
RATE = re.compile(r"(.+?)\s*(?:/|\bper\b|p(?=s\Z))\s*(?:(s|sec|second)|(min|minute)|(h|hour))\Z")
LONGEST_UNIT = 60
"""Letters of what may be a unit: the time of its patterns grows with the square of them."""
PREFIX = re.compile(rf"((?:{'|'.join(PREFIXES)})[ -]?|[numcdk])(.+)\Z")
LIKE = re.compile(r".+(deg|degs|degrees?|rads?|radians?|turns|revs|rotations|revolutions|rpm|°)\Z")


@dataclass(frozen=True)
class Measure:
    """What a unit measures.

    Attributes:
        quantity: ``angle``, ``way``, ``rate``, ``speed``, ``time``, ``current``, ``voltage``, ``force``, ``torque``.
        behind: expression behind a column that makes it rad, m, s, A, V, N, N.m, or one of these a second.
        factor: the same as a number.
    """

    quantity: str
    behind: str
    factor: float


@cache
def _registry() -> tuple[pint.UnitRegistry, dict[Any, str]]:
    """Pint's units, and quantities by their dimensions."""
    units = pint.UnitRegistry()
    return units, {units.Unit(unit).dimensionality: quantity for quantity, unit in QUANTITIES.items()}


@cache
def measure(unit: str) -> Measure | None:
    """What a unit in its spelling here measures; None for counts, shares, temperatures and what is no unit."""
    number, _, plain = unit.rpartition(" ")
    if not SPELT.fullmatch(plain) or not (number in ("", "pi") or re.fullmatch(DIGITS, number)):
        return None
    size = math.pi if number == "pi" else float(number or 1.0)
    known = re.sub(r"[A-Za-z]+", lambda word: PINT.get(word[0], word[0]), plain.replace(".", "*"))
    units, quantities = _registry()
    base = units.Quantity(1.0, known).to_base_units()
    quantity = quantities.get(base.dimensionality)
    if quantity is None:
        return None
    factor = float(base.magnitude)
    behind = BEHIND.get(plain, "" if factor == 1.0 else f"*{_written(factor)}")
    if number and plain not in BEHIND:
        behind, number = f"*{_written(size * factor)}", ""
    return Measure(quantity, f"*{number}{behind}" if number else behind, size * factor)


def _written(factor: float) -> str:
    """A factor with its digits, a power of ten as 1e-3."""
    power = round(math.log10(factor)) if factor > 0.0 else 0
    return f"1e{power}" if power <= -2 and math.isclose(factor, 10.0**power, rel_tol=1e-12) else f"{factor:.10g}"


def measures(unit: str, *quantities: str) -> Measure | None:
    """What a unit measures where that is one of some quantities, else None."""
    found = measure(unit)
    return found if found and found.quantity in quantities else None


def unit_of(text: str) -> str:
    """The unit that a text is, in brackets or without; empty where it is none that is understood whole."""
    if len(text) > LONGEST_UNIT:
        return ""
    plain = text.strip().strip("[]()").translate(str.maketrans("µμ", "uu")).lower()
    return _unit(" ".join(plain.split()))


def _unit(text: str) -> str:
    if found := ALONE.get(text) or WORDS.get(text):
        return found
    if match := NUMBER.match(text):
        unit = _unit(text[match.end() :].strip())
        over, _, under = match[1].replace(",", ".").replace("10^", "1e").replace("10**", "1e").partition("/")
        number = "pi" if over in ("pi", "π") else f"{float(over) / float(under or 1.0):.10g}"
        return f"{number} {unit}" if unit and " " not in unit and (measure(unit) or unit in TEMPERATURES) else ""
    if match := TORQUE.fullmatch(text):
        force, arm = FORCES[match["force"] or match["force2"]], ARMS[match["arm"] or match["arm2"]]
        return f"{force}.{arm}" if force != "gf" or arm == "cm" else ""  # g.m may be of an inertia
    if match := RATE.match(text):
        unit = _unit(match[1])
        rate = f"{unit}/{'s' if match[2] else 'min' if match[3] else 'h'}"
        known = measures(unit, "angle", "way") and measure(rate)
        return ("rpm" if rate == "turn/min" else rate) if known else ""
    if match := PREFIX.match(text):
        base = _unit(match[2])
        return PREFIXES.get(match[1].strip(" -"), match[1]) + base if base in PREFIXED else ""
    return ""


def like_a_unit(text: str) -> bool:
    """Whether a text that is no unit as a whole ends as one does, so that a unit may be meant."""
    words = [
        word for word in re.findall(r"[^\W\d_]+|°|%", text.lower()) if len(word) > 1 or re.search(r"[\d/*·^]", text)
    ]
    known = [word for word in words if WORDS.get(word, "tick") != "tick" or word in FORCES or _unit(word)]
    return any(LIKE.match(word) for word in words) or bool(known and not {WORDS.get(word) for word in known} & {"tick"})
