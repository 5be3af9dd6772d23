"""A word or a number in the names of several columns: their unit, or the name of what they are of."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace

from .column import Column, plain
from .names import said, words_of
from .unit_words import UNIT_OR_NAME, measure, unit_of

IN_BRACKETS = re.compile(r".*[\[(]\s*([^\W\d_]{2,})\s*[\])]\s*")
ANGLES = ("position", "goal")
BEFORE = re.compile(r"(?<![A-Za-z0-9.])(?P<number>\d+(?:_\d+)?)(?P<unit>[A-Za-zµμ°]{2,})(?![A-Za-z0-9])")
"""``current_5mA``: a unit with its number, or of joint 5."""
BEHIND = re.compile(r"[ _]?(?:\((?P<inside>\d+)\)|(?P<power>e-?\d+)|/?(?P<number>\d+))\Z", re.IGNORECASE)
"""``pos_deg10``, ``pos_deg_e2``: a factor, or joint 10 and an axis E2."""
TEN = re.compile(r"10+|e-?\d+", re.IGNORECASE)

Found = tuple[str, str, Column]
"""Joint, signal and column."""


def parted(found: Iterable[Found]) -> list[Found]:
    """Columns of which a word that may be the unit of all positions and goals is no part of the joint's name.

    Such a word stands behind the signal in each of them, in brackets or among :data:`UNIT_OR_NAME`. A joint's name
    would differ from joint to joint, or stand in a column of something else as well.
    """
    found = _behind(_before(list(found)))
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


def _before(found: list[Found]) -> list[Found]:
    """Columns with a number before their unit that is of no joint, as no position and no other column has it."""
    placed = {joint for joint, signal, _ in found if signal in ANGLES}
    hits = {column.name: match for joint, _, column in found if joint not in placed and not column.by_format
            if (match := BEFORE.search(column.name)) and unit_of(match["unit"]) == column.unit}  # fmt: skip
    numbers: dict[str, set[str]] = {}
    for _, signal, column in found:
        if column.name in hits:
            numbers.setdefault(signal, set()).add(hits[column.name]["number"])

    def read(one: Found) -> Found:
        _, signal, column = one
        match = hits.get(column.name)
        if match is None or len(numbers[signal]) > 1:
            return one
        whole = f"{match['number']} {column.unit}"
        unit = whole if measure(whole) else match[0]
        return _as(one, f"{column.name[: match.start()]}{column.name[match.end('number') :]}", unit)

    return [read(one) for one in found]


def _behind(found: list[Found]) -> list[Found]:
    """Columns with a power of ten behind their unit that may be a factor: it tells no joints apart."""
    own = [column for _, _, column in found if not column.by_format and measure(column.unit)]
    hits = {column.name: match for column in own if (match := BEHIND.search(column.name))
            and _ends_in_unit(column.name[: match.start()], column.unit)}  # fmt: skip

    def factor(name: str) -> str:
        match = hits.get(name)
        return next((part for part in match.groups() if part), "") if match else ""

    out = []
    for one in found:
        joint, signal, column = one
        text = factor(column.name)
        alike = {factor(other.name) for _, same, other in found if same == signal}
        elsewhere = any(same == joint and other.name not in hits for same, _, other in found)
        if TEN.fullmatch(text) and alike == {text} and not elsewhere:
            one = _as(one, column.name[: hits[column.name].start()], f"{column.unit} {text}")
        out.append(one)
    return out


def _ends_in_unit(name: str, unit: str) -> bool:
    return unit_of("".join(words_of(name)[-1:])) == unit


def _as(one: Found, name: str, unit: str) -> Found:
    """A column as another name says it, in another unit."""
    _, signal, column = one
    spoken = said(name)
    if spoken.signal != signal:
        return one
    return spoken.joint, signal, replace(column, said=replace(spoken, unit=unit), unit=unit)


def _word(name: str) -> str:
    """The last word of a name where it may be a unit."""
    if match := IN_BRACKETS.fullmatch(name):
        return plain(match[1].lower())
    last = "".join(words_of(name)[1:][-1:]).lower()
    return last if last in UNIT_OR_NAME else ""


def _ends(column: Column, word: str) -> bool:
    return f"_{column.said.joint.lower()}".endswith(f"_{word}")
