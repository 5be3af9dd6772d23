"""Tables of any origin, CSV, Parquet or JSON: cells as numbers, and a row for each joint as columns for each."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import parquet

from ...types import LogError
from ..clocks import clock_units, overlap
from ..names import is_a, said
from ..recording import NoRecording, Recording, facts_beside
from .cells import Cells, numeric_columns
from .text import read_text

ENDINGS = (".csv", ".tsv", ".txt", ".dat", ".parquet")
MOST_JOINTS, FEWEST_ROWS = 64, 10
"""Joints of a table at most, and rows of each at least."""
TOGETHER = 0.1
"""Share of the sample period within which joints were read at one time."""
WHOLE = 0.9
"""Share of the samples that have all joints, of a table with a row for each joint."""
REPEATED = 0.05
"""Share of the rows up to which rows that say the same once more are left out."""


def read_table(path: Path) -> list[Recording]:
    """The one recording of a file.

    Raises:
        LogError: it cannot be read, has no header, or no column of numbers, or has joints of different times.
    """
    frame, notes = (read_parquet(path), []) if path.suffix.lower() == ".parquet" else read_text(path)
    return [recording_of(frame, path, notes)]


def read_parquet(path: Path, columns: list[str] | None = None) -> pd.DataFrame:
    """A Parquet file; whole numbers with empty cells stay whole.

    Raises:
        LogError: it is none.
    """
    try:
        return parquet.read_table(path, columns=columns).to_pandas(integer_object_nulls=True)
    except (pa.ArrowInvalid, OSError):
        raise LogError(f"{path}: is not a Parquet file, or a damaged one; copy or convert it again.") from None


def recording_of(
    frame: pd.DataFrame, path: Path, notes: list[str], facts: dict[str, float | str] | None = None
) -> Recording:
    """The recording that a table is.

    Raises:
        LogError: it has no column of numbers, or has joints of different times.
    """
    cells = numeric_columns(frame)
    if not cells.columns:
        why = next((f" ('{name}': {why})" for name, why in cells.left.items()), "")
        raise NoRecording(
            f"{path}: has no column of numbers{why}; export it as CSV with one header line, or as Parquet."
        )
    parts = _by_joints(frame, cells, path)
    own, of_facts = facts_beside(path)
    notes = [*notes, *cells.notes, *of_facts]
    return Recording(
        path.stem,
        columns=cells.columns,
        source=path,
        kind="table",
        facts=own | (facts or {}),
        roles={},
        notes=tuple(notes),
        units={},
        left=cells.left,
        parts=parts,
    )


# --- a row for each joint --------------------------------------------------------------------------------------------


def _by_joints(frame: pd.DataFrame, cells: Cells, path: Path) -> dict[str, tuple[str, str]]:
    """Give each joint its columns, where one column names the joint of a row.

    Args:
        frame: the table.
        cells: its columns, which are changed.
        path: for the message.

    Returns:
        Joint and name there by column; empty where no column names a joint.

    Raises:
        LogError: the joints were read at different times, and a log has one time for all; or a joint has two rows at
            one time.
    """
    words = {
        name: frame[name].map(lambda word: word if isinstance(word, str) else "")
        for name in cells.left
        if name in frame
    }
    words |= {name: pd.Series(values) for name, values in cells.columns.items() if _says_joint(name)}
    for name, column in words.items():
        spelt: Any = column.map(_label)
        labels, joints = spelt.to_numpy(str), [label for label in spelt.unique() if label]
        if not 2 <= len(joints) <= MOST_JOINTS or min((labels == joint).sum() for joint in joints) < FEWEST_ROWS:
            continue
        names_joint = _says_joint(name) and not (said(name).signal or said(name).aside)
        clocks = [clock for clock in cells.columns if clock != name and _runs(cells.columns[clock], labels, joints)]
        for clock in sorted(clocks, key=lambda clock: said(clock).signal != "time")[:1]:
            time = cells.columns[clock]
            blocks = bool((np.diff(time) < 0.0).any())  # one below the other: joints, or else runs
            if (_says_joint(name) or not blocks) and (
                parts := _pivot(cells, name, clock, labels, joints, names_joint, path)
            ):
                return parts
            known = labels[labels != ""]
            in_turn = bool((known[1:] != known[:-1]).mean() > WHOLE)  # polled, and no state that holds
            if names_joint and (name in cells.left or in_turn):
                _refuse(time, clock, name, labels, joints, path)
    return {}


def _says_joint(name: str) -> bool:
    return is_a("joint", *re.findall("[a-z]+", name.lower()))


def _label(word: object) -> str:
    """A joint's name as one that a column may have; empty where a row names none."""
    if isinstance(word, float):
        return f"joint{int(word)}" if word.is_integer() else ""
    return re.sub(r"\W+", "_", str(word).strip().strip("'\"")).strip("_")


