"""Lines of a mapping: from the unit that a foreign column is in to that of the log; what is said, what must be
asked."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..types import SIGNAL_UNITS, Array
from .expression import quoted, signed_reading
from .motion import Relation, span, whole_numbers
from .names import Claim, words_of
from .units import TEMPERATURES, WORDS, measure, measures, unit_of

SURE, LIKELY, ASK = "sure", "likely", "ask"
POSITION = ("angle", "way")
RATES = {"angle": ("rad/s", "deg/s", "rpm", "turn/s"), "way": ("m/s", "mm/s")}
"""Units that are tried for a velocity of which none is said, by the quantity of its position."""
DRIVE_QUANTITIES = {"torque": ("torque", "force"), "torque_command": ("torque", "force"), "current": ("current",),
                    "voltage": ("voltage",)}  # fmt: skip
LARGEST_PLAUSIBLE = {"torque": 50.0, "torque_command": 50.0, "current": 60.0, "voltage": 60.0, "temperature": 130.0}
"""By signal the most that is taken for N.m, A, V or degC unasked: more is of a large machine, or in a smaller unit."""
FULL_DUTY = 1.001
DERIVATIVE_FIT = 0.7
"""Share of a motion that the derivative of the position explains, from which a velocity's size is compared."""
SAME_UNIT, ROUGHLY_UNIT = math.log(1.05), math.log(1.3)
"""A velocity is in the unit in which it is within the first factor of what the position does; within the second, it
may be."""
UNTIMED = (
    "in which unit is this velocity? No name says it, and while the time is in question no derivative tells it. The "
    "unit in the line is a guess: see it again once the time is known"
)
ELECTRICAL = "how many pole pairs times gear ratio make these electrical rpm those of the joint? Divide by that number"


@dataclass(frozen=True)
class Line:
    """How one column of the log comes from the file.

    Attributes:
        text: expression.
        unit: that the column is taken to be in.
        trust: ``sure``, ``likely`` (shown, and taken unless somebody objects) or ``ask``.
        why: for people.
        ask: the question, where there is one; lines with the same are asked about together.
        open: whether no unit is said, and no encoder shows one.
    """

    text: str
    unit: str
    trust: str
    why: str
    ask: str = ""
    open: bool = False

    def but(self, **changed: Any) -> Line:
        return replace(self, **changed)

    def asking(self, why: str, ask: str, position: Line | None = None) -> Line:
        """The line with one more question; that of its unit stays where the position does not ask it."""
        own = self.trust == ASK and (position is None or self.ask != position.ask)
        return self.but(trust=ASK, why=f"{self.why}; {why}", ask=f"{self.ask or self.why}. And {ask}" if own else ask)

    @property
    def behind(self) -> str:
        """What makes a column in this unit rad or m: of steps ``*2*pi/4096``."""
        known = measures(self.unit, *POSITION)
        return known.behind if known else f"*2*pi/{self.text.rpartition('/')[2]}" if self.unit == "tick" else ""

    @property
    def factor(self) -> float:
        """What one of a position is in rad or m; 0 where nobody knows."""
        known = measures(self.unit, *POSITION)
        return known.factor if known else 2.0 * math.pi / float(self.text.rpartition("/")[2]) * (self.unit == "tick")

    @property
    def rates(self) -> dict[str, tuple[str, float]]:
        """Units that the velocity beside a position may be in, with what is behind its column and their factor: that of
        the position a second, and the usual ones."""
        usual = {unit: measure(unit) for unit in RATES["way" if measures(self.unit, "way") else "angle"]}
        own = {f"{self.unit}/s": (self.behind, self.factor)} if self.factor else {}
        return own | {unit: (known.behind, known.factor) for unit, known in usual.items() if known}


def in_unit(column: str, unit: str, trust: str, why: str, ask: str = "", open: bool = False) -> Line:
    """A column by its unit; as it stands where the unit is none that is known."""
    known = measure(unit)
    return Line(quoted(column) + (known.behind if known else ""), unit, trust, why, ask, open)


def of_dialect(claim: Claim) -> Line | None:
    """The line that a dialect gives; None where it gives a unit, or nobody but the name speaks."""
    trust = ASK if claim.ask else LIKELY
    return Line(claim.formula, "", trust, f"{claim.by} has it so", claim.ask) if claim.formula else None


