"""Lines of a mapping: from the unit that a foreign column is in to that of the log; what is said, what must be
asked."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..types import Array
from ..units import FACTOR, behind
from .expression import names_in, quoted, signed_reading
from .motion import Relation, span, whole_numbers
from .names import Claim, words_of
from .units import TEMPERATURES, WORDS, measures, unit_of

SURE, LIKELY, ASK = "sure", "likely", "ask"
ANGLE, WAY = behind("rad", "deg", "mrad", "turn"), behind("m", "mm", "cm")
"""Expression behind a column that makes it rad or m, by the units that are tried where none is said."""
TURNING, SLIDING = ("rad/s", "deg/s", "rpm", "turn/s"), ("m/s", "mm/s")
RATE = behind(*TURNING, "mrad/s", *SLIDING)
POSITION = ("angle", "way")
OF_SIGNAL = {"torque": ("torque", "force"), "torque_command": ("torque", "force"), "current": ("current",),
             "voltage": ("voltage",)}  # fmt: skip
SI = {"torque": "N.m", "torque_command": "N.m", "current": "A", "voltage": "V", "temperature": "degC"}
COUNTED = {"current": "*1e-3", "torque": "*1e-3", "torque_command": "*1e-3", "voltage": "*0.1"}
"""What registers count mostly."""
PLAUSIBLE = {"torque": 50.0, "torque_command": 50.0, "current": 60.0, "voltage": 60.0, "temperature": 130.0}
"""By signal the most that is taken for N.m, A, V or degC unasked: more is of a large machine, or in a smaller unit."""
FULL_DUTY = (885.0, 1000.0, 1023.0, 100.0, 255.0)
TOLD_FIT, RATE_FIT = 0.3, 0.7
"""Shares of a motion that its goal, of a velocity that the derivative explains, from which their sizes are compared."""
ANOTHER_UNIT = 5.0
"""Factor from which a goal may be in another unit than its position: rad and turns, the nearest two, are 6.3 apart."""
NEAR, ROUGH = 1.05, 1.3
"""A velocity is in the unit in which it is within the first factor of what the position does; within the second, it
may be."""
TURN_BITS, EXACT = range(8, 25), 0.01
"""Powers of two that the counts of a turn may be, and the share by which a velocity may miss one."""
UNTIMED = (
    "in which unit is this velocity? No name says it, and while the time is in question no derivative tells it. The "
    "unit in the line is a guess: see it again once the time is known"
)


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


def _off(factor: float) -> float:
    """How far a factor is from one, either way."""
    return abs(math.log(factor))


# --- goals -----------------------------------------------------------------------------------------------------------


def goal_line(claim: Claim, unit: str, by: str, base: Line, goes: Relation) -> Line:
    """A goal or a second position; asked about where the position moves as in another unit.

    Args:
        claim: on its column.
        unit: that somebody says; empty: in that of the position.
        by: who says it.
        base: how the position is read.
        goes: of the position behind it, both as in the file.
    """
    column = quoted(claim.column)
    own, known = measures(unit, *POSITION), measures(base.unit, *POSITION)
    if unit and not own and unit != base.unit:
        return Line(column, unit, ASK, f"{by} says {unit}, which is no unit of an angle or a way", base.ask)
    if own:
        line = Line(column + own.behind, unit, SURE, f"{by} says {unit}")
    else:
        first = next((quoted(name) for name in names_in(base.text) if name != "pi"), "")
        text = column + known.behind if known else base.text.replace(first, column)
        trust = ASK if base.trust == ASK else LIKELY
        line = Line(text, base.unit, trust, f"in the unit of the position, {base.unit}", base.ask)
    compared = base.trust != ASK and (not own or base.open or by == "unit=")
    if not (compared and known and goes.fit > TOLD_FIT and goes.scale):
        return line
    times = f"the position moves {abs(goes.scale):.2g} times as far in the numbers of the file"
    if abs(math.log(abs(goes.scale) * (known.factor / own.factor if own else 1.0))) < math.log(ANOTHER_UNIT):
        return line.but(why=f"{line.why}; {times}")
    ask = f"in which unit is {column}? {times[0].upper()}{times[1:]}; keep {line.unit} if the joint hardly follows it, "
    return line.but(trust=ASK, why=f"{line.why}; {times}", ask=f"{ask}or is held and moved by its load")


# --- velocities ------------------------------------------------------------------------------------------------------


def per_second(claim: Claim) -> str:
    """The unit that a velocity says, a second where it says that of its position."""
    unit, whole = told(claim.unit), unit_of(claim.column)
    if not unit and (measures(whole, "rate", "speed") or whole == "erpm"):
        return whole
    return f"{unit}/s" if measures(unit, *POSITION) else unit


def counted_by_velocity(line: Line, claim: Claim, values: Array, velocity: Claim | None, goes: Relation | None) -> Line:
    """A position of which a velocity in a unit that is said tells the unit, or how many counts are a turn.

    Args:
        line: of the position.
        claim, values: its column.
        velocity: beside it.
        goes: of the velocity against the derivative of the position; None where no time is known.
    """
    unit = per_second(velocity) if velocity else ""
    rate, name = measures(unit, "rate", "speed"), quoted(claim.column)
    if goes is None or rate is None or goes.fit <= RATE_FIT or goes.scale <= 0.0:
        return line
    if line.open:
        units, factor = WAY if rate.quantity == "speed" else ANGLE, rate.factor * goes.scale
        best = min(units, key=lambda one: _off(factor / FACTOR[one]))
        off, why = _off(factor / FACTOR[best]), f"the velocity in {unit} is its derivative in {best}"
        return (
            Line(name + units[best], best, SURE if off < math.log(NEAR) else LIKELY, why)
            if off < math.log(ROUGH)
            else line
        )
    exact = 2.0 * math.pi / (rate.factor * goes.scale)
    power = 2 ** round(math.log2(exact))
    if (line.trust, line.unit) != (ASK, "tick") or rate.quantity == "speed" or power.bit_length() - 1 not in TURN_BITS:
        return line
    known = abs(exact / power - 1.0) < EXACT
    turn, shown = (
        power if known else int(float(f"{exact:.3g}")),
        f"by the velocity in {unit} a turn is {exact:.0f} of them",
    )
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if known and line.text == f"({name} - {turn // 2})*2*pi/{turn}" and "unit=" in line.ask:  # asked with its answer
        return line.but(why=f"{line.why}; {shown}")
    middle = turn // 2 if low >= 0.0 and high < turn else 0
    text = f"({name} - {middle})*2*pi/{turn}" if middle else f"{name}*2*pi/{turn}"
    why = f"counts of an encoder, {reach(values)}; {shown}"
    if known and low < 0.0:  # which a drive counts from its own zero
        return Line(text, "tick", LIKELY, f"{why}: {turn}")
    asked = f"which count is 0 rad? A turn is {turn}, {shown}" if known else (
        f"how many counts are a turn, and which one is 0 rad? {shown[0].upper()}{shown[1:]}"
    )  # fmt: skip
    return Line(text, "tick", ASK, why, f"{asked}; {middle} is a guess")


def velocity_line(claim: Claim, values: Array, goes: Relation | None, base: Line) -> Line:
    """A velocity, by its unit or by how it goes with the derivative of the position.

    Args:
        claim, values: its column.
        goes: of it against that derivative, both as in the file; None where no time is known.
        base: how the position is read.
    """
    if line := of_dialect(claim):
        return line
    column, unit, by = quoted(claim.column), per_second(claim), claim.by
    rate, factor, rates = measures(unit, "rate", "speed"), _si(base), _rates(base)
    if unit == "erpm":
        ask = "how many pole pairs times gear ratio make these electrical rpm those of the joint? Divide by that number"
        return Line(f"{column}*2*pi/60", unit, ASK, "electrical rpm", ask)
    if unit and not rate:
        return _without_unit(claim, values, f"{by} says {unit}, which is no unit of a velocity")
    own = f"{base.unit}/s" if f"{base.unit}/s" in rates else next(iter(rates))
    hangs = base.trust == ASK and base.unit != "tick"
    if not rate and (goes is None or hangs):
        why = "its unit hangs on that of the position" if hangs else f"no unit is said; taken for {own}"
        return Line(column + rates[own][0], own, ASK, why, base.ask if hangs else UNTIMED)
    if goes is None or goes.fit <= RATE_FIT or goes.scale <= 0.0 or not factor:
        against = goes is not None and goes.fit > RATE_FIT and goes.scale < 0.0
        how = f"it {'goes against' if against else 'does not go with'} the derivative of the position"
        if not rate:
            return _without_unit(claim, values, f"no unit is said, and {how}")
        why = f"{by} says {unit}" + f"; {how}" * against
        return Line(column + rate.behind, unit, LIKELY if against else SURE, why)
    per, shown = goes.scale / factor, f"it is {goes.scale:.3g} times the derivative of the position as logged"
    best = min(rates, key=lambda one: _off(per * rates[one][1]))
    off, trust = _off(per * rates[best][1]), base.trust
    if rate and _off(per * rate.factor) > off + 0.01:
        return Line(column + rate.behind, unit, ASK, f"{by} says {unit}, but {shown}, as {best} would be")
    if rate:
        trust = SURE if _off(per * rate.factor) < math.log(ROUGH) else LIKELY
        return Line(column + rate.behind, unit, trust, f"{by} says {unit}; {shown}")
    if off < math.log(NEAR):
        return Line(column + rates[best][0], best, trust, f"{shown}: {best}", base.ask)
    ask = f"how many rad/s (slide: m/s) is one of {column}? No unit is said, and {shown}"
    return Line(f"{column}*{1.0 / per:.4g}", "?", ASK, shown, ask)


def _without_unit(claim: Claim, values: Array, why: str) -> Line:
    """A question for a velocity, with how its register keeps a sign."""
    signed = signed_reading(claim.column, values)
    more = f". With its sign it is {signed}: write that, and the unit of a count behind it" if signed else ""
    return Line(quoted(claim.column), "?", ASK, why, why + more)


def _si(base: Line) -> float:
    """What one of a position is in rad or m; 0 where nobody knows."""
    known = measures(base.unit, *POSITION)
    return (
        known.factor if known else 2.0 * math.pi / float(base.text.rpartition("/")[2]) if base.unit == "tick" else 0.0
    )


def _rates(base: Line) -> dict[str, tuple[str, float]]:
    """Units that the velocity beside a position may be in, with what is behind its column and their factor: the usual
    ones, and that of the position a second."""
    units = SLIDING if measures(base.unit, "way") else TURNING
    found = {unit: (RATE[unit], FACTOR[unit]) for unit in (*units, *[f"{base.unit}/s"] * (f"{base.unit}/s" in RATE))}
    if base.unit == "tick":
        found["tick/s"] = f"*2*pi/{base.text.rpartition('/')[2]}", _si(base)
    return found


def goal_velocity_line(claim: Claim, values: Array, goes: Relation | None, goal: Line) -> Line:
    """A velocity that is commanded beside a goal; it need not be the goal's derivative."""
    line = velocity_line(claim, values, goes, goal)
    if line.trust == ASK and not told(claim.unit) and measures(goal.unit, *POSITION):
        unit, (behind, _) = next((one for one in _rates(goal).items() if one[0] == f"{goal.unit}/s"), ("", ("", 0.0)))
        if unit:
            why = f"no unit is said; taken for {unit}, as its goal"
            return Line(quoted(claim.column) + behind, unit, LIKELY, why)
    return line.but(why=line.why.replace("of the position", "of the goal"))


