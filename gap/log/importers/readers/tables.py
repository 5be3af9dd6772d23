"""Tables of any origin, CSV, Parquet or JSON, and their cells as numbers by pandas: counts, stamps, times, lists."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import ArrowInvalid, parquet

from .....common.documents import read_json
from ...types import Array, LogError
from ..names import is_a, said
from ..recording import FEWEST_RECORDED, LARGEST_EXACT, STRAY_SHARE, NoRecording, Recording, facts_beside
from .text import LIST, LONGEST_CELL, MISSING, NUMBER, read_text

ENDINGS = (".csv", ".tsv", ".txt", ".dat", ".parquet")
MOST_JOINTS = 64
"""Joints of a table at most."""
WHOLE_SHARE = 0.9
"""Share of the rows that are of another joint than the one before, where joints take turns."""
CELLS_LOOKED_AT = 1000
"""Cells of a column of text that tell how it is written."""


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
    _check_rows(frame, cells, path)
    own, notes = facts_beside(path), [*notes, *cells.notes]
    return Recording(path.stem, cells.columns, path, "table", own | (facts or {}), notes=tuple(notes), left=cells.left)


def _check_rows(frame: pd.DataFrame, cells: Cells, path: Path) -> None:
    """Refuse a table with a row for each joint: a column names it, in words or in numbers that take turns.

    Raises:
        LogError: there is such a column.
    """
    for name in frame.columns:
        if not is_a("joint", *re.findall("[a-z]+", name.lower())) or said(name).signal or said(name).aside:
            continue
        labels: Any = pd.Series(cells.columns[name]) if name in cells.columns else frame[name].dropna()
        counts, turns = labels.value_counts(), (labels != labels.shift()).mean()
        several = 2 <= len(counts) <= MOST_JOINTS and counts.min() >= FEWEST_RECORDED
        if several and (name in cells.left or turns > WHOLE_SHARE):
            raise LogError(
                f"{path}: '{name}' names the joint of each row, and a log has columns for each joint; turn the table, "
                f"in pandas by pivot_table(index=<the time>, columns='{name}')."
            )


# --- cells -----------------------------------------------------------------------------------------------------------


@dataclass
class Cells:
    """What a table holds: columns of numbers, why each other one is none, and what was read otherwise than it
    stands."""

    columns: dict[str, Array] = field(default_factory=dict)
    left: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def numeric_columns(frame: pd.DataFrame) -> Cells:
    """Columns that hold numbers, and why the others do not.

    Lists of a fixed length become one column for each place, ``state[0]``; stamps and times of day become seconds,
    ``stamp_s``; counts that float64 cannot hold are counted from the first one.
    """
    out = Cells()
    for name in map(str, frame.columns):
        _take(name, frame[name], out)
    return out


def _take(name: str, cells: Any, out: Cells) -> None:
    """Put a column where it belongs."""
    kind, known = cells.dtype.kind, cells.dropna()
    first = known.iloc[0] if len(known) else None
    if first is None:
        out.left[name] = "it is empty"
    elif kind in "Mm":
        since = cells - first if kind == "M" else cells
        out.columns[f"{name}_s"] = since.dt.total_seconds().to_numpy(np.float64)
    elif kind in "iufb" or isinstance(first, bool | int | float | np.number):
        out.columns[name] = _numbers(cells)
    elif isinstance(first, str):
        _take_text(name, cells.fillna("").astype(str).str.strip().str.strip("'\""), out)
    elif isinstance(first, list | tuple | np.ndarray):
        _take_lists(name, cells.tolist(), out)
    elif hasattr(first, "hour"):  # a time of day
        _take_text(name, cells.astype(str), out)
    else:
        out.left[name] = f"it holds {type(first).__name__} values, no numbers"


def _numbers(cells: Any) -> Array:
    """Numbers as float64; whole ones beyond its digits are counted from the first that is known."""
    known = cells.dropna()
    if cells.dtype.kind in "iuO" and any(
        isinstance(cell, int | np.integer) and abs(int(cell)) > LARGEST_EXACT for cell in known
    ):
        first = int(known.iloc[0])
        return np.array([np.nan if pd.isna(cell) else float(int(cell) - first) for cell in cells])
    return np.array([np.nan if cell is None else cell for cell in cells.tolist()], np.float64)


def _take_lists(name: str, rows: list[Any], out: Cells) -> None:
    """The places of lists that are all equally long and hold numbers; none else."""
    try:
        matrix = np.array([np.asarray(row) for row in rows])
    except ValueError:
        matrix = np.zeros((0, 0), object)
    if matrix.ndim != 2 or matrix.dtype.kind not in "iufb":
        out.left[name] = "lists of different lengths, or not of numbers"
        return
    for place, column in enumerate(matrix.T):
        out.columns[f"{name}[{place}]"] = _numbers(pd.Series(column))


# --- text ------------------------------------------------------------------------------------------------------------


def _take_text(name: str, cells: Any, out: Cells) -> None:
    """A column of text: numbers and times that are written in an unusual way, or the reason why it is left out."""
    low = cells.str.lower()
    there, cells = ~low.isin(MISSING), cells.mask(low == "true", "1").mask(low == "false", "0")
    known: Any = cells[there]
    plain: Any = pd.to_numeric(cells, errors="coerce")
    if not len(known) or cells.str.len().max() > LONGEST_CELL:
        out.left[name] = "it holds long words, no numbers" if len(known) else "it is empty"
        return
    if plain[there].notna().all():
        out.columns[name] = _numbers(plain)
        return
    if cells.str.fullmatch(LIST).all():
        _take_lists(name, [[float(part) for part in re.split(r"[,;\s]+", cell[1:-1].strip())] for cell in cells], out)
        return
    values, seconds = _read(known)
    if values is None:
        words = list(dict.fromkeys(known[:CELLS_LOOKED_AT]))
        out.left[name] = f"it holds text, no numbers: {', '.join(repr(word[:20]) for word in words[:3])}"
        return
    if len(odd := known[values.isna()]):
        out.notes.append(f"{len(odd)} cells of {name} are no number, the first {odd.iloc[0][:20]!r}: read as no value")
    whole = values.reindex(cells.index).to_numpy(np.float64)
    out.columns[f"{name}_s" if seconds else name] = whole


def _read(known: Any) -> tuple[Any, bool]:
    """Numbers of nearly all cells of a column, and whether these are seconds; None where they are none."""
    sample = known.iloc[:: max(len(known) // CELLS_LOOKED_AT, 1)]
    dated = int(sample.str.contains(":").mean() >= 1.0 - STRAY_SHARE)
    for reader, seconds in ((_number, False), (_duration, True), *[(_stamp, True)] * dated):
        if reader(sample).notna().mean() >= 1.0 - STRAY_SHARE:
            return reader(known), seconds
    return None, False


def _number(cells: Any) -> Any:
    """Numbers with decimals behind either sign."""
    plain = cells.where(cells.str.fullmatch(NUMBER))
    return pd.to_numeric(plain.str.replace(",", ".", regex=False), errors="coerce")


def _duration(cells: Any) -> Any:
    """Seconds of times of day and of durations: ``12:00:00.01``, ``00.01`` behind minutes, ``1 days 12:00:00``."""
    whole = cells.str.replace(",", ".", regex=False).str.replace(r"^(\d{1,2}:\d{1,2}(?:\.\d+)?)$", r"00:\1", regex=True)
    return pd.to_timedelta(whole.where(whole.str.contains(":")), errors="coerce").dt.total_seconds()


def _stamp(cells: Any) -> Any:
    """Seconds of dates with a time, all written as the first is, since the first of the days."""
    dayfirst = bool(re.match(r"\d{1,2}\.\d{1,2}\.", cells.iloc[0]))  # as written with points
    with warnings.catch_warnings(action="ignore"):  # of words that are no dates
        found = pd.to_datetime(cells.str.replace(",", ".", regex=False), errors="coerce", dayfirst=dayfirst, utc=True)
    return (found - found.dt.normalize().min()).dt.total_seconds()


# --- leRobot data sets, versions 2.x and 3.0: ``meta/info.json`` says which columns of the Parquet files are what ----
#
# Of version 2.x each episode is a file, of 3.0 a file holds several; the column ``episode_index`` parts them in both.

INFO = Path("meta/info.json")
MEASURED = "observation.state"
NAMED = (MEASURED, "action", "observation.velocity", "observation.effort", "observation.current")
"""Features whose places are joints."""
FOLLOWERS = re.compile(r"(bi_)?so(100|101)?(_follower)?\Z")
"""Types of the robots on whose STS3215 LeRobot sets gains of its own at every start."""
GAINS = (
    "LeRobot sets P 16, I 0, D 32 and acceleration 254 on the servos of {}, and the chain sts3215 has the factory's P "
    "32: import with actuator= and a chain of half its gain (docs: Import a log, LeRobot's SO-100 and SO-101)"
)
"""As configure in src/lerobot/robots/so_follower/so_follower.py sets them."""


def is_lerobot(folder: Path) -> bool:
    """Whether a folder is such a data set."""
    return (folder / INFO).is_file()


def read_lerobot(folder: Path) -> list[Recording]:
    """A recording for each episode.

    Raises:
        LogError: the data set is incomplete or of a version that is not read, or says nothing of a robot's joints.
    """
    info = read_json(folder / INFO)
    if not isinstance(info, dict):
        raise LogError(f"{folder / INFO}: is no mapping; download it again.")
    version = str(info.get("codebase_version", ""))
    if not re.match(r"v?[23]\.", version):
        raise LogError(f"{folder / INFO}: the data set is of version {version or 'unknown'}; 2.x and 3.x are read.")
    if not (files := sorted((folder / "data").rglob("*.parquet"))):
        raise LogError(f"{folder}: has no Parquet file under data/; download the data set whole (no video is needed).")
    features = info.get("features") or {}
    numbers = {name for name in features if str(features[name].get("dtype", "")).startswith(("float", "int", "bool"))}
    if MEASURED not in numbers:
        raise LogError(f"{folder}: has no '{MEASURED}', so it says nothing of a robot's joints.")
    named = [name for name in NAMED if name in numbers]
    robot = str(info.get("robot_type") or "")
    notes = [
        "timestamps are the frame's number over the frame rate, not read from a clock",
        *([GAINS.format(robot)] if FOLLOWERS.match(robot) else []),
    ]
    table: Any = pd.concat([_file(path, named) for path in files], ignore_index=True)
    facts: dict[str, float | str] = {"fps": float(info.get("fps") or 0.0), "robot_type": robot}
    return [
        Recording(f"episode_{int(number):06d}", _columns(own, features), folder, "lerobot", facts, notes=tuple(notes))
        for number, own in table.groupby("episode_index")
    ]


def _file(path: Path, named: list[str]) -> pd.DataFrame:
    """The columns of a file that are of joints, with their time and episode."""
    try:
        there = parquet.read_schema(path).names
    except (ArrowInvalid, OSError):
        raise LogError(f"{path}: is not a Parquet file, or a damaged one; download it again.") from None
    for needed in ("timestamp", "episode_index"):
        if needed not in there:
            raise LogError(f"{path}: has no column '{needed}', which every LeRobot data set has.")
    return read_parquet(path, [name for name in (*named, "timestamp", "episode_index") if name in there])


def _columns(table: Any, features: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Columns of an episode, those of features by the names of their places."""
    cells = numeric_columns(table.sort_values("timestamp").drop(columns="episode_index")).columns
    out, measured = {"timestamp": cells.pop("timestamp")}, _names(features[MEASURED])
    for name, values in cells.items():
        feature, _, place = name.partition("[")
        index = int(place[:-1] or 0)
        called = _names(features.get(feature, {}))
        called = called if index < len(called) else measured
        out[f"{feature}.{called[index] if index < len(called) else f'joint{index}'}"] = values
    return out


def _names(feature: Mapping[str, Any]) -> list[str]:
    """Names of a feature's places: as it says them, or none but their count."""
    count, said = int(np.prod(feature.get("shape") or [0])), _said(feature.get("names"))
    return said if len(said) == len(set(said)) == count else [f"joint{k}" for k in range(count)]


def _said(names: Any) -> list[str]:
    """Names that stand in a list, in lists within it, within a mapping, or as a mapping to their places."""
    if isinstance(names, Mapping):
        values = list(names.values())
        if all(isinstance(value, int) for value in values):
            return [str(name) for name in sorted(names, key=lambda name: names[name])]
        return next((_said(value) for value in values), [])
    if isinstance(names, list):
        return [word for one in names for word in (_said(one) if isinstance(one, list | Mapping) else [str(one)])]
    return []
