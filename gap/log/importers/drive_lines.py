"""Lines of what a drive logs beside its motion: torque, current, voltage, temperature, duty, and whether it is on."""

from __future__ import annotations

import re

import numpy as np

from ..types import SIGNAL_UNITS, Array
from .expression import TEMPERATURES, WORDS, measures, quoted
from .lines import ASK, FULL_SHARE, LIKELY, SURE, Line, in_unit, of_dialect, reach, told
from .motion import span, whole_numbers
from .names import Claim, words_of

DRIVE_QUANTITIES = {"torque": ("torque", "force"), "torque_command": ("torque", "force"), "current": ("current",),
                    "voltage": ("voltage",)}  # fmt: skip
LARGEST_PLAUSIBLE = {"torque": 50.0, "torque_command": 50.0, "current": 60.0, "voltage": 60.0, "temperature": 130.0}
"""By signal the most that is taken for N.m, A, V or degC unasked: more is of a large machine, or in a smaller unit."""
SHARES_OF = {"%": "/100", "0.1 %": "/1000"}
"""What makes a share of 1 of a column in a unit of shares."""


def drive_line(signal: str, claim: Claim, values: Array) -> Line:
    """A torque, current, voltage, temperature, duty or flag, by its unit; asked about where it may be a count."""
    if line := of_dialect(claim):
        return line
    name, unit, plain = quoted(claim.column), told(claim.unit), SIGNAL_UNITS[signal]
    finite = values[np.isfinite(values)]
    largest, whole, shown = float(np.abs(finite).max(initial=0.0)), whole_numbers(finite), reach(values)
    says = f"{claim.by} says {unit}; {shown}"
    if signal == "enabled":
        good = set(np.unique(finite)) <= {0.0, 1.0}
        return Line(name, "", SURE if good else ASK, "0 and 1" if good else f"{shown}: which of these mean on?")
    if signal == "duty":
        if unit in SHARES_OF or largest <= FULL_SHARE:
            return Line(name + SHARES_OF.get(unit, ""), "1", SURE if unit else LIKELY, f"a share; {shown}")
        ask = f"how many counts mean a full duty? Write {name}/<that number>"
        return Line(name, "counts", ASK, f"counts, {shown}", ask)
    if signal == "temperature" and unit in TEMPERATURES:
        return Line(TEMPERATURES[unit].format(name), unit, SURE, says)
    drives = signal in ("torque", "torque_command", "current")
    beyond = largest > LARGEST_PLAUSIBLE[signal]
    ask = ""
    if measures(unit, *DRIVE_QUANTITIES.get(signal, ())):
        if not _by_word(claim) or not (beyond or (whole and (drives or largest > 0.5 * LARGEST_PLAUSIBLE[signal]))):
            return in_unit(claim.column, unit, SURE, says)
        ask = f"Its name says {unit}, but {largest:.5g} may be tenths or thousandths of it"
    elif unit:
        ask = f"{claim.by[0].upper()}{claim.by[1:]} says {unit}, which is no unit of a {signal}"
    elif claim.rest:
        ask = f"Is {claim.rest!r} in its name the unit?"
    elif signal == "torque" and span(finite) > 0.0 and float(finite.min()) >= 0.0:
        ask = "It is never negative, and may be a magnitude without sign, or a register: is it a torque at all?"
    elif claim.unit == "?" or beyond or (drives and whole and span(finite) > 1.0):
        ask = "It may be counts of a register, or thousandths"
    if ask:
        return Line(name, plain, ASK, shown, f"in which unit is this {signal}? {ask}. Write what makes it {plain}")
    return Line(name, plain, LIKELY, f"no unit is said; {shown} taken for {plain}")


def _by_word(claim: Claim) -> bool:
    """Whether a word such as ``volts``, which as often says the signal alone, is what says the unit."""
    words = {word for word, unit in WORDS.items() if unit == claim.unit in ("A", "V") and len(word) > 1}
    return claim.by == "the name" and any(
        word.lower() in words for word in words_of(re.sub(r"[\[(].*?[\])]", "", claim.column))
    )
