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
SAME_SAMPLE_SHARE = 0.1
"""Share of the sample period within which joints were read at one time."""
WHOLE_SHARE = 0.9
"""Share of the samples that have all joints, of a table with a row for each joint."""
MOST_REPEATED = 0.05
"""Share of the rows up to which rows that say the same once more are left out."""
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
        if not 2 <= len(counts) <= MOST_JOINTS or counts.min() < FEWEST_ROWS:
            continue
        labels, joints = spelt.to_numpy(str), [*counts.index]
        clocks = [clock for clock in cells.columns if clock != name and _runs(cells.columns[clock], labels, joints)]
        for clock in sorted(clocks, key=lambda clock: said(clock).signal != "time")[:1]:
            blocks = bool((np.diff(cells.columns[clock]) < 0.0).any())  # one below the other: joints, or else runs
            known = labels[labels != ""]
            in_turn = bool((known[1:] != known[:-1]).mean() > WHOLE_SHARE)  # polled, and no state that holds
            certain = _says_joint(name) and not (said(name).signal or said(name).aside)
            rows = _Rows(cells, name, clock, labels, joints)
            if (_says_joint(name) or not blocks) and (
                parts := rows.pivot(certain, name in cells.left or in_turn, path)
            ):
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


class _Rows:
    """A table with a row for each joint: the column that names the joint, the clock, and the joint of each row."""

    def __init__(self, cells: Cells, name: str, clock: str, labels: np.ndarray, joints: list[str]) -> None:
        self.cells, self.name, self.clock, self.joints = cells, name, clock, joints
        counts = {column for column, values in cells.columns.items() if (np.diff(values) == 1.0).all()}  # of the rows
        self.carried = [column for column in cells.columns if column not in {name, clock, *counts}]
        table: Any = pd.DataFrame({column: cells.columns[column] for column in (clock, *self.carried)})
        table = table.assign(**{JOINT: labels})[labels != ""].sort_values(clock, kind="stable")
        self.period = float(table.groupby(JOINT)[clock].agg(lambda own: own.diff().median()).min())
        self.table = table.assign(**{SAMPLE: (table[clock].diff() > SAME_SAMPLE_SHARE * self.period).cumsum()})

    def pivot(self, certain: bool, polled: bool, path: Path) -> dict[str, tuple[str, str]]:
        """Give the table one row a sample; nothing is changed where joints do not share their samples.

        Args:
            certain: whether the column surely names the joint, so that rows that contradict each other are refused.
            polled: whether its rows are of joints that were read in turn, and of no state that holds.
            path: for the message.
        """
        table, cells = self.table, self.cells
        again = table.duplicated([SAMPLE, JOINT])
        if (table[~again].groupby(SAMPLE).size() == len(self.joints)).mean() < WHOLE_SHARE:
            return self._refuse(f"{path}: {self._apart()}", certain and polled)
        differ = again & ~table.duplicated([SAMPLE, JOINT, *self.carried])
        if differ.any() or again.mean() > MOST_REPEATED:
            return self._refuse(f"{path}: {self._twice(differ if differ.any() else again, again.mean())}", certain)
        cells.notes = [*cells.notes]
        if again.any():
            cells.notes.append(
                f"{int(again.sum())} of {len(table)} rows say once more what one of their joint and time says: left out"
            )
        wide: Any = table[~again].pivot(index=SAMPLE, columns=JOINT, values=self.carried)
        stamps = table[~again].groupby(SAMPLE)[self.clock]
        parts = {f"{joint}.{column}": (joint, column) for column in self.carried for joint in self.joints}
        cells.columns = {self.clock: stamps.mean().to_numpy()}
        cells.columns |= {key: wide[column][joint].to_numpy(np.float64) for key, (joint, column) in parts.items()}
        named = ", ".join(self.joints)
        cells.notes.append(f"'{self.name}' names the joint of each row: {named}; each has columns of its own here")
        if (apart := float((stamps.max() - stamps.min()).max())) > 0.0:
            cells.notes.append(
                f"rows of one sample are up to {apart:.3g} apart in {self.clock} and stand at their mean"
            )
        cells.left = {other: why for other, why in cells.left.items() if other != self.name}
        return parts

    def _refuse(self, why: str, certain: bool) -> dict[str, tuple[str, str]]:
        if certain:
            raise LogError(why)
        return {}

    def _twice(self, again: Any, share: float) -> str:
        """What is said of rows of one joint and time."""
        row = self.table[again].iloc[0]
        of_pair = self.table[(self.table[SAMPLE] == row[SAMPLE]) & (self.table[JOINT] == row[JOINT])]
        column = next((one for one in self.carried if of_pair[one].nunique(dropna=False) > 1), "")
        what = f"which differ in {column}" if column else f"as {share:.0%} of all rows are repeats"
        return (
            f"'{self.name}' names the joint of each row, and {row[JOINT]} has two rows at {self.clock} = "
            f"{row[self.clock]:.15g}, {what}; leave one row of each such pair out, or import a file for each joint."
        )

    def _apart(self) -> str:
        """What is said of joints that were read at different times."""
        times = {joint: own.to_numpy() for joint, own in self.table.groupby(JOINT)[self.clock]}
        first, away = pd.DataFrame({"time": times[self.joints[0]]}), {}
        for joint in self.joints[1:]:
            own = pd.DataFrame({"time": times[joint], "own": times[joint]})
            near: Any = pd.merge_asof(first, own, on="time", direction="nearest")
            away[joint] = float((near["own"] - near["time"]).abs().quantile(WHOLE_SHARE))
        other = max(away, key=lambda joint: away[joint])
        return (
            f"'{self.name}' names the joint of each row, and {other} was read up to {away[other]:.3g} away from "
            f"{self.joints[0]} in {self.clock}; a log has one time for all joints, so interpolate them to common "
            "times, or import a file for each joint."
        )
