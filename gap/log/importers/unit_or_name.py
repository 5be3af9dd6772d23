"""A word behind the names of all positions and goals: their unit, or the name of what they are of."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace

from .column import Column, plain
from .names import words_of
from .unit_words import UNIT_OR_NAME

IN_BRACKETS = re.compile(r".*[\[(]\s*([^\W\d_]{2,})\s*[\])]\s*")
ANGLES = ("position", "goal")

Found = tuple[str, str, Column]
"""Joint, signal and column."""


def parted(found: Iterable[Found]) -> list[Found]:
    """Columns of which a word that may be the unit of all positions and goals is no part of the joint's name.

    Such a word stands behind the signal in each of them, in brackets or among :data:`UNIT_OR_NAME`. A joint's name
    would differ from joint to joint, or stand in a column of something else as well.
    """
    found = list(found)
    angles = [column for _, signal, column in found if signal in ANGLES]
    word = _word(angles[0].name) if angles else ""
    both = {signal for _, signal, _ in found} >= {*ANGLES}
    others = (column for _, signal, column in found if signal not in ANGLES)
    if (
        not word
        or not (both or word in UNIT_OR_NAME)
        or any(one.by_format or one.unit or _word(one.name) != word or not _ends(one, word) for one in angles)
        or any(_ends(one, word) for one in others)
    ):
        return found
    return [
        (joint[: -len(word)].rstrip("_"), signal, replace(column, rest=word))
        if signal in ANGLES
        else (joint, signal, column)
        for joint, signal, column in found
    ]


def _word(name: str) -> str:
    """The last word of a name where it may be a unit."""
    if match := IN_BRACKETS.fullmatch(name):
        return plain(match[1].lower())
    last = "".join(words_of(name)[1:][-1:]).lower()
    return last if last in UNIT_OR_NAME else ""


def _ends(column: Column, word: str) -> bool:
    return f"_{column.said.joint.lower()}".endswith(f"_{word}")
