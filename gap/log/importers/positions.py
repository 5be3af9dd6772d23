"""The unit of positions: said, shown by an encoder's step or a velocity, answered by ``unit=``, else a question."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..types import Array, LogError
from .expression import quoted
from .lines import (
    ASK,
    DERIVATIVE_FIT,
    LIKELY,
    POSITION,
    ROUGHLY_UNIT,
    SAME_UNIT,
    SURE,
    Line,
    goal_line,
    in_unit,
    nearest_unit,
    of_dialect,
    per_second,
    reach,
    told,
)
from .motion import Relation, encoder, span, whole_numbers
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
FEWEST_STEPS = 400.0
"""Whole numbers that reach over less may be degrees."""
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
        return named and (self.share or 0.0 <= self.low <= self.high <= 1.001) and encoder(self.values) is None

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
    whole = whole_numbers(one.values) and FEWEST_STEPS < span(one.values) < LARGEST_EXACT
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


@dataclass
class Positions:
    """All positions of a recording, and what ``unit=`` says of those whose unit is open.

    Attributes:
        unit: that was answered; None where nobody did.
        found: the positions.
        filled: columns that the answer is for, or that say the same.
        against: unit that a column says itself, by column.
    """

    unit: str | None
    found: Sequence[Position]
    filled: set[str] = field(default_factory=set)
    against: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.lines = {one.claim.column: position_line(one, one.claim.unit, one.claim.by) for one in self.found}
        registers = [one for one in self.found if one.register]
        if any(one.high > 360.0 for one in registers):  # further than degrees
            self.lines |= {one.claim.column: _counted(one) for one in registers}
        self._decide_together()

    def _decide_together(self) -> None:
        """All positions of which nobody says the unit are asked about where one is; a gripper may be in its own."""
        alike = [one for one in self.found if self.lines[one.claim.column].open and not self._apart(one)]
        if any(self.lines[one.claim.column].trust == ASK for one in alike):
            self.lines |= {one.claim.column: _open(one) for one in alike}

    def _apart(self, one: Position) -> bool:
        """Whether it is the opening of a gripper beside joints that are none."""
        return one.of_gripper and not all(other.of_gripper for other in self.found)

    def line(self, one: Position) -> Line:
        """A position, in the unit of the answer where its own is open."""
        column, line = one.claim.column, self.lines[one.claim.column]
        if self.unit is None or one.claim.formula:
            return line
        own = self._own(one.claim)
        if own or line.trust == SURE:
            return self._kept(column, line, own or line.unit)
        if not self._fits(one):
            return line
        self.filled.add(column)
        if self.unit == PERCENT:
            why = f"unit= says percent, of the range that the robot's model has; {reach(one.values)}"
            return Line(quoted(column), PERCENT, SURE, why)
        if self.unit == TICKS:
            why = f"unit= says {TICKS}, {STEPS_A_TURN} a turn and {STEP_AT_ZERO} at 0 rad: edit them for other servos"
            return _steps(one, STEP_AT_ZERO, LIKELY, f"{why}; {reach(one.values)}")
        return position_line(one, self.unit, "unit=")

    def _own(self, claim: Claim) -> str:
        """The unit that a column says itself; steps and shares are what the answer is about."""
        own = told(claim.unit)
        return "" if (own, self.unit) in (("tick", TICKS), ("%", PERCENT)) else own

    def _kept(self, column: str, line: Line, own: str) -> Line:
        if own == self.unit:
            self.filled.add(column)
            return line
        self.against[column] = own
        return line.but(why=f"{line.why}; unit={self.unit} is for columns that say none")

    def _fits(self, one: Position) -> bool:
        """Whether the answer can be for a position: what it cannot be for keeps its question."""
        if self.unit == TICKS:
            return whole_numbers(one.values) and one.far < MOST_STEPS and not one.slide
        if self.unit == PERCENT:
            return one.share
        steps = self.lines[one.claim.column].unit == "tick"
        return not (measures(self.unit or "", "angle") and (steps or self._apart(one)))

    def goal(self, claim: Claim, base: Line, goes: Relation) -> Line:
        """A goal or a second position, in its own unit, in that of the answer, or in that of the position."""
        if line := of_dialect(claim):
            return line
        if own := self._own(claim):
            line = goal_line(claim, own, claim.by, base, goes)
            return line if self.unit is None else self._kept(claim.column, line, own)
        line = goal_line(claim, "", "", base, goes)
        if self.unit is None or (self.unit == PERCENT and base.unit != PERCENT):
            return line
        self.filled.add(claim.column)
        if measures(self.unit, "angle", "way") and base.trust != ASK:
            return goal_line(claim, self.unit, "unit=", base, goes)
        return line.but(trust=SURE, why=f"unit= says {self.unit}") if line.trust == LIKELY else line

    def check(self, source: Path) -> None:
        """Refuse an answer that no column has a use for.

        Raises:
            LogError: each column says another unit itself, or none is a share.
        """
        if self.unit == PERCENT and not self.filled:
            raise LogError(
                f"{source}: unit={self.unit} is for positions that stay within 0 to 100 and say no other unit, and "
                "there is none; leave unit= out."
            )
        if self.unit is not None and self.against and not self.filled:
            says = ", ".join(f"{quoted(name)} says {unit}" for name, unit in list(self.against.items())[:3])
            raise LogError(
                f"{source}: unit={self.unit} is for positions and goals whose unit is open, and none is: {says}; "
                "leave unit= out, or correct the line of a column in the mapping."
            )
