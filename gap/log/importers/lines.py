"""Lines of a mapping: from the unit that a foreign column is in to that of the log, said, shown by motion, or asked."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..types import TURN_IN_UNITS, Array, LogError
from .expression import measure, measures, names_in, quoted, unit_of
from .motion import LONGEST_LAG, MOTION_WINDOW, Relation, encoder, move_apart, span, whole_numbers
from .names import Claim, is_a
from .recording import LARGEST_EXACT

SURE, LIKELY, ASK = "sure", "likely", "ask"
POSITION = ("angle", "way")
RATES = {"angle": ("rad/s", "deg/s", "rpm", "turn/s"), "way": ("m/s", "mm/s")}
"""Units that are tried for a velocity of which none is said, by the quantity of its position."""
FULL_SHARE = 1.001
DERIVATIVE_FIT = 0.7
"""Share of a motion that the derivative of the position explains, from which a velocity's size is compared."""
SAME_UNIT = math.log(1.05)
"""A velocity is in the unit in which it is within this factor of what the position does."""
AGAINST = "It goes against the derivative of the position. Write -{text}, or remove the line"
UNTIMED = "in which unit is this velocity? No name says it, and while the time is in question no derivative tells it"
ELECTRICAL = "how many pole pairs times gear ratio make these electrical rpm those of the joint? Divide by that number"

