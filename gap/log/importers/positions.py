"""The unit of positions: said, shown by an encoder's step, answered by ``unit=``, or asked about for all together."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..types import Array, LogError
from .expression import quoted
from .lines import ANGLE, ASK, LIKELY, POSITION, SAME_UNIT, SURE, TOLD_FIT, Line, goal_line, of_dialect, reach, told
from .motion import Relation, encoder, span, whole_numbers
from .names import Claim, is_a
from .units import UNIT_OR_NAME, measures

TICKS, PERCENT = "ticks", "percent"
"""Words of ``unit=`` that no column is converted by alone: a turn and a zero, or a range belong to them."""
TURN, ZERO = 4096, 2048
"""Steps of a turn and the step at 0 rad that ``unit=ticks`` takes: of Feetech STS and Dynamixel X servos (their
registers in hw/bus/registers), mounted with 0 rad in the middle (assumed)."""
REGISTER, FEW_STEPS = 32768.0, 1023
"""Steps that a register of 16 bits with a sign does not hold; the largest of a servo that has 1024 over 300 degrees
(hw/bus/registers/scs0009.yaml)."""
OF_FEW = "(<column> - 512)*300/1024*pi/180"
PLAIN_RAD, MOST_RAD = 2.2 * math.pi, 60.0
"""An angle in rad without a turn to spare stays below the first; one beyond the second is hardly in rad."""
MOST_COUNTS = 2.0**53
"""Beyond it a float counts no whole numbers."""
STRAY = 0.02
"""Share of the samples that may lie far outside as what a recorder writes for a lost one."""
MOST_WAY = 10.0  # [m]
"""What a slide may travel before a name that ends in m is doubted."""
UNLIKE = 20.0
"""Two joints whose motions differ by this factor in one unit are hardly both in it."""
STEPS = (
    f"encoder steps of a servo (unit={TICKS}: {TURN} a turn and {ZERO} at 0 rad, as in these lines), degrees "
    "(unit=deg), rad (unit=rad) or mm of a slide (unit=mm)? Whole numbers within 0..4095 are probably steps"
)
TURN_OF_FEW = (
    f"how many steps are a turn? {TURN} is taken, and no step goes beyond {FEW_STEPS}: a servo with 1024 of them over "
    f"300 degrees (SCS, AX) needs {OF_FEW} in these lines. Keep them if it has more"
)
SHARE = (
    "0..100 of the joint's range (unit=percent beside robot=<its file>: the range that its model has; else write low + "
    "<column>/100*(high - low) with the ends of the calibrated range in {si})"
)
SIGNED_SHARE = (
    "-100..100 of the range that was calibrated: write middle + <column>/100*(high - low)/2 with the ends and the "
    "middle of "
    "that range in {si}"
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
    def opening(self) -> bool:
        """Whether it stays within 0 and 1, as the opening of a gripper does."""
        return self.low >= 0.0 and self.high <= 1.001 and self.high - self.low > 0.2

    @property
    def share(self) -> bool:
        """Whether it stays within 0 to 100, but for 2 % of that."""
        return self.low >= -2.0 and self.high <= 102.0

    @property
    def gripper(self) -> bool:
        return is_a("gripper", *self.claim.words)

    @property
    def open_unit(self) -> bool:
        """Whether nobody says its unit."""
        return not (told(self.claim.unit) or self.claim.rest or self.slide or self.claim.formula)


def position_line(one: Position, unit: str, by: str) -> Line:
    """An angle or a way by the unit that somebody says, by the step of its encoder, or by its range.

    Args:
        one: the position.
        unit: that is said; ``?`` where the format leaves it open.
        by: who says it.
    """
    if line := of_dialect(one.claim):
        return line
    column, shown, far = quoted(one.claim.column), reach(one.values), max(abs(one.low), abs(one.high))
    sure = Line(column, unit, SURE, f"{by} says {unit}; {shown}")
    angle, way, found = measures(unit, "angle"), measures(unit, "way"), encoder(one.values)
    if way and unit == "m" and by == "the name" and one.high - one.low > MOST_WAY:
        ask = "m of a slide (unit=m), or the angle of a motor that the name means (unit=deg, unit=rad)?"
        return sure.but(trust=ASK, why=f"the name ends in m; {shown}", ask=ask)
    if way:
        return sure.but(text=column + way.behind)
    counts = one.high - min(one.low, 0.0) < MOST_COUNTS
    if counts and (unit == "tick" or (unit in ("", "?") and whole_numbers(one.values) and one.high - one.low > 400)):
        return _counted(column, one)
    if angle and unit in ("rad", "deg") and found and found[0] != unit:
        why = f"{by} says {unit}, but the steps of its values are a turn in {found[0]} by {found[1]}"
        return Line(column + ANGLE[found[0]], found[0], ASK, why)
    if angle and unit == "rad" and far > MOST_RAD:
        return _too_far(column, one.values, by)
    if angle:
        return sure.but(text=column + angle.behind)
    if found:
        why = f"its steps are a turn in {found[0]} by {found[1]}; {shown}"
        return Line(column + ANGLE[found[0]], found[0], SURE, why)
    if one.claim.rest and not unit:
        return _unit_or_name(column, one.claim.rest, shown)
    if one.slide and not unit:
        return Line(column, "m", LIKELY, f"of a slide; {shown}, taken for m", by_range=True)
    if told(unit) and unit != "%":
        asked = f"{by} says {unit}, which is no unit of an angle or a way"
        return sure.but(trust=ASK, why=f"{asked}; {shown}", ask=f"{asked}: write what makes it rad (slide: m)")
    return _by_range(one, unit, column, shown, far)


def _counted(column: str, one: Position) -> Line:
    """Steps of an encoder: those of a servo, or of a turn that is the next power of two."""
    turn = TURN if one.high < 4200 else 2 ** math.ceil(math.log2(max(one.high - min(one.low, 0.0), 2.0)))
    middle = turn // 2 if one.low >= 0 else 0
    text = f"({column} - {middle})*2*pi/{turn}" if middle else f"{column}*2*pi/{turn}"
    ask = f"how many counts are a turn, and which one is 0 rad? {turn} and {middle} are a guess"
    ask = STEPS if (turn, middle) == (TURN, ZERO) else ask
    return Line(text, "tick", ASK, f"counts of an encoder, {one.low:.3g} to {one.high:.3g}", ask)


def _by_range(one: Position, unit: str, column: str, shown: str, far: float) -> Line:
    """An angle that nobody says the unit of: rad, as is usual, where its range fits, and else a question."""
    si = "m" if one.slide else "rad"
    share = (SIGNED_SHARE if one.low < 0.0 else SHARE).format(si=si)
    if unit:
        ask = share if unit == "%" else f"degrees (unit=deg), rad (unit=rad), or {share}"
        guess = "deg" if far > 105.0 or unit == "?" else "%"
        return Line(column + ANGLE["deg"], guess, ASK, shown, ask, unit == "?")
    if one.opening:
        ask = "an opening from 0 to 1, rad, turns or m? The values stay within 0 and 1 and show no encoder's steps"
        return Line(column, "rad", ASK, shown, ask, True)
    if far <= PLAIN_RAD:
        return Line(
            column, "rad", LIKELY, f"no unit is said; {shown} look like rad (of a slide they would be m)", "", True
        )
    guess = "deg" if far > 12.0 else "rad"
    ask = "degrees (unit=deg), rad over several turns (unit=rad), or mm of a slide (unit=mm)? No unit is said"
    if whole_numbers(one.values) and one.low >= 0.0:
        ask += f". Whole numbers may also be encoder steps (unit={TICKS})"
    if far <= 105.0 and (one.low >= 0.0 or far > 90.0):
        ask += f". Or is it a share? {share}"
    return Line(column + ANGLE[guess], guess, ASK, shown, ask, True)


def _unit_or_name(column: str, word: str, shown: str) -> Line:
    """An angle or a way whose name has a word that may be its unit or name its joint."""
    turns = word in UNIT_OR_NAME
    of_turns = f"turns (unit=turn), as {word!r} in the names may say, or does it name the joint (unit=rad, unit=deg)?"
    ask = of_turns if turns else (
        f"is {word!r} in the names the unit? It is none that is known: write what makes it rad (slide: m), or give the "
        "unit, as unit=deg, if the word names something else"
    )  # fmt: skip
    return Line(
        column + ANGLE["turn"] * turns, "turn" if turns else word, ASK, f"{word!r} may be its unit; {shown}", ask
    )


def _too_far(column: str, values: Array, by: str) -> Line:
    """An angle that goes too far for rad: in degrees, or with stray values for lost samples."""
    stray, why = np.isfinite(values) & (np.abs(values) > MOST_RAD), f"{by} says rad, but it reaches {reach(values)}"
    if stray.sum() > STRAY * len(values):
        return Line(column + ANGLE["deg"], "deg", ASK, f"{why}: degrees?")
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
        own = [(one, position_line(one, one.claim.unit, one.claim.by)) for one in self.found]
        whole = [one for one in self.found if one.claim.unit in ("", "?", "tick") and not one.claim.formula and all(
            whole_numbers(values) and float(np.nanmin(values)) >= 0.0 and float(np.nanmax(values)) < TURN
            for values in (one.values, *one.goals))]  # fmt: skip
        beyond = any(one.high > 360.0 for one in whole)  # further than degrees
        self.few = (
            bool(whole) and max(float(np.nanmax(one)) for own in whole for one in (own.values, *own.goals)) <= FEW_STEPS
        )
        self.steps = {one.claim.column for one in whole if beyond and not one.slide}
        self.largest = max((span(one.values) for one, line in own if line.trust == ASK), default=0.0)
        self.gridded = any(line.trust == SURE and encoder(one.values) is not None for one, line in own)
        self.together = self._together([(one, line) for one, line in own if one.claim.column not in self.steps])

    def _together(self, own: Sequence[tuple[Position, Line]]) -> dict[str, Line]:
        """One decision for all that say no unit: an encoder's steps tell it, else all are asked about where one is.

        Openings, grippers and a last one that stays within 0..100 may be in a unit of their own.
        """
        alike = [(one, line) for one, line in own if one.open_unit]
        by_range = [(one, line) for one, line in alike if line.by_range and not (one.opening or one.gripper)]
        shown = {line.unit: one.claim.column for one, line in alike if line.trust == SURE}
        asked = [(one, line) for one, line in by_range if line.trust == ASK and not (one is alike[-1][0] and one.share)]
        if len(shown) > 1 or not (shown or asked):
            return {}
        first, leading = (
            max(asked, key=lambda pair: span(pair[0].values)) if asked else by_range[0] if by_range else alike[0]
        )
        unit = next(iter(shown), leading.unit)
        name = shown.get(unit, first.claim.column)
        out: dict[str, Line] = {}
        for one, line in by_range:
            if (line.trust == LIKELY or ((one, line) in asked and not shown)) and (line.unit != unit or not shown):
                text, why = (
                    quoted(one.claim.column) + ANGLE[unit],
                    f"{reach(one.values)}; in the unit of {quoted(name)}",
                )
                told_by = Line(text, unit, LIKELY, f"{why}, whose steps are an encoder's") if shown else leading
                out[one.claim.column] = told_by.but(text=text, why=told_by.why if shown else why)
        return out

    def line(self, one: Position) -> Line:
        """A position, in the unit of the answer where its own is open."""
        column = one.claim.column
        asked = column in self.steps
        line = position_line(one, "tick" if asked else one.claim.unit, one.claim.by)
        if asked:
            line = line.but(
                ask=f"{STEPS}; those of a servo with 1024 steps over 300 degrees (SCS, AX) are {OF_FEW}"
                if self.few
                else STEPS
            )
        if self.unit is None or one.claim.formula:
            return line if asked or one.slide else self.together.get(column, line)
        own = self._own(one.claim)
        if own or line.trust == SURE:
            return self._kept(column, line, own or line.unit)
        if self.unit == PERCENT and not one.share:
            return line
        self.filled.add(column)
        if self.unit == PERCENT:
            why = f"unit= says percent, of the range that the robot's model has; {reach(one.values)}"
            return Line(quoted(column), PERCENT, SURE, why)
        if self.unit == TICKS:
            return self._in_steps(one)
        answered = position_line(replace(one, goals=()), self.unit, "unit=")
        doubt = self._doubt(one, asked, line) if measures(self.unit, "angle") else ""
        return answered.but(trust=ASK, ask=doubt) if doubt else answered

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

    def _doubt(self, one: Position, steps: bool, line: Line) -> str:
        """Why an answer that is an angle may not be for a position; empty where it may."""
        column = f"is {quoted(one.claim.column)} in {self.unit}, as unit= says?"
        whole = one.gripper or (one.low < 0.1 and one.high > 0.9)
        if line.trust == LIKELY and line.unit != self.unit and UNLIKE * span(one.values) < self.largest:
            return f"{column} It goes from {reach(one.values)}, where another joint moves by {self.largest:.3g}"
        if encoder(one.values) is None and one.opening and whole and not all(other.opening for other in self.found):
            return (
                f"in {self.unit}, as unit= says? These stay within 0 and 1, which other joints do not, as an opening "
                "does: write low + <column>*(high - low) with the ends of its range in rad (slide: m)"
            )
        if encoder(one.values) is None and self.gridded and one.share:
            return (
                f"{column} It stays within 0 and 100 and shows no encoder's steps, which other joints do: as an "
                f"opening in "
                "percent is (unit=percent)"
            )
        if steps:
            return f"are these in {self.unit}, as unit= says? Whole numbers within 0..4095 are steps (unit={TICKS})"
        return ""

    def _in_steps(self, one: Position) -> Line:
        """A position that ``unit=ticks`` says to be in encoder steps."""
        column, ask = quoted(one.claim.column), TURN_OF_FEW if self.few else ""
        if one.slide:
            ask = f"{column} is of a slide: how many m is a step, and which step is 0 m?"
        elif not whole_numbers(one.values):
            ask = f"is {column} in {TICKS}, as unit= says? Its values are no whole numbers"
        elif max(abs(one.low), abs(one.high)) >= REGISTER:
            ask = f"how many steps of {column} are a turn, and which one is 0 rad? It goes from {one.low:.0f} to "
            ask += f"{one.high:.0f}"
        why = (
            f"unit= says {TICKS}: {TURN} a turn, {ZERO} at 0 rad (assumed: edit them); {one.low:.5g} to {one.high:.5g}"
        )
        return Line(f"({column} - {ZERO})*2*pi/{TURN}", "tick", ASK if ask else SURE, why, ask)

    def goal(self, claim: Claim, base: Line, goes: Relation) -> Line:
        """A goal or a second position, in the unit of the answer where its own is open."""
        if line := of_dialect(claim):
            return line
        own, column = self._own(claim), quoted(claim.column)
        line = goal_line(claim if own else replace(claim, unit=""), base, goes)
        if self.unit is None:
            return line
        if own:
            return self._kept(claim.column, line, own)
        if self.unit != PERCENT or base.unit == PERCENT:
            self.filled.add(claim.column)
        known, other = measures(self.unit, *POSITION), measures(base.unit, *POSITION)
        if base.trust == ASK or (known is None and base.unit != {TICKS: "tick", PERCENT: PERCENT}.get(self.unit)):
            return line
        size = goes.scale * (other.factor / known.factor if known and other else 1.0)
        if goes.fit > TOLD_FIT and size > 0.0 and abs(math.log(size)) > math.log(SAME_UNIT):
            ask = f"is {column} in {self.unit}, as unit= says? The position moves {goes.scale:.2f} times as far"
            return line.but(trust=ASK, ask=ask)
        text = column + known.behind if known else f"({column} - {ZERO})*2*pi/{TURN}" if self.unit == TICKS else column
        return Line(text, self.unit if known else base.unit, SURE, f"unit= says {self.unit}")

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
