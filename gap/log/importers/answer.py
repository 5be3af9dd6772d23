"""The answer ``unit=`` of the call: it fills the units that are open, and no other."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..types import Array, LogError
from . import steps
from .column import Column, span, without_doubt
from .evidence import Relation, encoder, whole_numbers
from .expression import quoted
from .one_unit import fills_opening, together
from .unit_words import measures
from .units import ASK, CLOSE, LIKELY, POSITION, SURE, Read, is_opening, read_alike, read_position

APART = 20.0
"""Two joints whose motions differ by this factor in one unit are hardly both in it."""


@dataclass
class Answer:
    """What ``unit=`` did.

    Attributes:
        unit: of positions and goals that say none; None where nobody answered.
        largest: motion of the joints whose unit is in question, in the unit of the file.
        filled: columns that it is for, or that say the same.
        against: unit that a column says itself, by column.
        steps: the question, by column of a position whose whole numbers look like encoder steps.
        gridded: whether a position shows the steps of an encoder that its unit is told by.
        together: how a position is read by others of its name, by column.
        few: whether no step goes beyond those of a servo that has 1024.
        wide: whether a position goes beyond an opening from 0 to 1.
    """

    unit: str | None
    largest: float = 0.0
    filled: set[str] = field(default_factory=set)
    against: dict[str, str] = field(default_factory=dict)
    steps: dict[str, str] = field(default_factory=dict)
    gridded: bool = False
    together: dict[str, Read] = field(default_factory=dict)
    few: bool = False
    wide: bool = False

    def look_at(self, positions: Iterable[tuple[Column, Array, Sequence[Array]]]) -> None:
        """Note how far the joints move that the question for the unit is about, and which are in encoder steps.

        Args:
            positions: column, values (n,) and goals, each (n,), of each joint.
        """
        whole: dict[str, float] = {}
        turned = False
        reads: list[tuple[Column, Array, Read]] = []
        for column, values, goals in positions:
            read = read_position(column.name, values, column.unit, column.how, rest=column.rest)
            if read.trust == ASK:
                self.largest = max(self.largest, span(values))
            reads.append((column, values, read))
            self.gridded |= read.trust == SURE and encoder(values) is not None
            self.wide |= not is_opening(values)
            if column.unit in ("", "?", "tick") and steps.may_be_steps(values, goals):
                whole[column.name] = max(float(np.nanmax(one)) for one in (values, *goals))
                turned |= steps.beyond_degrees(values)
        self.few = bool(whole) and max(whole.values()) <= steps.FEW
        if turned:
            self.steps = dict.fromkeys(whole, steps.ASKED_OF_FEW if self.few else steps.ASKED)
        self.together = together([one for one in reads if one[0].name not in self.steps])

    def position(self, column: Column, values: Array, slide: bool) -> Read:
        """A position, in the unit of the answer where its own is open."""
        asked = "" if slide else self.steps.get(column.name, "")
        read = read_position(column.name, values, "tick" if asked else column.unit, column.how, slide, column.rest)
        if asked:
            read = replace(read, ask=asked)
        if self.unit is None:
            return read if asked or slide else self.together.get(column.name, read)
        own = without_doubt(column.unit)
        if (own, self.unit) in (("tick", steps.TICKS), ("%", steps.PERCENT)):
            own = ""
        if own or read.trust == SURE:
            return self._kept(column.name, read, own or read.unit)
        if self.unit == steps.PERCENT and not steps.is_percent(values):
            return read
        self.filled.add(column.name)
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        if read.trust == LIKELY and read.unit != self.unit and APART * span(values) < self.largest:
            ask = (
                f"is {quoted(column.name)} in {read.unit}? As unit={self.unit} it goes from {low:.3g} to {high:.3g}, "
                f"where another joint moves by {self.largest:.3g}"
            )
            return replace(read, trust=ASK, ask=ask)
        if self.unit == steps.PERCENT:
            why = f"unit= says percent, of the range that the robot's model has; {low:.3g} to {high:.3g}"
            return Read(quoted(column.name), steps.PERCENT, SURE, why)
        if self.unit == steps.TICKS:
            return _in_steps(column.name, values, slide, self.few)
        answered = read_position(column.name, values, self.unit, "unit=", slide)
        if self.gridded and measures(self.unit, "angle") and steps.is_percent(values) and encoder(values) is None:
            ask = (
                f"is {quoted(column.name)} in {self.unit}, as unit= says? It stays within 0 and 100 and shows no "
                "encoder's steps, which other joints do: as an opening in percent is (unit=percent)"
            )
            return replace(answered, trust=ASK, ask=ask)
        if self.wide and measures(self.unit, "angle") and encoder(values) is None and fills_opening(column, values):
            ask = (
                f"in {self.unit}, as unit= says? These stay within 0 and 1, which other joints do not, as an opening "
                "does: write low + <column>*(high - low) with the ends of its range in rad (slide: m)"
            )
            return replace(answered, trust=ASK, ask=ask)
        if asked and measures(self.unit, "angle"):
            ask = (
                f"are these in {self.unit}, as unit= says? Positions and goals are whole numbers within 0..4095, as "
                f"encoder steps are (unit={steps.TICKS})"
            )
            return replace(answered, trust=ASK, ask=ask)
        return answered

    def alike(self, column: Column, base: Read, goes: Relation) -> Read:
        """A goal or a second position, in the unit of the answer where its own is open."""
        own = without_doubt(column.unit)
        if (own, self.unit) in (("tick", steps.TICKS), ("%", steps.PERCENT)):
            own = ""
        read = read_alike(column.name, own, column.how, base, goes)
        if self.unit is None:
            return read
        if own:
            return self._kept(column.name, read, own)
        if self.unit != steps.PERCENT or base.unit == steps.PERCENT:
            self.filled.add(column.name)
        known = measures(self.unit, *POSITION)
        shared = {steps.TICKS: "tick", steps.PERCENT: steps.PERCENT}.get(self.unit)
        if base.trust == ASK or (known is None and base.unit != shared):
            return read
        told = goes.fit > 0.3 and goes.scale > 0.0
        if known is None:
            if told and abs(math.log(goes.scale)) > math.log(CLOSE):
                ask = (
                    f"is {quoted(column.name)} in {self.unit}, as unit= says? The position moves {goes.scale:.2f} "
                    "times as far"
                )
                return replace(read, trust=ASK, ask=ask)
            text = steps.steps_text(column.name) if self.unit == steps.TICKS else quoted(column.name)
            return Read(text, base.unit, SURE, f"unit= says {self.unit}")
        if told and read.unit != self.unit:
            ask = f"is {quoted(column.name)} in {self.unit}, as unit= says? {read.why[0].upper()}{read.why[1:]}"
            return replace(read, trust=ASK, ask=ask)
        return Read(quoted(column.name) + known.behind, self.unit, SURE, f"unit= says {self.unit}")

    def _kept(self, name: str, read: Read, said: str) -> Read:
        if said == self.unit:
            self.filled.add(name)
            return read
        self.against[name] = said
        return replace(read, why=f"{read.why}; unit={self.unit} is for columns that say none")

    def check(self, source: Path) -> None:
        """Refuse an answer that no column has a use for.

        Raises:
            LogError: each column says another unit itself, or none is a share.
        """
        if self.unit == steps.PERCENT and not self.filled:
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


def _in_steps(name: str, values: Array, slide: bool, few: bool) -> Read:
    """A position that ``unit=ticks`` says to be in encoder steps."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    read = Read(
        steps.steps_text(name), "tick", SURE,
        f"unit= says {steps.TICKS}: {steps.TURN} a turn, {steps.ZERO} at 0 rad (assumed: edit them); "
        f"{low:.5g} to {high:.5g}",
    )  # fmt: skip
    ask = ""
    if slide:
        ask = f"{quoted(name)} is of a slide: how many m is a step, and which step is 0 m?"
    elif not whole_numbers(values):
        ask = f"is {quoted(name)} in {steps.TICKS}, as unit= says? Its values are no whole numbers"
    elif max(abs(low), abs(high)) >= steps.REGISTER:
        ask = (
            f"how many steps of {quoted(name)} are a turn, and which one is 0 rad? It goes from {low:.0f} to {high:.0f}"
        )
    elif few:
        ask = steps.TURN_OF_FEW
    return replace(read, trust=ASK, ask=ask) if ask else read