COMPARED_FIT, FOLLOWED_FIT = 0.3, 0.5
"""Shares of a motion that a goal explains, from which their sizes are compared, and its delay tells something."""
ANOTHER_UNIT = 5.0
"""Factor from which a goal may be in another unit than its position: rad and turns, the nearest two, are 6.3 apart."""
ACTIONS = (
    "are these actions of a policy the goals, or are they scaled and added to default angles? Keep the lines, or write "
    "<default angle> + <factor>*<column> as the controller has them"
)
TICKS, PERCENT = "ticks", "percent"
"""Words of ``unit=`` that no column is converted by alone: a turn and a zero, or a range belong to them."""
STEPS_A_TURN, STEP_AT_ZERO = 4096, 2048
"""Steps of a turn and the step at 0 rad that ``unit=ticks`` takes: of Feetech STS and Dynamixel X servos (their
registers in hw/bus/registers), mounted with 0 rad in the middle (assumed)."""
MOST_STEPS = 32768.0
"""Steps that a register of 16 bits with a sign does not hold."""
POSSIBLE = {"angle": ("rad", "deg", "mrad", "turn"), "way": ("m", "mm", "cm")}
"""Units that are tried for a position of which none is said, by its quantity."""
PLAIN_RAD, MOST_RAD = 2.2 * math.pi, 60.0
"""An angle in rad without a turn to spare stays below the first; beyond the second it is hardly in rad."""
MOST_WAY = 10.0  # [m]
"""What a slide may travel before a name that ends in m is doubted."""
STEPS = (
    f"encoder steps of a servo (unit={TICKS}: {STEPS_A_TURN} a turn and {STEP_AT_ZERO} at 0 rad), degrees (unit=deg), "
    "rad (unit=rad) or mm of a slide (unit=mm)? Servos with 1024 steps over 300 degrees (SCS, AX) need "
    "(<column> - 512)*300/1024*pi/180"
)
SHARES = ", and that stay within 0 to 100"
COUNTS = f"how many counts are a turn, and which one is 0 rad? {STEPS_A_TURN} and 0 stand in these lines"
GOAL_COUNTS = (
    f"how many of these counts are a turn, and which one is 0 rad? {STEPS_A_TURN} and {STEP_AT_ZERO} stand there"
)
SHARE = (
    "a share of the calibrated range, whose ends are low and high in rad (slide: m)? 0..100 is unit=percent beside "
    "robot=<its file>, or low + <column>/100*(high - low)"
)
UNSAID = (
    f"degrees (unit=deg), rad (unit=rad), turns (unit=turn), encoder steps (unit={TICKS}) or mm (unit=mm)? Or {SHARE}"
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


# --- positions -------------------------------------------------------------------------------------------------------


def bare(joint: str) -> str:
    """A name without what is only spelling: ``joint_1``, ``Joint1`` and ``joint-1`` are the same."""
    return re.sub(r"[\W_]", "", joint).lower()


@dataclass(frozen=True, eq=False)
class Position:
    """A joint's position as it is in the file.

    Attributes:
        claim: on its column.
        values: of the recording in which it moves most, (n,).
        goals: of the same recording, each (n,).
        slide: whether the joint is known to be a slide.
    """

    claim: Claim
    values: Array
    goals: tuple[Array, ...] = ()
    slide: bool = False

    @property
    def low(self) -> float:
        return float(np.nanmin(self.values))

    @property
    def high(self) -> float:
        return float(np.nanmax(self.values))

    @property
    def far(self) -> float:
        return max(abs(self.low), abs(self.high))

    @property
    def in_a_turn(self) -> bool:
        """Whether it stays within the steps of a turn of a servo."""
        return self.low >= 0.0 and self.high < STEPS_A_TURN

    @property
    def share(self) -> bool:
        """Whether it stays within 0 to 100, but for 2 % of that, goes beyond 0 to 1, and shows no encoder."""
        return self.low >= -2.0 and 2.0 < self.high <= 102.0 and encoder(self.values) is None

    @property
    def of_gripper(self) -> bool:
        """Whether it may be the opening of a gripper, 0 to 1 or 0 to 100: nobody says its unit, and it shows no
        encoder."""
        named = is_a("gripper", *self.claim.words) and self.claim.unit in ("", "?", "%")
        return named and (self.share or 0.0 <= self.low <= self.high <= FULL_SHARE) and encoder(self.values) is None

    @property
    def register(self) -> bool:
        """Whether nobody says its unit, and it and its goals are whole numbers of a servo's register."""
        of_steps = all(
            whole_numbers(values) and float(np.nanmin(values)) >= 0.0 and float(np.nanmax(values)) < STEPS_A_TURN
            for values in (self.values, *self.goals)
        )
        return of_steps and self.claim.unit in ("", "?", "tick") and not (self.claim.formula or self.slide)


def position_line(one: Position, unit: str, by: str) -> Line:
    """An angle or a way by the unit that somebody says or by the step of its encoder, else a question.

    Args:
        one: the position.
        unit: that is said; ``?`` where the format leaves it open.
        by: who says it.
    """
    if line := of_dialect(one.claim):
        return line
    name, shown, found = one.claim.column, reach(one.values), encoder(one.values)
    whole = whole_numbers(one.values) and TURN_IN_UNITS["deg"] < span(one.values) < LARGEST_EXACT
    says = f"{by} says {unit}; {shown}"
    if unit == "m" and by == "the name" and span(one.values) > MOST_WAY:
        ask = "m of a slide (unit=m), or the angle of a motor that the name means (unit=deg, unit=rad)?"
        return in_unit(name, unit, ASK, says, ask)
    if unit == "tick" or (unit in ("", "?") and whole):
        return _counted(one)
    if unit in ("rad", "deg") and found and found[0] != unit:
        return in_unit(
            name, found[0], ASK, f"{says}, but the steps of its values are a turn in {found[0]} by {found[1]}"
        )
    if unit == "rad" and one.far > MOST_RAD:
        ask = f"degrees? Where lost samples reach so far, write `where: {MOST_RAD:g} - abs({quoted(name)})`"
        return Line(quoted(name), "rad", ASK, says, f"{by} says rad, but it reaches {shown}: {ask}")
    if measures(unit, *POSITION):
        return in_unit(name, unit, SURE, says)
    if found:
        return in_unit(name, found[0], SURE, f"its steps are a turn in {found[0]} by {found[1]}; {shown}")
    if told(unit) and unit != "%":
        asked = f"{by} says {unit}, which is no unit of an angle or a way: write what makes it rad (slide: m)"
        return in_unit(name, unit, ASK, says, asked)
    if is_a("radian", one.claim.how.lower()) and not (unit or one.slide) and one.far <= PLAIN_RAD:
        why = f"{one.claim.how!r} is a joint's angle, in rad by custom; {shown}"
        return in_unit(name, "rad", LIKELY, why, open=True)
    return _open(one)


def _open(one: Position) -> Line:
    """A question for the unit of a position; the line has the column as it stands."""
    ask, unit = SHARE if one.claim.unit == "%" else UNSAID, "m" if one.slide else "rad"
    return Line(quoted(one.claim.column), unit, ASK, f"no unit is said; {reach(one.values)}", ask, open=True)


def _steps(one: Position, middle: int, trust: str, why: str, ask: str = "") -> Line:
    """Steps of an encoder as an angle."""
    column = quoted(one.claim.column)
    text = f"({column} - {middle})*2*pi/{STEPS_A_TURN}" if middle else f"{column}*2*pi/{STEPS_A_TURN}"
    return Line(text, "tick", trust, f"{why}; {reach(one.values)}", ask)


def _counted(one: Position) -> Line:
    """Steps of an encoder, asked about: those of a servo, or of a turn that nobody says."""
    servo = one.in_a_turn
    return _steps(one, STEP_AT_ZERO * servo, ASK, "counts of an encoder", STEPS if servo else COUNTS)


def by_velocity(line: Line, one: Position, velocity: Claim | None, goes: Relation | None) -> Line:
    """A position of which a velocity in a unit that is said tells the unit.

    Args:
        line: of the position.
        one: the position.
        velocity: beside it.
        goes: of the velocity against the derivative of the position; None where no time is known.
    """
    unit = per_second(velocity) if velocity else ""
    rate = measures(unit, "rate", "speed")
    if not line.open or goes is None or rate is None or goes.fit <= DERIVATIVE_FIT or goes.scale <= 0.0:
        return line
    known = {unit: measure(unit) for unit in POSSIBLE["way" if rate.quantity == "speed" else "angle"]}
    best, off = nearest_unit(rate.factor * goes.scale, ((unit, size.factor) for unit, size in known.items() if size))
    why = f"the velocity in {unit} is its derivative in {best}"
    return in_unit(one.claim.column, best, SURE, why) if off < SAME_UNIT else line


def position_lines(found: Sequence[Position], unit: str | None, source: Path) -> dict[str, Line]:
    """Lines of all positions of a recording by their columns.

    Args:
        found: the positions.
        unit: that ``unit=`` says of those whose unit is open; None where nobody did.
        source: for the message.

    Raises:
        LogError: no column has a use for the answer.
    """
    lines = {one.claim.column: position_line(one, one.claim.unit, one.claim.by) for one in found}
    registers = [one for one in found if one.register]
    if any(one.high > TURN_IN_UNITS["deg"] for one in registers):  # further than degrees
        lines |= {one.claim.column: _counted(one) for one in registers}
    alone = all(one.of_gripper for one in found)  # else a gripper may be in a unit of its own
    alike = [one for one in found if lines[one.claim.column].open and (alone or not one.of_gripper)]
    if any(lines[one.claim.column].trust == ASK for one in alike):
        lines |= {one.claim.column: _open(one) for one in alike}
    against, filled = list[str](), False
    for one in found if unit else ():
        name, line = one.claim.column, lines[one.claim.column]
        own = told(one.claim.unit) if (one.claim.unit, unit) not in (("tick", TICKS), ("%", PERCENT)) else ""
        own = own or one.claim.formula or (line.unit if line.trust == SURE else "")
        answer = _answered(one, line, str(unit), one in alike or alone) if not own else None
        filled |= answer is not None or own == unit
        if own and own != unit:
            against.append(f"{quoted(name)} says {own}")
            answer = line.but(why=f"{line.why}; unit={unit} is for columns that say none")
        elif answer is None and line.trust == ASK and line.ask:
            answer = line.but(ask=f"unit={unit} does not answer it: {line.ask}")
        lines[name] = answer or line
    if unit and not filled and (against or unit == PERCENT):
        raise LogError(
            f"{source}: unit={unit} is for positions whose unit is open{SHARES * (unit == PERCENT)}, and there is none"
            f"{': ' * bool(against)}{', '.join(against[:3])}; leave unit= out, or correct a line in the mapping."
        )
    return lines


def _answered(one: Position, line: Line, unit: str, of_arm: bool) -> Line | None:
    """A position in the unit of the answer; None where that cannot be its unit, and its question stays."""
    if unit == TICKS and whole_numbers(one.values) and one.far < MOST_STEPS and not one.slide:
        if not one.in_a_turn:  # which of several turns has 0 rad, no answer says
            return _counted(one)
        why = f"unit= says {TICKS}, {STEPS_A_TURN} a turn and {STEP_AT_ZERO} at 0 rad: edit them for other servos"
        return _steps(one, STEP_AT_ZERO, LIKELY, why)
    if unit == PERCENT and one.share:
        return Line(quoted(one.claim.column), PERCENT, SURE, "unit= says percent, of the range of the robot's model")
    if unit in (TICKS, PERCENT) or (measures(unit, "angle") and (line.unit == "tick" or not of_arm)):
        return None
    return position_line(one, unit, "unit=")


# --- velocities ------------------------------------------------------------------------------------------------------


def per_second(claim: Claim) -> str:
    """The unit that a velocity says, a second where it says that of its position."""
    unit, whole = told(claim.unit), unit_of(claim.column)
    if not unit and (measures(whole, "rate", "speed") or whole == "erpm"):
        return whole
    return f"{unit}/s" if measures(unit, *POSITION) else unit


def velocity_line(claim: Claim, goes: Relation | None, base: Line) -> Line:
    """A velocity, by its unit or by how it goes with the derivative of the position.

    Args:
        claim: on its column.
        goes: of it against that derivative, both as in the file; None where no time is known.
        base: how the position is read.
    """
    if line := of_dialect(claim):
        return line
    name, unit, says = claim.column, per_second(claim), f"{claim.by} says {per_second(claim)}"
    rate, rates, hangs = measures(unit, "rate", "speed"), base.rates, base.trust == ASK
    if unit == "erpm":
        return Line(f"{quoted(name)}*2*pi/60", unit, ASK, "electrical rpm", ELECTRICAL)
    if unit and not rate:
        return Line(quoted(name), "?", ASK, f"{says}, which is no unit of a velocity")
    best, off, shown = "", math.inf, ""
    along = goes is not None and goes.fit > DERIVATIVE_FIT and goes.scale > 0.0
    if goes is not None and along:
        shown = f"{goes.scale:.3g} times the derivative of the position as logged"
    if goes is not None and along and base.factor and not hangs:
        factor = base.factor / goes.scale
        best, off = nearest_unit(factor, ((one, size) for one, (_, size) in rates.items()))
        if rate and abs(math.log(factor / rate.factor)) > off + 0.01:
            return in_unit(name, unit, ASK, f"{says}, but it is {shown}, as {best} would be")
    if goes is not None and goes.fit > DERIVATIVE_FIT and goes.scale < 0.0 and not hangs:
        line = in_unit(name, unit if rate else next(iter(rates)), ASK, "it goes against the derivative of the position")
        return line.but(ask=f"does this velocity count the other way round? {AGAINST.format(text=line.text)}")
    if rate:
        return in_unit(name, unit, SURE, says)
    if off < SAME_UNIT:
        return Line(quoted(name) + rates[best][0], best, base.trust, f"it is {shown}: {best}", base.ask)
    if goes is None or (hangs and base.unit != "tick"):
        own = next(iter(rates))
        return Line(quoted(name) + rates[own][0], own, ASK, f"no unit is said; taken for {own}", base.ask or UNTIMED)
    why = f"it is {shown}" if shown else "it does not go with the derivative of the position"
    ask = f"how many rad/s (slide: m/s) is one of {quoted(name)}? No unit is said, and {why}"
    return Line(quoted(name), "?", ASK, why, ask)


def goal_velocity_line(claim: Claim, goal: Line) -> Line:
    """A velocity that is commanded beside a goal, a second in the goal's unit where none is said; no derivative tells
    it."""
    if line := of_dialect(claim):
        return line
    if measures(per_second(claim), "rate", "speed"):
        return in_unit(claim.column, per_second(claim), SURE, f"{claim.by} says {per_second(claim)}")
    known = claim.unit in ("", "?") and measures(goal.unit, *POSITION)
    own, why = f"{goal.unit}/s", "no unit is known" if not known else f"no unit is said; taken for {goal.unit}/s"
    return in_unit(claim.column, own, LIKELY if known else ASK, f"{why}, as its goal")


# --- goals -----------------------------------------------------------------------------------------------------------


def goal_line(claim: Claim, base: Line) -> Line:
    """A goal or a second position, in its own unit or in that of the position."""
    if line := of_dialect(claim):
        return line
    unit, by = told(claim.unit), claim.by
    if unit == "tick" != base.unit:
        text = f"({quoted(claim.column)} - {STEP_AT_ZERO})*2*pi/{STEPS_A_TURN}"
        return Line(text, "tick", ASK, "counts of an encoder", GOAL_COUNTS)
    if unit and not measures(unit, *POSITION) and base.unit not in (unit, {"%": "percent"}.get(unit)):
        why = f"{by} says {unit}, which is no unit of an angle or a way"
        return in_unit(claim.column, unit, ASK, why, base.ask)
    if measures(unit, *POSITION):
        return in_unit(claim.column, unit, SURE, f"{by} says {unit}")
    of_position = next((quoted(name) for name in names_in(base.text) if name != "pi"), "")
    text, trust = base.text.replace(of_position, quoted(claim.column)), ASK if base.trust == ASK else LIKELY
    return Line(text, base.unit, trust, f"in the unit of the position, {base.unit}", base.ask)


def doubted(line: Line, base: Line, goes: Relation, time: Array | None, goal: Array, position: Array) -> Line:
    """A goal's line with how late its position comes, in question where it does not come after it, or moves as in
    another unit.

    Args:
        line: how the column becomes a goal.
        base: how the position is read.
        goes: of the position behind the goal.
        time: of the samples [s], None where it is not known.
        goal, position: their columns as logged (n,).
    """
    clock = np.arange(len(goal), dtype=np.float64) * 0.01 if time is None else time
    own, known = (measures(one.unit, *POSITION) for one in (line, base))
    times, why = abs(goes.scale), ""
    further = times * known.factor / own.factor if own and known else 0.0
    open_unit = line.why.startswith("in the unit of") or base.open
    if goes.fit < COMPARED_FIT and move_apart(clock, goal, position, COMPARED_FIT):
        why = "The position does not move as it does"
    elif goes.fit > FOLLOWED_FIT and goes.scale < 0.0:
        why = f"The position moves against this goal. If it counts the other way round, write -{line.text}"
    elif goes.fit > FOLLOWED_FIT and time is not None and goes.lag < 0.0:
        why = f"The position moves {-1e3 * goes.lag:.0f} ms before it: are goal and position exchanged?"
    elif goes.fit > FOLLOWED_FIT and time is not None and goes.lag > LONGEST_LAG - MOTION_WINDOW:
        why = f"The position follows it best after {goes.lag:.2g} s, the longest delay that is looked at"
    elif (
        further and open_unit and base.trust != ASK and goes.fit > COMPARED_FIT
        and abs(math.log(further)) > math.log(ANOTHER_UNIT)
    ):  # fmt: skip
        why = f"In the file the position moves {times:.2g} times as far, as in another unit"
    elif further > ANOTHER_UNIT and base.trust != ASK and goes.fit > COMPARED_FIT:
        why = f"The position moves {further:.2g} times as far, as that of a motor before its gear does"
    late = (
        f"; the position follows it by {1e3 * goes.lag:.0f} ms" if goes.fit > FOLLOWED_FIT and time is not None else ""
    )
    if not why or line.trust == ASK:
        return line if line.trust == ASK else line.but(why=line.why + late)
    ask = f"is this the goal of the position beside it? {why}. Else give another column, or remove it"
    return line.but(trust=ASK, why=why, ask=ask)
