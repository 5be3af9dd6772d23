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
from ..recording import FEWEST_RECORDED, NoRecording, Recording, facts_beside
from .cells import Cells, numeric_columns
from .text import read_text

ENDINGS = (".csv", ".tsv", ".txt", ".dat", ".parquet")
MOST_JOINTS = 64
"""Joints of a table at most."""
SAME_SAMPLE_SHARE = 0.1
"""Share of the sample period within which joints were read at one time."""
WHOLE_SHARE = 0.9
"""Share of the samples that have all joints, of a table with a row for each joint."""
JOINT, SAMPLE = " joint", " sample"
"""Columns of such a table that no file has."""


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
    return Recording(path.stem, cells.columns, path, "table", own | (facts or {}), notes=tuple(notes), left=cells.left,
                     parts=parts)  # fmt: skip


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
    words = {name: frame[name].map(lambda word: word if isinstance(word, str) else "")
             for name in cells.left if name in frame}  # fmt: skip
    words |= {name: pd.Series(values) for name, values in cells.columns.items() if _says_joint(name)}
    for name, column in words.items():
        spelt: Any = column.map(_label)
        counts = spelt[spelt != ""].value_counts(sort=False)
        if not 2 <= len(counts) <= MOST_JOINTS or counts.min() < FEWEST_RECORDED:
            continue
        labels, joints = spelt.to_numpy(str), [*counts.index]
        clocks = [clock for clock in cells.columns if clock != name and _runs(cells.columns[clock], labels, joints)]
        clock = next(iter(sorted(clocks, key=lambda clock: said(clock).signal != "time")), "")
        blocks = bool(clock) and bool((np.diff(cells.columns[clock]) < 0.0).any())  # one below the other
        if not clock or (blocks and not _says_joint(name)):
            continue
        known = labels[labels != ""]
        in_turn = bool((known[1:] != known[:-1]).mean() > WHOLE_SHARE)  # polled, and no state that holds
        certain = _says_joint(name) and not (said(name).signal or said(name).aside)
        try:
            wide, stamps = _wide(cells, name, clock, labels, joints)
        except LogError as fault:
            if certain and (name in cells.left or in_turn or not isinstance(fault, _Apart)):
                raise LogError(f"{path}: {fault}") from None
            continue
        carried = dict.fromkeys(str(column) for column, _ in wide.columns)
        parts = {f"{joint}.{column}": (joint, column) for column in carried for joint in joints}
        cells.columns = {clock: stamps.to_numpy()}
        cells.columns |= {key: wide[column, joint].to_numpy(np.float64) for key, (joint, column) in parts.items()}
        cells.left.pop(name, None)
        return parts
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


class _Apart(LogError):
    """Joints were read at different times."""


def _wide(cells: Cells, name: str, clock: str, labels: np.ndarray, joints: list[str]) -> tuple[Any, Any]:
    """One row a sample, with columns by column and joint, and the stamps of the samples.

    Args:
        cells: columns of a table with a row for each joint.
        name: of the column that names the joint.
        clock: its clock.
        labels: joint of each row, empty where it names none.
        joints: all of them.

    Raises:
        LogError: the joints were read at different times, or one has two rows at one time.
    """
    counts = {column for column, values in cells.columns.items() if (np.diff(values) == 1.0).all()}  # of the rows
    carried = [column for column in cells.columns if column not in {name, clock, *counts}]
    table: Any = pd.DataFrame({column: cells.columns[column] for column in (clock, *carried)})
    table = table.assign(**{JOINT: labels})[labels != ""].sort_values(clock, kind="stable")
    period = float(table.groupby(JOINT)[clock].agg(lambda own: own.diff().median()).min())
    table[SAMPLE] = (table[clock].diff() > SAME_SAMPLE_SHARE * period).cumsum()
    once = table.drop_duplicates([SAMPLE, JOINT, *carried])
    again = once[once.duplicated([SAMPLE, JOINT])]
    samples = once.drop_duplicates([SAMPLE, JOINT]).groupby(SAMPLE)
    if (samples.size() == len(joints)).mean() < WHOLE_SHARE:
        raise _Apart(
            f"'{name}' names the joint of each row, and its joints were read at different times in {clock}; a log has "
            "one time for all joints, so interpolate them to common times, or import a file for each joint."
        )
    if len(again):
        raise LogError(
            f"'{name}' names the joint of each row, and {again[JOINT].iloc[0]} has two rows that differ at {clock} = "
            f"{again[clock].iloc[0]:.15g}; leave one row of each such pair out, or import a file for each joint."
        )
    notes = [f"'{name}' names the joint of each row: {', '.join(joints)}; each has columns of its own here"]
    if more := len(table) - len(once):
        notes.append(f"{more} of {len(table)} rows say once more what one of their joint and time says: left out")
    if (apart := float((samples[clock].max() - samples[clock].min()).max())) > 0.0:
        notes.append(f"rows of one sample are up to {apart:.3g} apart in {clock} and stand at their mean")
    cells.notes = [*cells.notes, *notes]
    return once.pivot(index=SAMPLE, columns=JOINT, values=carried), samples[clock].mean()
