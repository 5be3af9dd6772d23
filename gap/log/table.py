"""Columns of a measured log file, CSV or Parquet, read column by column in batches of bounded size."""

from __future__ import annotations

import csv
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import compute, parquet
from pyarrow import csv as arrow_csv

from ...common.errors import nearest
from .types import COMMANDS, OTHER, SIGNAL_UNITS, Array, LogError

ENDINGS = (".csv", ".parquet")
ONLY_JOINT = "joint"
"""Joint of columns without one, where the sidecar names none: the bench's."""
_CSV_BLOCK_BYTES = 8 << 20
BATCH_ROWS = 1 << 17


def read_batches(
    path: Path, only_joint: str = ONLY_JOINT, driven: Collection[str] | None = None
) -> Iterator[dict[str, Array]]:
    """Yield the columns of ``path`` as float64 arrays, a bounded number of rows at a time, NaN for an empty cell.

    Args:
        path: of the table.
        only_joint: whose columns those are that name no joint.
        driven: as of :func:`check_columns`.

    Raises:
        LogError: not a readable file, empty, a column that the format does not know, or a cell that is no number.
    """
    if path.suffix not in ENDINGS:
        raise LogError(f"{path}: a measured log ends in {' or '.join(ENDINGS)}, not {path.suffix or 'nothing'!r}")
    try:
        if path.stat().st_size == 0:
            raise LogError(f"{path}: is empty; record the log again or leave the file out")
        read = _csv_batches if path.suffix == ".csv" else _parquet_batches
        yield from read(path, only_joint, driven)
    except OSError as error:
        if error.errno is None:  # Arrow raises OSError for content it cannot decode
            raise LogError(f"{path}: is damaged and cannot be read as {path.suffix[1:]}; copy it again") from None
        raise LogError(f"{path}: cannot be read: {error.strerror}") from None


def _parquet_batches(path: Path, only_joint: str, driven: Collection[str] | None) -> Iterator[dict[str, Array]]:
    try:
        # pages are read as they are needed: a row group may hold the whole of a long log
        with parquet.ParquetFile(path, buffer_size=1 << 20, pre_buffer=False) as file:
            names = with_joint(file.schema_arrow.names, only_joint)
            check_columns(names, path, driven)
            for field in file.schema_arrow:
                numeric = pa.types.is_integer(field.type) or pa.types.is_floating(field.type)
                if not (numeric or pa.types.is_boolean(field.type)):
                    raise LogError(f"{path}: column '{field.name}' holds {field.type} values; it must hold numbers")
            for batch in file.iter_batches(BATCH_ROWS):
                yield {name: _as_float(batch.column(i)) for i, name in enumerate(names)}
    except pa.ArrowInvalid:
        raise LogError(f"{path}: is not a Parquet file, or a damaged one; copy or convert it again") from None


def _csv_batches(path: Path, only_joint: str, driven: Collection[str] | None) -> Iterator[dict[str, Array]]:
    header = _csv_header(path)
    names = with_joint(header, only_joint)
    check_columns(names, path, driven)
    try:
        reader = arrow_csv.open_csv(
            path,
            read_options=arrow_csv.ReadOptions(block_size=_CSV_BLOCK_BYTES),
            convert_options=arrow_csv.ConvertOptions(column_types={name: pa.float64() for name in header}),
        )
        for batch in reader:
            yield {name: _as_float(batch.column(i)) for i, name in enumerate(names)}
    except pa.ArrowInvalid:
        raise LogError(_first_bad_cell(path, names)) from None


def _csv_header(path: Path) -> list[str]:
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            line = file.readline(1 << 20)
    except UnicodeDecodeError:
        raise LogError(f"{path}: is not a CSV text file; export the log as CSV or Parquet") from None
    try:
        names = next(csv.reader([line]), []) if line.strip() and "\0" not in line else []
    except csv.Error as error:
        raise LogError(f"{path}: its header cannot be read ({error}); export the log as CSV or Parquet") from None
    if not names:
        raise LogError(f"{path}: has no header line; its first line must name the columns, starting with time")
    if ";" in line or "\t" in line:  # also beside commas, as where a locale exported some of them
        separator = "semicolons" if ";" in line else "tabs"
        raise LogError(f"{path}: separates columns by {separator}; use commas and decimal points")
    return names


