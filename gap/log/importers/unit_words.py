"""Units as foreign files write them, each understood whole: a number, an SI prefix, a unit, and what it is per.

A unit has one spelling here: ``deg``, ``mA``, ``kgf.cm``, ``0.1 deg``, ``deg/min``. What is not understood to its last
letter is no unit: a prefix or a number that is dropped would make a wrong log.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache

from ..units import BEHIND
from .expression import evaluate

PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "d": 0.1, "k": 1e3}
SPELT_PREFIXES = {"nano": "n", "micro": "u", "milli": "m", "centi": "c", "deci": "d", "kilo": "k"}
BASES = {
    "rad": ("angle", BEHIND["rad"]), "deg": ("angle", BEHIND["deg"]), "turn": ("angle", BEHIND["turn"]),
    "arcmin": ("angle", "*pi/10800"), "arcsec": ("angle", "*pi/648000"),
    "m": ("way", BEHIND["m"]), "in": ("way", "*0.0254"), "ft": ("way", "*0.3048"),
    "rpm": ("rate", BEHIND["rpm"]),
    "s": ("time", ""), "min": ("time", "*60"), "h": ("time", "*3600"), "d": ("time", "*86400"),
    "A": ("current", ""), "V": ("voltage", ""),
    "N": ("force", ""), "kgf": ("force", "*9.80665"), "gf": ("force", "*9.80665e-3"),
    "lbf": ("force", "*4.4482216152605"), "ozf": ("force", "*0.27801385095378125"),
    "N.m": ("torque", ""),
}  # fmt: skip
"""Quantity of a unit, and the expression behind a column that makes it rad, m, s, A, V, N, N.m, or one of these a
second. The inch, the foot, the pound and standard gravity are exact by definition (NIST SP 811, 2008, appendix B.8):
0.0254 m, 0.3048 m, 0.45359237 kg and 9.80665 m/s2; an ounce is 1/16 pound."""
PREFIXED = ("rad", "deg", "turn", "m", "s", "A", "V", "N", "N.m", "rpm")
"""Units that stand behind a prefix."""
LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}  # [m]
PER = {"s": "", "min": "/60", "h": "/3600"}
"""Expression behind what is per second, minute or hour."""
RATES = {"angle": "rate", "way": "speed"}

UNITS = {
    "deg": "deg", "degree": "deg", "degrees": "deg", "degs": "deg", "grad": "deg", "rad": "rad", "rads": "rad",
    "radian": "rad", "radians": "rad", "turn": "turn", "turns": "turn", "rev": "turn", "revs": "turn", "rpm": "rpm",
    "revolution": "turn", "revolutions": "turn", "rots": "turn", "rotations": "turn",
    "arcmin": "arcmin", "arcsec": "arcsec",
    "dps": "deg/s", "rps": "turn/s", "tick": "tick", "ticks": "tick", "count": "tick", "counts": "tick",
    "steps": "tick", "raw": "tick", "inc": "tick", "incr": "tick", "increments": "tick", "erpm": "erpm",
    "msec": "ms", "millis": "ms", "usec": "us", "micros": "us",
    "nsec": "ns", "nanosec": "ns", "s": "s", "sec": "s", "secs": "s", "second": "s", "seconds": "s",
    "minutes": "min", "hours": "h", "days": "d", "nm": "N.m", "n": "N", "newton": "N", "newtons": "N", "a": "A",
    "amp": "A", "amps": "A", "ampere": "A", "amperes": "A", "v": "V", "volt": "V", "volts": "V",
    "percent": "%", "pct": "%", "m": "m", "meter": "m", "meters": "m", "metre": "m", "metres": "m",
    "inch": "in", "inches": "in", "kgf": "kgf", "gf": "gf", "lbf": "lbf", "ozf": "ozf",
    "degc": "degC", "celsius": "degC", "fahrenheit": "degF", "degf": "degF", "kelvin": "K",
    "normalized": "%", "norm": "%", "grados": "deg", "degres": "deg", "gradi": "deg",
}  # fmt: skip
"""Units by the words that say them; ``erpm`` are electrical rounds, of which a motor has one a pole pair."""
NAMED_BY_UNIT = frozenset(word for word, unit in UNITS.items() if unit in ("A", "V") and len(word) > 1)
"""Words that name a signal as often as its unit: ``present_volts`` may count tenths of a volt."""
SPELT = {
    "°": "deg", "°c": "degC", "c": "degC", "°f": "degF", "f": "degF", "k": "K", "%": "%", "u/min": "rpm",
    "tr/min": "rpm", "g/min": "rpm", "1/min": "rpm", "r/min": "rpm", "rev/min": "rpm", "°/s": "deg/s",
    "degrés": "deg", "min": "min", "h": "h", "hr": "h", "d": "d", "ft": "ft", "foot": "ft", "feet": "ft", "in": "in",
    "rot": "turn", "rotation": "turn", "cycle": "turn", "cycles": "turn",
}  # fmt: skip
"""Units as they stand in brackets, where no word of a name can be meant."""
UNIT_OR_NAME = {"rot": "turn", "rotation": "turn", "cycle": "turn", "cycles": "turn"}
"""Units by words that, outside brackets, name a joint as often."""
OF_TIME = {"min": "min", "mins": "min", "minute": "min", "h": "h", "hr": "h", "hrs": "h", "hour": "h"}
"""Units by words that mean them in the name of a time alone: elsewhere ``min`` is the least."""
OF_TEMPERATURE = {"f": "degF", "k": "K", "dc": "0.1 degC"}
"""The same in the name of a temperature."""
_FORCES = {"n": "N", "mn": "mN", "un": "uN", "kn": "kN", "cn": "cN", "kg": "kgf", "kgf": "kgf", "kp": "kgf", "g": "gf",
           "gf": "gf", "lb": "lbf", "lbs": "lbf", "lbf": "lbf", "pound": "lbf", "oz": "ozf", "ozf": "ozf",
           "ounce": "ozf"}  # fmt: skip
_ARMS = {"m": "m", "cm": "cm", "mm": "mm", "in": "in", "inch": "in", "ft": "ft", "foot": "ft"}
_SIGN = r"[ .*·⋅_-]?"
_FORCE, _ARM = ("|".join(sorted(words, key=len, reverse=True)) for words in (_FORCES, _ARMS))
TORQUE = re.compile(
    rf"(?P<force>{_FORCE}){_SIGN}(?P<arm>{_ARM})|(?P<arm2>in|ft|foot|inch){_SIGN}(?P<force2>lbs?|lbf|ozf?)"
)
NUMBER = re.compile(r"(10(?:\^|\*\*)[-+]?\d+|\d*[.,]?\d+(?:e[-+]?\d+)?|pi|π|1/\d+)\s*[*x·]?\s*(?=[^\d\s.,/^*])")
PLAIN_NUMBER = re.compile(r"(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?|pi|")
"""What stands before a unit in its spelling here: a number, or nothing."""
RATE = re.compile(r"(.+?)\s*(?:/|\bper\b|p(?=s\Z))\s*(s|sec|second|min|minute|h|hour)\Z")
SHORT = re.compile(r"([numcdk])(rad|rads|deg|degs|rev|turn|rpm|amps?|meters?|nm|n\.m|[amvns])\Z")
LONG = re.compile(rf"({'|'.join(SPELT_PREFIXES)})[ -]?(.+)\Z")
ENDS = re.compile(r".+(deg|degs|degrees?|rads?|radians?|turns|revs|rotations|revolutions|rpm|°)\Z")
INSTEAD = str.maketrans({"µ": "u", "μ": "u", "′": "'", "²": "^2"})


@dataclass(frozen=True)
class Measure:
    """What a unit measures.

    Attributes:
        quantity: ``angle``, ``way``, ``rate``, ``speed``, ``time``, ``current``, ``voltage``, ``force``, ``torque``.
        behind: expression behind a column that makes it SI.
        factor: the same as a number.
    """

    quantity: str
    behind: str
    factor: float


@cache
def measure(unit: str) -> Measure | None:
    """What a unit in its spelling here measures; None for counts, shares, temperatures and what is no unit."""
    number, _, rest = unit.rpartition(" ")
    if not PLAIN_NUMBER.fullmatch(number):
        return None
    if rest in BEHIND and not number:
        quantity = "way" if rest in ("m", "mm", "cm") else "angle"
        if "/" in rest or rest == "rpm":
            quantity = "speed" if rest in ("m/s", "mm/s") else "rate"
        return _measured(quantity, BEHIND[rest])
    stem, _, per = rest.partition("/")
    if per and per not in PER:
        return None
    found = BASES.get(stem) or _torque(stem)
    times = [number] * bool(number)
    if found is None and stem[1:] in PREFIXED and stem[0] in PREFIXES:
        found = BASES[stem[1:]]
        scale = PREFIXES[stem[0]]
        times = [_written(scale * float(number))] if number not in ("", "pi") else [*times, _written(scale)]
    if found is None:
        return None
    quantity, behind = found
    if per:
        if quantity not in RATES:
            return None
        quantity, behind = RATES[quantity], behind + PER[per]
    return _measured(quantity, "".join(f"*{number}" for number in times) + behind)


def _measured(quantity: str, behind: str) -> Measure:
    return Measure(quantity, behind, float(evaluate(f"1{behind}", {}, "unit")))


def _torque(stem: str) -> tuple[str, str] | None:
    force, _, arm = stem.partition(".")
    known = measure(force) if arm in LENGTHS and force else None
    if known is None or known.quantity != "force":
        return None
    factor = known.factor * LENGTHS[arm]
    return "torque", "" if factor == 1.0 else f"*{_written(factor)}"


def _written(factor: float) -> str:
    """A factor with its digits, a power of ten as 1e-3."""
    power = round(math.log10(factor)) if factor > 0.0 else 0
    if power <= -2 and math.isclose(factor, 10.0**power, rel_tol=1e-12):
        return f"1e{power}"
    return f"{factor:.10g}"


def measures(unit: str, *quantities: str) -> Measure | None:
    """What a unit measures where that is one of some quantities, else None."""
    found = measure(unit)
    return found if found and found.quantity in quantities else None


def named_by_unit(name: str) -> bool:
    """Whether a name has, outside brackets, a word for volt or ampere that may mean the signal alone."""
    plain = re.sub("(?<=[a-z0-9])(?=[A-Z])", " ", re.sub(r"[\[(].*?[\])]", " ", name))
    return bool(NAMED_BY_UNIT & set(re.findall("[a-z]+", plain.lower())))


LONGEST = 60
"""Letters of what may be a unit: the time of its patterns grows with the square of them."""


def unit_of(text: str) -> str:
    """The unit that a text is, in brackets or without; empty where it is none that is understood whole."""
    if len(text) > LONGEST:
        return ""
    plain = " ".join(text.strip().strip("[]()").translate(INSTEAD).lower().split())
    return _unit(plain)


def _unit(text: str) -> str:
    if found := SPELT.get(text) or UNITS.get(text):
        return found
    if match := NUMBER.match(text):
        unit = _unit(text[match.end() :].strip())
        number = "pi" if match[1] in ("pi", "π") else _value(match[1])
        return f"{number} {unit}" if measure(unit) and " " not in unit else ""
    if match := TORQUE.fullmatch(text):
        force, arm = _FORCES[match["force"] or match["force2"]], _ARMS[match["arm"] or match["arm2"]]
        return f"{force}.{arm}" if force != "gf" or arm == "cm" else ""  # g.m may be of an inertia
    if match := RATE.match(text):
        unit, per = _unit(match[1]), {"sec": "s", "second": "s", "minute": "min", "hour": "h"}.get(match[2], match[2])
        rate = f"{unit}/{per}"
        return (
            ("rpm" if rate == "turn/min" else rate) if measures(unit, *RATES.values(), *RATES) and measure(rate) else ""
        )
    if match := SHORT.match(text) or LONG.match(text):
        prefix, base = SPELT_PREFIXES.get(match[1], match[1]), _unit(match[2])
        return prefix + base if base in PREFIXED else ""
    return ""


def _value(text: str) -> str:
    over, _, under = text.replace(",", ".").replace("10^", "1e").replace("10**", "1e").partition("/")
    return f"{float(over) / float(under or 1.0):.10g}"


def like_a_unit(text: str) -> bool:
    """Whether a text that is no unit as a whole ends as one does, so that a unit may be meant."""
    text = text.translate(INSTEAD).lower()
    words = [word for word in re.findall(r"[^\W\d_]+|°|%", text) if len(word) > 1 or re.search(r"[\d/*·^]", text)]
    known = [word for word in words if UNITS.get(word) or word in _FORCES or SHORT.match(word)]
    return any(ENDS.match(word) for word in words) or bool(known and not {UNITS.get(word) for word in known} & {"tick"})
