"""The unit of positions: said, shown by an encoder's step or a velocity, answered by ``unit=``, else a question."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..types import Array, LogError
from .expression import quoted
from .lines import (
    ASK,
    DERIVATIVE_FIT,
    FULL_SHARE,
    LIKELY,
    POSITION,
    ROUGHLY_UNIT,
    SAME_UNIT,
    SURE,
    Line,
    in_unit,
    nearest_unit,
    of_dialect,
    per_second,
    reach,
    told,
)
from .motion import TURN_IN_UNIT, Relation, encoder, span, whole_numbers
from .names import Claim, is_a
from .recording import LARGEST_EXACT
from .units import measure, measures

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
    f"encoder steps of a servo (unit={TICKS}: {STEPS_A_TURN} a turn and {STEP_AT_ZERO} at 0 rad, as in these lines), "
    "degrees (unit=deg), rad (unit=rad) or mm of a slide (unit=mm)? Whole numbers within 0..4095 are probably steps; a "
    "servo with 1024 of them over 300 degrees (SCS, AX) needs (<column> - 512)*300/1024*pi/180 in these lines"
)
SHARES = ", and that stay within 0 to 100"
COUNTS = f"how many counts are a turn, and which one is 0 rad? {STEPS_A_TURN} and 0 stand in these lines"
SHARE = (
    "a share of the calibrated range, whose ends are low and high in rad (slide: m)? 0..100 is unit=percent beside "
    "robot=<its file>, or low + <column>/100*(high - low); -100..100 is middle + <column>/100*(high - low)/2, an "
    "opening of 0..1 low + <column>*(high - low)"
)
UNSAID = (
    f"degrees (unit=deg), rad (unit=rad), turns (unit=turn), encoder steps (unit={TICKS}) or mm of a slide (unit=mm)? "
    "No unit is said"
)


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
    whole = whole_numbers(one.values) and TURN_IN_UNIT["deg"] < span(one.values) < LARGEST_EXACT
    if unit == "m" and by == "the name" and span(one.values) > MOST_WAY:
        ask = "m of a slide (unit=m), or the angle of a motor that the name means (unit=deg, unit=rad)?"
        return in_unit(name, unit, ASK, f"the name ends in m; {shown}", ask)
    if unit == "tick" or (unit in ("", "?") and whole):
        return _counted(one)
    if unit in ("rad", "deg") and found and found[0] != unit:
        why = f"{by} says {unit}, but the steps of its values are a turn in {found[0]} by {found[1]}"
        return in_unit(name, found[0], ASK, why)
    if unit == "rad" and one.far > MOST_RAD:
        return _too_far(one, by)
    if measures(unit, *POSITION):
        return in_unit(name, unit, SURE, f"{by} says {unit}; {shown}")
    if found:
        return in_unit(name, found[0], SURE, f"its steps are a turn in {found[0]} by {found[1]}; {shown}")
    if told(unit) and unit != "%":
        asked = f"{by} says {unit}, which is no unit of an angle or a way"
        return in_unit(name, unit, ASK, f"{asked}; {shown}", f"{asked}: write what makes it rad (slide: m)")
    if is_a("radian", one.claim.how.lower()) and not (unit or one.slide) and one.far <= PLAIN_RAD:
        why = f"{one.claim.how!r} is a joint's angle, in rad by custom; {shown}"
        return in_unit(name, "rad", LIKELY, why, open=True)
    return _open(one)


def _open(one: Position) -> Line:
    """A question for the unit of a position; the line has the column as it stands."""
    ask = SHARE if one.claim.unit == "%" else f"{UNSAID}. Or {SHARE}"
    unit = "m" if one.slide else "rad"
    return Line(quoted(one.claim.column), unit, ASK, f"no unit is said; {reach(one.values)}", ask, open=True)


def _steps(one: Position, middle: int, trust: str, why: str, ask: str = "") -> Line:
    """Steps of an encoder as an angle."""
    column = quoted(one.claim.column)
    text = f"({column} - {middle})*2*pi/{STEPS_A_TURN}" if middle else f"{column}*2*pi/{STEPS_A_TURN}"
    return Line(text, "tick", trust, why, ask)


def _counted(one: Position) -> Line:
    """Steps of an encoder, asked about: those of a servo, or of a turn that nobody says."""
    servo = one.low >= 0.0 and one.high < STEPS_A_TURN
    why = f"counts of an encoder, {reach(one.values)}"
    return _steps(one, STEP_AT_ZERO * servo, ASK, why, STEPS if servo else COUNTS)


def _too_far(one: Position, by: str) -> Line:
    """An angle that goes too far for rad: in degrees, or with stray values for lost samples."""
    column, why = quoted(one.claim.column), f"{by} says rad, but it reaches {reach(one.values)}"
    stray = int((np.abs(one.values) > MOST_RAD).sum())
    ask = f"{why}: degrees? If {stray} lost samples reach so far, leave them out by the line `where: {MOST_RAD:g} - "
    return Line(column, "rad", ASK, why, f"{ask}abs({column})` in the mapping")


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
    if goes is None or rate is None or goes.fit <= DERIVATIVE_FIT or goes.scale <= 0.0:
        return line
    if not line.open:
        return line
    known = {unit: measure(unit) for unit in POSSIBLE["way" if rate.quantity == "speed" else "angle"]}
    best, off = nearest_unit(rate.factor * goes.scale, ((unit, size.factor) for unit, size in known.items() if size))
    trust, why = SURE if off < SAME_UNIT else LIKELY, f"the velocity in {unit} is its derivative in {best}"
    return in_unit(one.claim.column, best, trust, why) if off < ROUGHLY_UNIT else line


class Positions:
    """Lines of all positions of a recording, with what ``unit=`` says of those whose unit is open.

    Args:
        unit: that was answered; None where nobody did.
        found: the positions.

    Attributes:
        lines: of the positions, by column.
    """

    def __init__(self, unit: str | None, found: Sequence[Position]) -> None:
        self.unit = unit
        lines = {one.claim.column: position_line(one, one.claim.unit, one.claim.by) for one in found}
        registers = [one for one in found if one.register]
        if any(one.high > TURN_IN_UNIT["deg"] for one in registers):  # further than degrees
            lines |= {one.claim.column: _counted(one) for one in registers}
        alone = all(one.of_gripper for one in found)  # else a gripper may be in a unit of its own
        alike = [one for one in found if lines[one.claim.column].open and (alone or not one.of_gripper)]
        if any(lines[one.claim.column].trust == ASK for one in alike):
            lines |= {one.claim.column: _open(one) for one in alike}
        said = {one.claim.column: self._said(one, lines[one.claim.column]) for one in found}
        answers = {one.claim.column: answer for one in found if unit and not said[one.claim.column]
                   if (answer := self._answer(one, lines[one.claim.column], one in alike or alone))}  # fmt: skip
        self.filled = bool(answers) or unit in said.values()
        self.against = {name: own for name, own in said.items() if own and own != unit}
        self.lines = lines | answers
        for name in self.against if unit else ():
            self.lines[name] = lines[name].but(why=f"{lines[name].why}; unit={unit} is for columns that say none")

    def _said(self, one: Position, line: Line) -> str:
        """The unit that a column says or shows itself; steps and shares are what the answer is about."""
        own = told(one.claim.unit)
        open_ones = (own, self.unit) in (("tick", TICKS), ("%", PERCENT))
        return "" if open_ones else own or one.claim.formula or (line.unit if line.trust == SURE else "")

    def _answer(self, one: Position, line: Line, of_arm: bool) -> Line | None:
        """A position in the unit of the answer; None where that cannot be its unit, and its question stays."""
        unit, shown = self.unit or "", reach(one.values)
        if unit == TICKS and whole_numbers(one.values) and one.far < MOST_STEPS and not one.slide:
            why = f"unit= says {TICKS}, {STEPS_A_TURN} a turn and {STEP_AT_ZERO} at 0 rad: edit them for other servos"
            return _steps(one, STEP_AT_ZERO, LIKELY, f"{why}; {shown}")
        if unit == PERCENT and one.share:
            why = f"unit= says percent, of the range that the robot's model has; {shown}"
            return Line(quoted(one.claim.column), PERCENT, SURE, why)
        if unit in (TICKS, PERCENT) or (measures(unit, "angle") and (line.unit == "tick" or not of_arm)):
            return None
        return position_line(one, unit, "unit=")

    def check(self, source: Path) -> None:
        """Refuse an answer that no column has a use for.

        Raises:
            LogError: each column says another unit itself, or none is a share.
        """
        if self.unit is None or self.filled or not (self.against or self.unit == PERCENT):
            return
        says = ": " + ", ".join(f"{quoted(name)} says {unit}" for name, unit in list(self.against.items())[:3])
        raise LogError(
            f"{source}: unit={self.unit} is for positions whose unit is open{SHARES * (self.unit == PERCENT)}, and "
            f"there is none{says * bool(self.against)}; leave unit= out, or correct a line in the mapping."
        )
