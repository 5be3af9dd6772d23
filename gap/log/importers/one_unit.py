"""Positions whose names differ by their joint alone: they are in one unit, which the one that tells most decides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..types import Array
from .column import Column
from .expression import quoted
from .names import words_of
from .steps import is_percent
from .units import ANGLE, ASK, LIKELY, SURE, Read, is_opening

GRIPPERS = frozenset(["gripper", "grippers", "finger", "fingers", "hand", "claw", "jaw", "jaws"])
"""Words for a joint whose unit, an opening or a share, may be another one than that of an arm."""
CLOSED, OPEN = 0.1, 0.9
"""An opening from 0 to 1 goes below the one and beyond the other; assumed."""

Position = tuple[Column, Array, Read]
"""Column, values (n,), and how it is read on its own."""


def together(positions: Sequence[Position]) -> dict[str, Read]:
    """How positions are read that others of their name tell more about than their own range; by column.

    An encoder's steps tell the unit of all. Else all are in question where one is that goes too far for rad.
    """
    forms: dict[tuple[str, ...], list[Position]] = {}
    for column, values, read in positions:
        if not column.unit and not column.rest and (read.by_range or (read.trust == SURE and read.unit in ANGLE)):
            forms.setdefault(_form(column), []).append((column, values, read))
    out: dict[str, Read] = {}
    for alike in forms.values():
        by_range = [one for one in alike if one[2].by_range and not is_opening(one[1]) and not _is_gripper(one[0])]
        shown = {read.unit: column.name for column, _, read in alike if read.trust == SURE}
        if len(shown) == 1:
            ((unit, name),) = shown.items()
            why = f"in {unit} as {quoted(name)}, whose steps are an encoder's"
            out |= {column.name: Read(quoted(column.name) + ANGLE[unit], unit, LIKELY, f"{why}; {_span(values)}")
                    for column, values, read in by_range if read.trust == LIKELY and read.unit != unit}  # fmt: skip
            continue
        last = alike[-1][0].name  # a gripper, whatever it is called
        leaders = [one for one in by_range if one[2].trust == ASK and not (one[0].name == last and is_percent(one[1]))]
        if shown or not leaders:
            continue
        column, _, first = max(leaders, key=lambda one: float(np.nanmax(np.abs(one[1]))))
        leading = {one[0].name for one in leaders}
        for other, values, read in by_range:
            if read.trust == LIKELY or (read.unit != first.unit and other.name in leading):
                why = f"{_span(values)}; in the unit of {quoted(column.name)}"
                text = quoted(other.name) + ANGLE[first.unit]
                out[other.name] = replace(first, text=text, why=why)
    return out


def fills_opening(column: Column, values: Array) -> bool:
    """Whether a position (n,) is an opening from 0 to 1 by its name, or goes from the one end to the other."""
    whole = float(np.nanmin(values)) < CLOSED and float(np.nanmax(values)) > OPEN
    return is_opening(values) and (whole or _is_gripper(column))


def _form(column: Column) -> tuple[str, ...]:
    """The words of a name without those of its joint."""
    if column.by_format:
        return ()
    words = [word.lower() for word in words_of(column.name) if not word.isdigit()]
    for word in words_of(column.said.joint):
        if word.lower() in words:
            words.remove(word.lower())
    return tuple(words)


def _is_gripper(column: Column) -> bool:
    return bool(GRIPPERS & {word.lower() for word in words_of(column.name)})


def _span(values: Array) -> str:
    return f"{float(np.nanmin(values)):.3g} to {float(np.nanmax(values)):.3g}"