def _runs(values: np.ndarray, labels: np.ndarray, joints: list[str]) -> bool:
    """Whether a column is a clock to each joint, over spans that lie at one another's side."""
    parts = [values[labels == joint] for joint in joints]
    return all(np.isfinite(part).all() and clock_units(part) for part in parts) and overlap(parts)


def _pivot(
    cells: Cells, name: str, clock: str, labels: np.ndarray, joints: list[str], names_joint: bool, path: Path
) -> dict[str, tuple[str, str]]:
    """Give the table one row a sample; nothing is changed where joints do not share their samples."""
    counts = {column for column, values in cells.columns.items() if (np.diff(values) == 1.0).all()}  # of the rows
    carried = [column for column in cells.columns if column not in {name, clock, *counts}]
    table: Any = pd.DataFrame({column: cells.columns[column] for column in (clock, *carried)}).assign(**{"": labels})
    table = table[table[""] != ""].sort_values(clock, kind="stable")
    time = table[clock].to_numpy()
    period = min(float(np.median(np.diff(own))) for _, own in table.groupby("")[clock])
    sample, first = np.zeros(len(time), int), 0
    for k in range(1, len(time)):  # rows that are near the first one of a sample are of it
        later = time[k] - time[first] > TOGETHER * period
        first, sample[k] = (k if later else first), sample[k - 1] + later
    table[" "] = sample
    again = table.duplicated([" ", ""])
    if (table[~again].groupby(" ").size() == len(joints)).mean() < WHOLE:
        return {}
    notes = list(cells.notes)
    if again.any():
        differ = again & ~table.duplicated([" ", "", *carried])
        if (differ.any() or again.mean() > REPEATED) and not names_joint:
            return {}
        if differ.any() or again.mean() > REPEATED:
            row = table[differ if differ.any() else again].iloc[0]
            of_pair = table[(table[" "] == row[" "]) & (table[""] == row[""])]
            column = next((one for one in carried if of_pair[one].nunique(dropna=False) > 1), "")
            what = f"which differ in {column}" if differ.any() else f"as {again.mean():.0%} of all rows are repeats"
            raise LogError(
                f"{path}: '{name}' names the joint of each row, and {row['']} has two rows at {clock} = "
                f"{row[clock]:.15g}, {what}; leave one row of each such pair out, or import a file for each joint."
            )
        notes.append(
            f"{int(again.sum())} of {len(table)} rows say once more what one of their joint and time says: left out"
        )
        table = table[~again]
    stamps = table.groupby(" ")[clock]
    apart = float((stamps.max() - stamps.min()).max())
    wide: Any = table.pivot(index=" ", columns="", values=carried)
    parts = {f"{joint}.{column}": (joint, column) for column in carried for joint in joints}
    cells.columns = {clock: (stamps.mean() if apart > 0.0 else stamps.first()).to_numpy()}
    cells.columns |= {key: wide[column][joint].to_numpy(np.float64) for key, (joint, column) in parts.items()}
    notes.append(f"'{name}' names the joint of each row: {', '.join(joints)}; each has columns of its own here")
    if apart > 0.0:
        notes.append(f"rows of one sample are up to {apart:.3g} apart in {clock} and stand at their mean")
    cells.notes, cells.left = notes, {other: why for other, why in cells.left.items() if other != name}
    return parts


def _refuse(time: np.ndarray, clock: str, name: str, labels: np.ndarray, joints: list[str], path: Path) -> None:
    """Say how far apart the joints are, of which there is a row each."""
    first, away = time[labels == joints[0]], {}
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