def told(unit: str) -> str:
    """A unit that is said; empty where the format leaves it open."""
    return "" if unit == "?" else unit


def reach(values: Array) -> str:
    """From where to where a column goes, for people."""
    finite = values[np.isfinite(values)]
    return f"{finite.min():.3g} to {finite.max():.3g}" if len(finite) else "no values"


def nearest_unit(factor: float, factors: Iterable[tuple[str, float]]) -> tuple[str, float]:
    """The unit whose factor is nearest to one that was measured, and the logarithm by which it is off."""
    return min(((unit, abs(math.log(factor / one))) for unit, one in factors), key=lambda found: found[1])


# --- velocities ------------------------------------------------------------------------------------------------------


def per_second(claim: Claim) -> str:
    """The unit that a velocity says, a second where it says that of its position."""
    unit, whole = told(claim.unit), unit_of(claim.column)
    if not unit and (measures(whole, "rate", "speed") or whole == "erpm"):
        return whole
    return f"{unit}/s" if measures(unit, *POSITION) else unit


def velocity_line(claim: Claim, values: Array, goes: Relation | None, base: Line) -> Line:
    """A velocity, by its unit or by how it goes with the derivative of the position.

    Args:
        claim, values: its column.
        goes: of it against that derivative, both as in the file; None where no time is known.
        base: how the position is read.
    """
    if line := of_dialect(claim):
        return line
    name, unit, says = claim.column, per_second(claim), f"{claim.by} says {per_second(claim)}"
    rate, rates = measures(unit, "rate", "speed"), base.rates
    derives = goes is not None and goes.fit > DERIVATIVE_FIT
    if unit == "erpm":
        return Line(f"{quoted(name)}*2*pi/60", unit, ASK, "electrical rpm", ELECTRICAL)
    if unit and not rate:
        return _without_unit(claim, values, f"{says}, which is no unit of a velocity")
    hangs = base.trust == ASK and base.unit != "tick"
    if not rate and (goes is None or hangs):
        own = next(iter(rates))
        why = "its unit hangs on that of the position" if hangs else f"no unit is said; taken for {own}"
        return Line(quoted(name) + rates[own][0], own, ASK, why, base.ask if hangs else UNTIMED)
    guessed = rate is not None and base.unit == "tick" and base.trust == ASK  # counts of a turn that nobody says
    if goes is None or not derives or goes.scale <= 0.0 or not base.factor or guessed:
        against = derives and goes is not None and goes.scale < 0.0
        how = f"it {'goes against' if against else 'does not go with'} the derivative of the position"
        if not rate:
            return _without_unit(claim, values, f"no unit is said, and {how}")
        return in_unit(name, unit, LIKELY if against else SURE, f"{says}; {how}" if against else says)
    factor, shown = base.factor / goes.scale, f"it is {goes.scale:.3g} times the derivative of the position as logged"
    best, off = nearest_unit(factor, ((one, size) for one, (_, size) in rates.items()))
    if rate:
        own_off = abs(math.log(factor / rate.factor))
        if own_off > off + 0.01:
            return in_unit(name, unit, ASK, f"{says}, but {shown}, as {best} would be")
        return in_unit(name, unit, SURE if own_off < ROUGHLY_UNIT else LIKELY, f"{says}; {shown}")
    if off < SAME_UNIT:
        return Line(quoted(name) + rates[best][0], best, base.trust, f"{shown}: {best}", base.ask)
    ask = f"how many rad/s (slide: m/s) is one of {quoted(name)}? No unit is said, and {shown}"
    return Line(f"{quoted(name)}*{factor:.4g}", "?", ASK, shown, ask)


def _without_unit(claim: Claim, values: Array, why: str) -> Line:
    """A question for a velocity, with how its register keeps a sign."""
    signed = signed_reading(claim.column, values)
    more = f". With its sign it is {signed}: write that, and the unit of a count behind it" if signed else ""
    return Line(quoted(claim.column), "?", ASK, why, why + more)


def goal_velocity_line(claim: Claim, values: Array, goes: Relation | None, goal: Line) -> Line:
    """A velocity that is commanded beside a goal; it need not be the goal's derivative."""
    line, own = velocity_line(claim, values, goes, goal), f"{goal.unit}/s"
    if line.trust == ASK and not told(claim.unit) and measures(goal.unit, *POSITION):
        return in_unit(claim.column, own, LIKELY, f"no unit is said; taken for {own}, as its goal")
    return line.but(why=line.why.replace("of the position", "of the goal"))


