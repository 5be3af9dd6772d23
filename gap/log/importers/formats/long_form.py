"""Tables in long form, with a row for each joint and time: pivoted, so that each joint has its columns."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ...types import SIGNAL_UNITS, Array, LogError
from ..evidence import clock_units
from ..in_table import said_together
from ..names import SHORT, said
from .cells import Cells

MOST, LEAST = 64, 10
"""Joints of a table at most, and rows of each at least."""
TOGETHER = 0.1
"""Share of the sample period within which joints were read at one time."""
WHOLE = 0.9
"""Share of the samples that have all joints, of a table in long form."""
REPEATED = 0.05
"""Share of the rows up to which rows that say the same once more are left out."""
JOINT = frozenset(["joint", "joints", "motor", "servo", "name", "id", "axis", "actuator", "device", "gelenk"])
"""Words for a column that names a joint."""


@dataclass(frozen=True)
class LongForm:
    """A table as it is after the pivot.

    Attributes:
        cells: with the columns ``<joint>.<column>``.
        roles: of those whose name says a signal: ``<joint>.<signal>``.
        units: that their names say.
    """

    cells: Cells
    roles: dict[str, str] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)


def pivoted(table: pa.Table, cells: Cells, path: Path) -> LongForm | None:
    """The columns of each joint, where one column names the joint of a row; None where none does.

    Raises:
        LogError: the joints were read at different times, and a log has one time for all; or a joint has two rows at
            one time.
    """
    words: dict[str, list[Any]] = {
        name: table[name].to_pylist()
        for name in cells.left
        if name in table.column_names and _of_words(table.schema.field(name).type)
    }
    words |= {name: values.tolist() for name, values in cells.columns.items() if _says_joint(name)}
    for name, column in words.items():
        spelt = {word: _label(word) for word in set(column) if word == word}
        joints = list(dict.fromkeys(label for word in dict.fromkeys(column) if (label := spelt.get(word))))
        labels = np.array([spelt.get(word, "") for word in column]) if 2 <= len(joints) <= MOST else np.array([])
        if not len(labels) or min(int((labels == joint).sum()) for joint in joints) < LEAST:
            continue
        clocks = [clock for clock in cells.columns if clock != name and _runs(cells.columns[clock], labels, joints)]
        for clock in sorted(clocks, key=lambda clock: said(clock).signal != "time")[:1]:
            blocks = bool((np.diff(cells.columns[clock]) < 0.0).any())  # one below the other: joints, or else runs
            if (_says_joint(name) or not blocks) and (found := _pivot(cells, name, clock, labels, joints, path)):
                return found
            if _names_joint(name) and (name in cells.left or _in_turn(labels)):
                _refuse(cells.columns[clock], clock, name, labels, joints, path)
    return None


def _of_words(kind: pa.DataType) -> bool:
    """Whether a column holds a word a row, and no list of them."""
    kind = kind.value_type if pa.types.is_dictionary(kind) else kind
    return pa.types.is_string(kind) or pa.types.is_large_string(kind)


def _says_joint(name: str) -> bool:
    return bool(JOINT & set(re.findall("[a-z]+", name.lower())))


def _names_joint(name: str) -> bool:
    """Whether a column names a joint, and is no signal of one, as ``servo_temperature`` is."""
    return _says_joint(name) and not said(name).signal


def _in_turn(labels: np.ndarray) -> bool:
    """Whether the joints were polled in turn: nearly each row is of another joint than the one before."""
    known = labels[labels != ""]
    return bool((known[1:] != known[:-1]).mean() > WHOLE)


def _label(word: object) -> str:
    """A joint's name as one that a column may have; empty where a row names none."""
    if isinstance(word, float):
        return f"joint{int(word)}" if word.is_integer() else ""
    return re.sub(r"\W+", "_", word.strip().strip("'\"")).strip("_") if isinstance(word, str) else ""


def _runs(values: Array, labels: np.ndarray, joints: list[str]) -> bool:
    """Whether a column is a clock to each joint, over spans that lie at one another's side."""
    parts = [values[labels == joint] for joint in joints]
    if not all(np.isfinite(part).all() and clock_units(part) for part in parts):
        return False
    begin, end = max(part[0] for part in parts), min(part[-1] for part in parts)
    return bool(end - begin > 0.5 * max(part[-1] - part[0] for part in parts))


