"""The answer ``unit=`` of the call: it fills the units that are open, and no other."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..types import Array, LogError
from .column import Column, span, without_doubt
from .evidence import Relation
from .expression import quoted
from .unit_words import measures
from .units import ASK, LIKELY, POSITION, SURE, Read, read_alike, read_position

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
    """

    unit: str | None
    largest: float = 0.0
    filled: set[str] = field(default_factory=set)
    against: dict[str, str] = field(default_factory=dict)

    def look_at(self, positions: Iterable[tuple[Column, Array]]) -> None:
        """Note how far the joints move that the question for the unit is about."""
        for column, values in positions:
            if read_position(column.name, values, column.unit, column.how).trust == ASK:
                self.largest = max(self.largest, span(values))

    def position(self, column: Column, values: Array, slide: bool) -> Read:
        """A position, in the unit of the answer where its own is open."""
        read = read_position(column.name, values, column.unit, column.how, slide)
        if self.unit is None:
            return read
        if without_doubt(column.unit) or read.trust == SURE:
            return self._kept(column.name, read, without_doubt(column.unit) or read.unit)
        self.filled.add(column.name)
        if read.trust == LIKELY and read.unit != self.unit and APART * span(values) < self.largest:
            low, high = np.nanmin(values), np.nanmax(values)
            ask = (
                f"is {quoted(column.name)} in {read.unit}? As unit={self.unit} it goes from {low:.3g} to {high:.3g}, "
                f"where another joint moves by {self.largest:.3g}"
            )
            return replace(read, trust=ASK, ask=ask)
        return read_position(column.name, values, self.unit, "unit=", slide)

    def alike(self, column: Column, base: Read, goes: Relation) -> Read:
        """A goal or a second position, in the unit of the answer where its own is open."""
        own = without_doubt(column.unit)
        read = read_alike(column.name, own, column.how, base, goes)
        if self.unit is None:
            return read
        if own:
            return self._kept(column.name, read, own)
        self.filled.add(column.name)
        known = measures(self.unit, *POSITION)
        if known is None or base.trust == ASK:
            return read
        told = goes.fit > 0.3 and goes.scale > 0.0
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
            LogError: each column says another unit itself.
        """
        if self.unit is not None and self.against and not self.filled:
            says = ", ".join(f"{quoted(name)} says {unit}" for name, unit in list(self.against.items())[:3])
            raise LogError(
                f"{source}: unit={self.unit} is for positions and goals whose unit is open, and none is: {says}; "
                "leave unit= out, or correct the line of a column in the mapping."
            )