# --- the drive -------------------------------------------------------------------------------------------------------


def drive_line(signal: str, claim: Claim, values: Array) -> Line:
    """A torque, current, voltage, temperature, duty or flag, by its unit; asked about where it may be a count."""
    if line := of_dialect(claim):
        return line
    column, unit = quoted(claim.column), told(claim.unit)
    finite = values[np.isfinite(values)]
    largest, shown, by = float(np.abs(finite).max(initial=0.0)), reach(values), f"{claim.by} says {unit}"
    if signal == "enabled":
        good = set(np.unique(finite)) <= {0.0, 1.0}
        return Line(column, "", SURE if good else ASK, "0 and 1" if good else f"{shown}: which of these mean on?")
    if signal == "duty":
        if unit == "%" or largest <= 1.001:
            share = unit == "%"
            return Line(
                column + "/100" * share,
                "1",
                SURE if share else LIKELY,
                f"{by if share else 'a share, 1 is full'}; {shown}",
            )
        guess = min(scale for scale in (*FULL_DUTY, 1e300) if scale >= largest - 0.5)
        ask = f"how many counts mean a full duty? {guess:g} is a guess"
        return Line(f"{column}/{guess:g}", "counts", ASK, f"counts, {shown}", ask)
    if signal == "temperature" and unit in TEMPERATURES:
        return Line(TEMPERATURES[unit].format(column), unit, SURE, f"{by}; {shown}")
    words = {word for word, one in WORDS.items() if one == unit in ("A", "V") and len(word) > 1}
    spoken = (
        {word.lower() for word in words_of(re.sub(r"[\[(].*?[\])]", "", claim.column))}
        if claim.by == "the name"
        else set()
    )
    by_word = bool(spoken & words) and (
        whole_numbers(finite) or largest > PLAUSIBLE[signal]
    )  # as often the signal alone
    known = measures(unit, *OF_SIGNAL.get(signal, ()))
    if known and not by_word:
        return Line(column + known.behind, unit, SURE, f"{by}; {shown}")
    return _counts(signal, column, claim, finite, by_word)


