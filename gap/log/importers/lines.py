"""Lines of a mapping: from the unit that a foreign column is in to that of the log; what is said, what must be
asked."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..types import MIN_CHANGES, READING_SHARE, SIGNAL_UNITS, Array
from .expression import names_in, quoted, signed_reading
from .motion import LONGEST_LAG, MOTION_WINDOW, Relation, move_apart, span, whole_numbers
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
FULL_SHARE = 1.001
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

COMPARED_FIT, FOLLOWED_FIT = 0.3, 0.5
"""Shares of a motion that a goal explains, from which their sizes are compared, and its delay tells something."""
ANOTHER_UNIT = 5.0
"""Factor from which a goal may be in another unit than its position: rad and turns, the nearest two, are 6.3 apart."""
SCALED_ACTIONS, ACTION_OFFSET = 1.5, 0.3
"""Times as far as the actions from which a joint follows scaled ones; share of a joint's range by which it stands
beside them."""
UNFOLLOWED = (
    "is this the goal of the position beside it? The position does not move as it does. Keep the line if the joint "
    "hardly follows it, or is moved by its load; else give another column, or remove it"
)
ACTIONS = (
    "by which factor, and from which angle, do actions become goals? Positions do not move as far as the actions, or "
    "stand elsewhere, as behind a policy whose actions are scaled and added to default angles: write <default angle> + "
    "<factor>*<column> as the controller has them, or keep the column if it is the goal"
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


# --- goals -----------------------------------------------------------------------------------------------------------


def goal_line(claim: Claim, base: Line, goes: Relation) -> Line:
    """A goal or a second position, in its own unit or in that of the position; asked about where the position moves as
    in another one.

    Args:
        claim: on its column.
        base: how the position is read.
        goes: of the position behind it, both as in the file.
    """
    if line := of_dialect(claim):
        return line
    unit, by = told(claim.unit), claim.by
    own, known = measures(unit, *POSITION), measures(base.unit, *POSITION)
    if unit and not own and base.unit not in (unit, {"%": "percent"}.get(unit)):
        why = f"{by} says {unit}, which is no unit of an angle or a way"
        return in_unit(claim.column, unit, ASK, why, base.ask)
    if own:
        line = in_unit(claim.column, unit, SURE, f"{by} says {unit}")
    else:
        of_position = next((quoted(name) for name in names_in(base.text) if name != "pi"), "")
        text, trust = base.text.replace(of_position, quoted(claim.column)), ASK if base.trust == ASK else LIKELY
        line = Line(text, base.unit, trust, f"in the unit of the position, {base.unit}", base.ask)
    compared = base.trust != ASK and (not own or base.open)
    if not (compared and known and goes.fit > COMPARED_FIT and goes.scale):
        return line
    times = f"the position moves {abs(goes.scale):.2g} times as far in the numbers of the file"
    line = line.but(why=f"{line.why}; {times}")
    if abs(math.log(abs(goes.scale) * (known.factor / own.factor if own else 1.0))) < math.log(ANOTHER_UNIT):
        return line
    ask = (
        f"in which unit is {quoted(claim.column)}? {times[0].upper()}{times[1:]}; keep {line.unit} if the joint hardly "
    )
    return line.but(trust=ASK, ask=f"{ask}follows it, or is held and moved by its load")


def doubted(line: Line, base: Line, goes: Relation, time: Array | None, goal: Array, position: Array) -> Line:
    """A goal's line with how late its position comes, in question where it does not come after it.

    Args:
        line: how the column becomes a goal.
        base: how the position is read.
        goes: of the position behind the goal.
        time: of the samples [s], None where it is not known.
        goal, position: their columns as logged (n,).
    """
    clock = np.arange(len(goal), dtype=np.float64) * 0.01 if time is None else time
    late = f"{1e3 * abs(goes.lag):.0f} ms"
    if goes.fit < COMPARED_FIT and move_apart(clock, goal, position, COMPARED_FIT):
        return line.asking("the position does not follow it", UNFOLLOWED, base)
    if (ahead := _reading(goal, position)) >= 0:
        why = f"it is the position{' of the next row' * ahead} in nearly all rows in motion, as no servo follows a goal"
        ask = f"is this what was sent to the servo? {why}: log what was sent as the goal"
        return line.but(trust=ASK, why=why, ask=ask)
    if goes.fit <= FOLLOWED_FIT:
        return line
    if goes.scale < 0.0:
        ask = f"the position moves against this goal. If it counts the other way round, write -{line.text}"
        return line.asking("the position moves against it", ask, base)
    if time is None or (line.ask == ACTIONS and goes.lag >= 0.0):
        return line
    if goes.lag < 0.0:
        why = f"the position moves {late} before it: are goal and position exchanged?"
        return line.but(trust=ASK, why=why, ask=why)
    if goes.lag > LONGEST_LAG - MOTION_WINDOW:
        why = f"the position follows it best after {late}, the longest delay that is looked at"
        return line.asking(why, f"is this the goal of the position beside it? {why[0].upper()}{why[1:]}", base)
    return line.but(why=f"{line.why}; the position follows it by {late}")


def _reading(goal: Array, position: Array) -> int:
    """How many rows ahead a goal is the reading itself, 0 or 1; -1 where it is none."""
    changes = np.flatnonzero(np.diff(position) != 0.0)
    shares = [float(np.mean(goal[changes] == position[changes + ahead])) for ahead in (0, 1)]
    return shares.index(max(shares)) if len(changes) >= MIN_CHANGES and max(shares) >= READING_SHARE else -1


def action_line(line: Line, goes: Relation, values: Array, position: Array, base: Line) -> Line:
    """An action of a policy as a goal, in question where the position does not go as far or stands elsewhere.

    Args:
        line: the column as a goal.
        goes: of the position behind it.
        values, position: of the column and of the position, as logged.
        base: how the position is read.
    """
    goal, known = (measures(one.unit, *POSITION) for one in (line, base))
    if not (goal and known) or goes.scale <= 0.0 or goes.fit < FOLLOWED_FIT or base.trust == ASK:
        return line
    factor = goal.factor / known.factor
    offset = abs(float(np.nanmean(position) - factor * np.nanmean(values)))
    scaled = abs(math.log(goes.scale / factor)) >= math.log(SCALED_ACTIONS)
    if scaled or offset > ACTION_OFFSET * max(span(position), factor * span(values)):
        why = f"the position moves {goes.scale:.2g} times as far as the action, and stands {offset:.2g} from it"
        return line.but(trust=ASK, why=why, ask=ACTIONS)
    return line


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
    if signal == "duty" and largest <= FULL_SHARE:
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
