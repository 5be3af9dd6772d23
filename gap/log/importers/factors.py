"""A factor that stands beside the unit of a column's name: ``pos_deg_x10``, ``pos_deg (0.01)``, ``tenth_deg``.

Whether such values were multiplied or divided by it nobody says; a share of a unit is clear.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

BRACKETS = re.compile(r"[\[(][^\])]*[\])]")
_NUMBER = r"(?:\d*\.\d+|\d+)(?:e[-+]?\d+)?"
_LARGE = r"(?:\d*\.\d+(?:e[-+]?\d+)?|\d{2,}|\d+e[-+]?\d+)"
_BEGINS = r"(?:(?<![^\W\d_])|(?-i:(?<=[a-z])(?=[A-Z])))"  # behind no letter, or a capital that begins a word
FACTOR = re.compile(
    rf"[\[(]\s*(?:(?:[x×*·/÷]|times|div)\s*{_NUMBER}|\d*\.\d+(?:e[-+]?\d+)?|\d+e[-+]?\d+)\s*[\])]"  # (x10), (0.01)
    rf"|{_BEGINS}(?:times|div|divided[ _]?by|mult?)[ _]?{_NUMBER}"  # deg_times_100, deg_div10
    rf"|(?:(?<![^\W_])|(?-i:(?<=[a-z])(?=X))|(?<=deg|rad|rpm))x ?{_LARGE}"  # deg_x10; x1 is an axis
    rf"|(?<=deg_|rad_|rpm_)x_{_LARGE}"
    rf"|[*×·]\s*{_LARGE}"  # pos_deg*100; q*1 is wanted of joint 1
    rf"|(?<![\w.]){_NUMBER}\s*[*×·]\s*(?=[a-z])"  # 100*pos_deg
    r"|(?<![^\W_])pi(?=[ _]rad)",  # which is a computer, too
    re.IGNORECASE,
)
"""A number in a name by which its values were multiplied or divided."""
SCALED = re.compile(rf"{_BEGINS}scaled\Z", re.IGNORECASE)
"""The end of a name whose values were multiplied by nobody knows what."""
SHARES = {"tenth": "0.1", "hundredth": "0.01", "thousandth": "0.001", "deci": "0.1", "centi": "0.01", "milli": "0.001",
          "micro": "1e-6"}  # fmt: skip
SHARE = re.compile(
    rf"{_BEGINS}(?P<word>{'|'.join(SHARES)})s?(?![a-z])(?:[ _]of(?:[ _]an?)?(?![a-z]))?"
    r"|(?<![^\W_])(?<![.,/])1/(?P<under>\d+)(?=[ _]?[a-z°])",
    re.IGNORECASE,
)
"""The share of a unit that a value counts: ``tenth_deg``, ``1/100 deg``, ``milli_rad``."""
COUNTED = re.compile(r"x\d*[1-9]\d*[1-9]|x[2-9]0+", re.IGNORECASE)
"""No power of ten: without a unit beside it, one of many that are called x."""
BETWEEN = " _.-"


@dataclass(frozen=True)
class Factor:
    """A factor in a name.

    Attributes:
        text: as it stands.
        rest: the name without it.
        share: number of units that a value counts; empty where nobody says it.
        of_unit: whether it means nothing where the name says no unit.
    """

    text: str
    rest: str
    share: str = ""
    of_unit: bool = False


def factor_in(name: str) -> Factor | None:
    """The factor that stands beside the unit of a name; None where there is none."""
    inside = [match.span() for match in BRACKETS.finditer(name)]
    for pattern in (FACTOR, SHARE, SCALED):
        for match in pattern.finditer(name):
            start, end = match.span()
            if any(low < end and start < high and (low < start or end < high) for low, high in inside):
                continue  # a part of what brackets say, which is understood as a whole or not at all
            words = match.groupdict()
            share = SHARES.get((words.get("word") or "").lower(), "")
            if under := float(words.get("under") or 0.0):
                share = f"{1.0 / under:.10g}"
            rest = f"{name[:start].rstrip(BETWEEN)} {name[end:].lstrip(BETWEEN)}".strip()
            of_unit = pattern is not FACTOR or COUNTED.fullmatch(match[0]) is not None
            return Factor(match[0].strip(f"{BETWEEN}[]()"), rest, share, of_unit)
    return None
