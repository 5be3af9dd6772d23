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
from ..names import SHORT, said
from .cells import Cells

MOST, LEAST = 64, 10
"""Joints of a table at most, and rows of each at least."""
TOGETHER = 0.1
"""Share of the sample period within which joints were read at one time."""
WHOLE = 0.9
"""Share of the samples that have all joints, of a table in long form."""
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
        LogError: the joints were read at different times, and a log has one time for all.
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
            if (_says_joint(name) or not blocks) and (found := _pivot(cells, name, clock, labels, joints)):
                return found
            if name in cells.left and _says_joint(name):
                _refuse(cells.columns[clock], clock, name, labels, joints, path)
    return None


def _of_words(kind: pa.DataType) -> bool:
    """Whether a column holds a word a row, and no list of them."""
    kind = kind.value_type if pa.types.is_dictionary(kind) else kind
    return pa.types.is_string(kind) or pa.types.is_large_string(kind)


def _says_joint(name: str) -> bool:
    return bool(JOINT & set(re.findall("[a-z]+", name.lower())))


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


def _pivot(cells: Cells, name: str, clock: str, labels: np.ndarray, joints: list[str]) -> LongForm | None:
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
    count = np.bincount(sample)
    if len(np.unique(sample * len(joints) + number)) < len(rows) or (count == len(joints)).mean() < WHOLE:
        return None
    begins = np.concatenate([[0], np.cumsum(count)[:-1]])
    apart = float((time[np.cumsum(count) - 1] - time[begins]).max())
    columns: dict[str, Array] = {clock: np.bincount(sample, time) / count if apart > 0.0 else time[begins]}
    roles: dict[str, str] = {}
    units: dict[str, str] = {}
    for column, values in cells.columns.items():
        if column in (name, clock) or (np.diff(values) == 1.0).all():  # which counts the rows
            continue
        spoken = said(column)
        for k, joint in enumerate(joints):
            own = columns[f"{joint}.{column}"] = np.full(len(count), np.nan)
            own[sample[number == k]] = values[rows[number == k]]
            if spoken.signal in SIGNAL_UNITS and not SHORT.fullmatch(spoken.how.lower()):  # of qd the numbers tell
                roles[f"{joint}.{column}"] = f"{joint}.{spoken.signal}"
                units |= {f"{joint}.{column}": spoken.unit} if spoken.unit else {}
    notes = [
        *cells.notes,
        f"'{name}' names the joint of each row: {', '.join(joints)}; each has columns of its own here",
    ]
    if apart > 0.0:
        notes.append(f"rows of one sample are up to {apart:.3g} apart in {clock} and stand at their mean")
    left = {other: why for other, why in cells.left.items() if other != name}
    return LongForm(Cells(columns, left, notes), roles, units)


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