def _counts(signal: str, column: str, claim: Claim, finite: Array, by_word: bool) -> Line:
    """A column in a unit that is not said, or by a word alone: taken as it stands where nothing speaks for counts."""
    unit, shown, whole = SI[signal], reach(finite), whole_numbers(finite)
    most, largest = PLAUSIBLE[signal] * (0.5 if by_word and whole else 1.0), float(np.abs(finite).max(initial=0.0))
    own = "" if by_word else claim.unit
    unsigned = signal in ("torque", "current") and span(finite) > 0.0 and float(finite.min()) >= 0.0
    line = Line(column, unit, ASK, shown)
    if signal == "torque" and unsigned and not own:
        return line.but(
            ask="is it a torque at all? It is never negative, and may be a magnitude without sign, or a register"
        )
    if own or largest > most:
        ask = f"in which unit is this {signal}?"
        if told(own):
            ask = f"{claim.by} says {own}, which is no unit of a {signal}: write what makes it {unit}"
        if by_word:
            ask += f" Its name says {claim.unit}, but {largest:.5g} may be tenths or thousandths of it"
        factor = "*1e-3" if signal == "voltage" and largest >= 600.0 else COUNTED.get(signal, "")
        return line.but(text=column + factor * (largest > most), ask=ask)
    if signal in ("torque", "torque_command", "current"):
        if claim.rest:
            ask = f"is {claim.rest!r} in the name of {column} its unit? It is none that is known"
            return line.but(ask=f"{ask}: write what makes it {unit}")
        if whole and span(finite) > 1.0:
            ask = f"in which unit is this {signal}? Whole numbers are counts of a register, or m{unit} (*1e-3)"
            return line.but(text=f"{column}*1e-3", ask=ask)
    doubt = "; never negative, so it may be a magnitude without sign, or a register" if unsigned else ""
    said = f"its name says {claim.unit}" if by_word else "no unit is said"
    return line.but(trust=LIKELY, why=f"{said}; {shown} taken for {unit}{doubt}")
