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
from .lines import ANGLE, ASK, LIKELY, SURE, Line, goal_line, of_dialect, reach, told
from .motion import Relation, encoder, span, whole_numbers
from .names import Claim, is_a
from .units import measures

TICKS, PERCENT = "ticks", "percent"
"""Words of ``unit=`` that no column is converted by alone: a turn and a zero, or a range belong to them."""
TURN, ZERO = 4096, 2048
"""Steps of a turn and the step at 0 rad that ``unit=ticks`` takes: of Feetech STS and Dynamixel X servos (their
registers in hw/bus/registers), mounted with 0 rad in the middle (assumed)."""
REGISTER, FEW_STEPS = 32768.0, 1023.0
"""Steps that a register of 16 bits with a sign does not hold; the largest of a servo that has 1024 over 300 degrees
(hw/bus/registers/scs0009.yaml)."""
FEWEST_STEPS, MOST_COUNTS = 400.0, 2.0**53
"""Whole numbers that reach over less may be degrees; beyond the second a float counts none."""
PLAIN_RAD, SEVERAL_TURNS, MOST_RAD = 2.2 * math.pi, 12.0, 60.0
"""An angle in rad without a turn to spare stays below the first; beyond the second a guess is degrees, and beyond the
third it is hardly in rad."""
STRAY = 0.02
"""Share of the samples that may lie far outside as what a recorder writes for a lost one."""
MOST_WAY = 10.0  # [m]
"""What a slide may travel before a name that ends in m is doubted."""
OF_FEW = "a servo with 1024 of them over 300 degrees (SCS, AX) needs (<column> - 512)*300/1024*pi/180 in these lines"
STEPS = (
    f"encoder steps of a servo (unit={TICKS}: {TURN} a turn and {ZERO} at 0 rad, as in these lines), degrees "
    f"(unit=deg), rad (unit=rad) or mm of a slide (unit=mm)? Whole numbers within 0..4095 are probably steps; {OF_FEW}"
)
TURN_OF_FEW = f"how many steps are a turn? {TURN} is taken, and no step goes beyond 1023: {OF_FEW}"
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
    def opening(self) -> bool:
        """Whether it fills 0 to 1 and shows no encoder, as the opening of a gripper does."""
        within = self.low >= 0.0 and self.high <= 1.001 and (self.gripper or span(self.values) > 0.8)
        return within and encoder(self.values) is None

    @property
    def gripper(self) -> bool:
        return is_a("gripper", *self.claim.words)

    @property
    def register(self) -> bool:
        """Whether nobody says its unit, and it and its goals are whole numbers of a servo's register."""
        of_steps = all(
            whole_numbers(values) and float(np.nanmin(values)) >= 0.0 and float(np.nanmax(values)) < TURN
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
    column, shown = quoted(one.claim.column), reach(one.values)
    known, found = measures(unit, "angle", "way"), encoder(one.values)
    sure = Line(column + (known.behind if known else ""), unit, SURE, f"{by} says {unit}; {shown}")
    if unit == "m" and by == "the name" and span(one.values) > MOST_WAY:
        ask = "m of a slide (unit=m), or the angle of a motor that the name means (unit=deg, unit=rad)?"
        return sure.but(trust=ASK, why=f"the name ends in m; {shown}", ask=ask)
    whole = whole_numbers(one.values) and FEWEST_STEPS < span(one.values) < MOST_COUNTS
    if unit == "tick" or (unit in ("", "?") and whole):
        return _counted(column, one)
    if unit in ("rad", "deg") and found and found[0] != unit:
        why = f"{by} says {unit}, but the steps of its values are a turn in {found[0]} by {found[1]}"
        return Line(column + ANGLE[found[0]], found[0], ASK, why)
    if unit == "rad" and one.far > MOST_RAD:
        return _too_far(column, one.values, by)
    if known:
        return sure
    if found:
        why = f"its steps are a turn in {found[0]} by {found[1]}; {shown}"
        return Line(column + ANGLE[found[0]], found[0], SURE, why)
    if told(unit) and unit != "%":
        asked = f"{by} says {unit}, which is no unit of an angle or a way"
        return sure.but(trust=ASK, why=f"{asked}; {shown}", ask=f"{asked}: write what makes it rad (slide: m)")
    if is_a("radian", one.claim.how.lower()) and not (unit or one.slide) and one.far <= PLAIN_RAD:
        why = f"{one.claim.how!r} is a joint's angle, in rad by custom; {shown}"
        return Line(column, "rad", LIKELY, why, open=True)
    return _open(one, one.far)


def _open(one: Position, far: float) -> Line:
    """A question for the unit of a position, with a guess by how far all that are alike go."""
    column, unit = quoted(one.claim.column), "m" if one.slide else "rad" if far <= SEVERAL_TURNS else "deg"
    ask = SHARE if one.claim.unit == "%" else UNSAID
    ask += f". Or {SHARE}" if ask == UNSAID and (far > PLAIN_RAD or one.opening) else ""
    return Line(column + ANGLE.get(unit, ""), unit, ASK, f"no unit is said; {reach(one.values)}", ask, open=True)


def _counted(column: str, one: Position) -> Line:
    """Steps of an encoder: those of a servo, or of a turn that is the next power of two."""
    counts = max(one.high - min(one.low, 0.0), 2.0)
    turn = TURN if one.high < 4200 or not counts < MOST_COUNTS else 2 ** math.ceil(math.log2(counts))
    middle = turn // 2 if one.low >= 0 else 0
    text = f"({column} - {middle})*2*pi/{turn}" if middle else f"{column}*2*pi/{turn}"
    ask = f"how many counts are a turn, and which one is 0 rad? {turn} and {middle} are a guess"
    ask = STEPS if (turn, middle) == (TURN, ZERO) else ask
    return Line(text, "tick", ASK, f"counts of an encoder, {reach(one.values)}", ask)


def _too_far(column: str, values: Array, by: str) -> Line:
    """An angle that goes too far for rad: in degrees, or with stray values for lost samples."""
    stray, why = np.isfinite(values) & (np.abs(values) > MOST_RAD), f"{by} says rad, but it reaches {reach(values)}"
    if stray.sum() > STRAY * len(values):
        return Line(column + ANGLE["deg"], "deg", ASK, why, f"{why}: degrees?")
    first = int(np.argmax(stray))
    ask = (
        f"{column} is {values[first]:.4g} in row {first + 1}, {int(stray.sum())} such in all, which is no angle in "
        f"rad: leave these samples out by the line `where: {MOST_RAD:g} - abs({column})` in the mapping"
    )
    return Line(column, "rad", ASK, why, ask)


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
            self.lines |= {one.claim.column: _counted(quoted(one.claim.column), one) for one in registers}
        steps = [values for one in registers for values in (one.values, *one.goals)]
        self.few = bool(steps) and max(float(np.nanmax(values)) for values in steps) <= FEW_STEPS
        self._decide_together()

    def _decide_together(self) -> None:
        """One decision for all positions of which nobody says the unit: an encoder's step tells it, else all are asked
        about where one is. Openings and shares of a gripper may be in a unit of their own."""
        lines = self.lines
        alike = [one for one in self.found if lines[one.claim.column].open and not self._stands_apart(one)]
        by_step = [one.claim.column for one in self.found if not told(one.claim.unit) and not one.claim.formula]
        shown = {lines[name].unit: name for name in by_step if lines[name].trust == SURE}
        if len(shown) == 1:
            ((unit, name),) = shown.items()
            for one in alike:
                why = f"{reach(one.values)}; in the unit of {quoted(name)}, whose steps are an encoder's"
                lines[one.claim.column] = Line(quoted(one.claim.column) + ANGLE[unit], unit, LIKELY, why)
        elif any(lines[one.claim.column].trust == ASK for one in alike):
            far = max(one.far for one in alike)
            lines |= {one.claim.column: _open(one, far) for one in alike}

    def _stands_apart(self, one: Position) -> bool:
        """Whether it is an opening or a share beside other joints that are none, as a gripper's is."""
        others = [other for other in self.found if other is not one]
        share = one.share and (one.gripper or any(encoder(other.values) for other in others))
        return (one.opening and not all(other.opening for other in others)) or (
            share and any(not other.share for other in others)
        )

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
            why = f"unit= says {TICKS}: {TURN} a turn, {ZERO} at 0 rad (assumed: edit them); {reach(one.values)}"
            text = f"({quoted(column)} - {ZERO})*2*pi/{TURN}"
            return Line(text, "tick", ASK if self.few else SURE, why, TURN_OF_FEW if self.few else "")
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
            return whole_numbers(one.values) and one.far < REGISTER and not one.slide
        if self.unit == PERCENT:
            return one.share
        steps = self.lines[one.claim.column].unit == "tick"
        return not (measures(self.unit or "", "angle") and (steps or self._stands_apart(one)))

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