def _first_bad_cell(path: Path, names: list[str]) -> str:
    missing = {"", "nan", "NaN", "NA", "N/A", "null", "NULL"}
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            rows = csv.reader(file)
            next(rows)
            row = 0
            for row, cells in enumerate((cells for cells in rows if cells), start=1):
                if len(cells) != len(names):
                    return f"{path}: row {row} has {len(cells)} values for {len(names)} columns; repair or remove it"
                for name, cell in zip(names, cells, strict=True):
                    try:
                        float(cell)
                    except ValueError:
                        if cell not in missing:
                            return f"{path}: column '{name}', row {row}: {cell[:40]!r} is not a number; correct it"
            if row == 0:
                return f"{path}: has no samples; a run needs at least two"
    except (UnicodeDecodeError, csv.Error):
        pass
    return f"{path}: holds bytes that are not CSV text; export the log as CSV or Parquet"


def _as_float(column: pa.Array) -> Array:
    column = column.cast(pa.float64())
    if column.null_count:
        column = compute.fill_null(column, float("nan"))
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)


def with_joint(names: list[str], only_joint: str) -> list[str]:
    """Column names of a log of one joint, whose columns need not name it: ``position`` is ``<only_joint>.position``."""
    bare = [name for name in names if name in SIGNAL_UNITS]
    named = any("." in name and name.partition(".")[0] not in OTHER for name in names)
    return names if named else [f"{only_joint}.{name}" if name in bare else name for name in names]


def group_of(column: str) -> tuple[str, str]:
    """What a column belongs to, and its name there: a joint and its signal, or ``base`` and ``body.x``."""
    joint, _, signal = column.rpartition(".")
    head, _, rest = column.partition(".")
    return (head, rest) if head in OTHER and signal not in SIGNAL_UNITS else (joint, signal)


def check_columns(names: list[str], path: Path, driven: Collection[str] | None = None) -> None:
    """Refuse columns that the format does not know, columns named twice, and a missing ``time`` or ``position``.

    Args:
        names: of the columns.
        path: of the table.
        driven: joints that need a command, beside one at least; None: all.
    """
    seen: set[str] = set()
    joints = dict.fromkeys(name.rpartition(".")[0] for name in names if name.rpartition(".")[2] in SIGNAL_UNITS)
    joints = [joint for joint in joints if joint and joint not in OTHER]
    known = ["time", *(f"{joint}.{signal}" for joint in joints for signal in SIGNAL_UNITS)]
    for name in names:
        if name in seen:
            raise LogError(f"{path}: column '{name}' is there twice; keep one")
        seen.add(name)
        joint, signal = group_of(name)
        if name in SIGNAL_UNITS:
            raise LogError(
                f"{path}: column '{name}' names no joint, as {joints[0]}.{signal} does; write <joint>.{name}"
            )
        if name != "time" and joint not in OTHER and not (joint and signal in SIGNAL_UNITS):
            hint = nearest(name, known) or nearest(signal, SIGNAL_UNITS)
            raise LogError(
                f"{path}: unknown column '{name}'{hint}; columns are time, base.*, host.*, and <joint>. followed by "
                f"one of {', '.join(SIGNAL_UNITS)}"
            )
    if "time" not in seen:
        raise LogError(f"{path}: the column 'time' [s] is missing{nearest('time', names)}")
    if not joints:
        raise LogError(
            f"{path}: has no joint; add the columns <joint>.goal and <joint>.position [rad], or turn a table with "
            f"other columns into a log: sealegs import {path} out=logs/<name>"
        )
    some = driven is not None and any(f"{joint}.{signal}" in seen for joint in joints for signal in COMMANDS)
    needy = driven if some and driven is not None else joints
    for joint in joints:
        if "/" in joint or "\\" in joint:  # files of a diagnosis are named for the joint
            raise LogError(f"{path}: the joint '{joint}' has a slash in its name; rename its columns")
        if f"{joint}.position" not in seen:
            raise LogError(f"{path}: the column '{joint}.position' [rad] is missing")
        if joint in needy and not any(f"{joint}.{signal}" in seen for signal in COMMANDS):
            raise LogError(
                f"{path}: the column '{joint}.goal' [rad] is missing (a wheel has '{joint}.goal_velocity' [rad/s] "
                f"in its place, a torque-driven log '{joint}.torque_command' or '{joint}.torque')"
            )