# --- the drive -------------------------------------------------------------------------------------------------------


def drive_line(signal: str, claim: Claim, values: Array) -> Line:
    """A torque, current, voltage, temperature, duty or flag, by its unit; asked about where it may be a count."""
    if line := of_dialect(claim):
        return line
    name, unit = claim.column, told(claim.unit)
    finite = values[np.isfinite(values)]
    largest, shown, says = float(np.abs(finite).max(initial=0.0)), reach(values), f"{claim.by} says {unit}"
    if signal == "enabled":
        good = set(np.unique(finite)) <= {0.0, 1.0}
        return Line(quoted(name), "", SURE if good else ASK, "0 and 1" if good else f"{shown}: which of these mean on?")
    if signal == "duty" and unit == "%":
        return Line(f"{quoted(name)}/100", "1", SURE, f"{says}; {shown}")
    if signal == "duty" and largest <= FULL_DUTY:
        return Line(quoted(name), "1", LIKELY, f"a share, 1 is full; {shown}")
    if signal == "duty":
        ask = f"how many counts mean a full duty? Write {quoted(name)}/<that number>"
        return Line(quoted(name), "counts", ASK, f"counts, {shown}", ask)
    if signal == "temperature" and unit in TEMPERATURES:
        return Line(TEMPERATURES[unit].format(quoted(name)), unit, SURE, f"{says}; {shown}")
    by_word = _by_word(claim) and (whole_numbers(finite) or largest > LARGEST_PLAUSIBLE[signal])
    if measures(unit, *DRIVE_QUANTITIES.get(signal, ())) and not by_word:
        return in_unit(name, unit, SURE, f"{says}; {shown}")
    return _counted_or_plain(signal, claim, finite, by_word)


def _by_word(claim: Claim) -> bool:
    """Whether a word such as ``volts``, which as often says the signal alone, is what says the unit."""
    words = {word for word, unit in WORDS.items() if unit == claim.unit in ("A", "V") and len(word) > 1}
    spoken = {word.lower() for word in words_of(re.sub(r"[\[(].*?[\])]", "", claim.column))}
    return claim.by == "the name" and bool(spoken & words)


def _counted_or_plain(signal: str, claim: Claim, finite: Array, by_word: bool) -> Line:
    """A column in a unit that is not said, or by a word alone: taken as it stands where nothing speaks for counts."""
    unit, whole = SIGNAL_UNITS[signal], whole_numbers(finite)
    largest = float(np.abs(finite).max(initial=0.0))
    beyond = largest > LARGEST_PLAUSIBLE[signal] * (0.5 if by_word and whole else 1.0)
    own = "" if by_word else claim.unit
    unsigned = signal in ("torque", "current") and span(finite) > 0.0 and float(finite.min()) >= 0.0
    counts = signal in ("torque", "torque_command", "current") and whole and span(finite) > 1.0
    ask = ""
    if signal == "torque" and unsigned and not own:
        ask = "is it a torque at all? It is never negative, and may be a magnitude without sign, or a register"
    elif told(own):
        ask = f"{claim.by} says {own}, which is no unit of a {signal}: write what makes it {unit}"
    elif beyond and by_word:
        ask = (
            f"in which unit is this {signal}? Its name says {claim.unit}, but {largest:.5g} may be tenths or "
            "thousandths of it"
        )
    elif own or beyond:
        ask = f"in which unit is this {signal}? Write what makes it {unit}"
    elif signal in ("torque", "torque_command", "current") and claim.rest:
        ask = f"is {claim.rest!r} in the name of {quoted(claim.column)} its unit? It is none that is known: write what "
        ask += f"makes it {unit}"
    elif counts:
        ask = f"in which unit is this {signal}? Whole numbers are counts of a register, or m{unit} (*1e-3)"
    if ask:
        return Line(quoted(claim.column), unit, ASK, reach(finite), ask)
    doubt = "; never negative, so it may be a magnitude without sign, or a register" if unsigned else ""
    said = f"its name says {claim.unit}" if by_word else "no unit is said"
    return Line(quoted(claim.column), unit, LIKELY, f"{said}; {reach(finite)} taken for {unit}{doubt}")