def _pivot(cells: Cells, name: str, clock: str, labels: np.ndarray, joints: list[str], path: Path) -> LongForm | None:
    """The table with one row a sample; None where joints do not share their samples."""
    rows = np.flatnonzero(labels != "")
    rows = rows[np.argsort(cells.columns[clock][rows], kind="stable")]
    time, number = cells.columns[clock][rows], np.array([joints.index(label) for label in labels[rows]])
    period = min(float(np.median(np.diff(time[number == k]))) for k in range(len(joints)))
    sample = np.zeros(len(rows), int)  # rows that are near the first one of a sample are of it
    first = 0
    for k in range(1, len(rows)):
        later = time[k] - time[first] > TOGETHER * period
        first = k if later else first
        sample[k] = sample[k - 1] + later
    _, firsts, same = np.unique(sample * len(joints) + number, return_index=True, return_inverse=True)
    if (np.bincount(sample[firsts]) == len(joints)).mean() < WHOLE:
        return None
    counter = {column for column, values in cells.columns.items() if (np.diff(values) == 1.0).all()}  # of the rows
    carried = {k: values for k, values in cells.columns.items() if k not in {name, clock, *counter}}
    notes = list(cells.notes)
    if again := len(rows) - len(firsts):
        fault = _repeated(carried, rows, rows[firsts][same])
        if fault and not _names_joint(name):
            return None
        if fault:
            what, row = fault
            raise LogError(
                f"{path}: '{name}' names the joint of each row, and {labels[row]} has two rows at {clock} = "
                f"{cells.columns[clock][row]:.15g}, {what}; leave one row of each such pair out, or import a file for "
                "each joint."
            )
        notes.append(f"{again} of {len(rows)} rows say once more what one of their joint and time says: left out")
        kept = np.sort(firsts)
        rows, time, number, sample = rows[kept], time[kept], number[kept], sample[kept]
    count = np.bincount(sample)
    begins = np.concatenate([[0], np.cumsum(count)[:-1]])
    apart = float((time[np.cumsum(count) - 1] - time[begins]).max())
    columns: dict[str, Array] = {clock: np.bincount(sample, time) / count if apart > 0.0 else time[begins]}
    roles: dict[str, str] = {}
    units: dict[str, str] = {}
    spoken_of = said_together(cells.columns)
    for column, values in carried.items():
        spoken = spoken_of[column]
        for k, joint in enumerate(joints):
            own = columns[f"{joint}.{column}"] = np.full(len(count), np.nan)
            own[sample[number == k]] = values[rows[number == k]]
            if spoken.signal in SIGNAL_UNITS and not SHORT.fullmatch(spoken.how.lower()):  # of qd the numbers tell
                roles[f"{joint}.{column}"] = f"{joint}.{spoken.signal}"
                units |= {f"{joint}.{column}": spoken.unit} if spoken.unit else {}
    notes.append(f"'{name}' names the joint of each row: {', '.join(joints)}; each has columns of its own here")
    if apart > 0.0:
        notes.append(f"rows of one sample are up to {apart:.3g} apart in {clock} and stand at their mean")
    left = {other: why for other, why in cells.left.items() if other != name}
    return LongForm(Cells(columns, left, notes), roles, units)


def _repeated(columns: dict[str, Array], rows: np.ndarray, firsts: np.ndarray) -> tuple[str, int] | None:
    """What is wrong with rows of one joint and time, and the first such row; None where they are a few that are equal.

    Args:
        columns: values of all rows.
        rows: that are looked at.
        firsts: for each of them the first row of its joint and time.
    """
    for column, values in columns.items():
        own, other = values[rows], values[firsts]
        differ = (own != other) & ~(np.isnan(own) & np.isnan(other))
        if differ.any():
            return f"which differ in {column}", int(rows[np.argmax(differ)])
    again = rows != firsts
    if again.mean() > REPEATED:
        return f"as {again.mean():.0%} of all rows are repeats", int(rows[np.argmax(again)])
    return None


def _refuse(time: Array, clock: str, name: str, labels: np.ndarray, joints: list[str], path: Path) -> None:
    """Say how far apart the joints are, of which there is a row each."""
    first = time[labels == joints[0]]
    away = {}
    for joint in joints[1:]:
        own = time[labels == joint]
        after = np.clip(np.searchsorted(own, first), 1, len(own) - 1)
        nearest = np.minimum(np.abs(own[after] - first), np.abs(own[after - 1] - first))
        away[joint] = float(np.quantile(nearest, WHOLE))
    other = max(away, key=lambda joint: away[joint])
    raise LogError(
        f"{path}: '{name}' names the joint of each row, and {other} was read up to {away[other]:.3g} away from "
        f"{joints[0]} in {clock}; a log has one time for all joints, so interpolate them to common times, or import a "
        "file for each joint."
    )
