"""CSV and Parquet of any origin: separators, comment lines and decimal commas as they come."""

from __future__ import annotations

import csv
import itertools
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import csv as arrow_csv
from pyarrow import parquet

from ...types import Array, LogError
from ..recording import Recording, facts_beside

ENDINGS = (".csv", ".tsv", ".txt", ".dat", ".parquet")
SEPARATORS = (",", ";", "\t", " ")
MOST_COMMENTS = 200
_BYTES = 1 << 16


def read_table(path: Path) -> list[Recording]:
    """The one recording of a file.

    Raises:
        LogError: it cannot be read, has no header, or no column of numbers.
    """
    table = _parquet(path) if path.suffix == ".parquet" else _text(path)
    columns = numeric_columns(table)
    if not columns:
        raise LogError(f"{path}: has no column of numbers; export it as CSV with one header line, or as Parquet.")
    return [Recording(path.stem, columns, path, "table", facts_beside(path))]


def _parquet(path: Path) -> pa.Table:
    try:
        return parquet.read_table(path)
    except (pa.ArrowInvalid, OSError):
        raise LogError(f"{path}: is not a Parquet file, or a damaged one; copy or convert it again.") from None


def numeric_columns(table: pa.Table) -> dict[str, Array]:
    """Columns that hold numbers, lists of a fixed length as one column for each place: ``state[0]``."""
    columns: dict[str, Array] = {}
    for name, chunks in zip(table.column_names, table.columns, strict=True):
        kind = chunks.type
        if pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind):
            for place, values in enumerate(_places(chunks)):
                columns[f"{name}[{place}]"] = values
        elif pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
            per_second = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[kind.unit]
            counts = chunks.cast(pa.int64()).to_numpy().astype(np.int64)
            columns[f"{name}_s"] = (counts - (counts[0] if len(counts) else 0)) / per_second
        elif pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind):
            whole = chunks.combine_chunks().cast(pa.float64())
            columns[str(name)] = np.asarray(whole.to_numpy(zero_copy_only=False), np.float64)
    return columns


def _places(chunks: pa.ChunkedArray) -> list[Array]:
    """The places of lists that are all equally long and hold numbers; none else."""
    rows = chunks.combine_chunks()
    if rows.null_count or len(rows) == 0:
        return []
    flat, count = rows.flatten(), len(rows)
    inner = flat.type
    if len(flat) % count or not (pa.types.is_integer(inner) or pa.types.is_floating(inner)):
        return []
    values = np.asarray(flat.cast(pa.float64()).to_numpy(zero_copy_only=False), np.float64)
    if not pa.types.is_fixed_size_list(rows.type) and (np.diff(rows.offsets.to_numpy()) != len(flat) // count).any():
        return []
    return list(values.reshape(count, -1).T.copy())


def _text(path: Path) -> pa.Table:
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            head = list(itertools.islice(file, MOST_COMMENTS + 20))
    except UnicodeDecodeError:
        raise LogError(f"{path}: is not a text file; export the log as CSV or Parquet.") from None
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}.") from None
    if any("\0" in line for line in head):
        raise LogError(f"{path}: is not a text file; export the log as CSV or Parquet.")
    first = next((k for k, line in enumerate(head) if line.strip() and not line.lstrip().startswith(("#", "%"))), None)
    if first is None:
        raise LogError(f"{path}: is empty; record the log again or leave the file out.")
    separator = _separator(head[first:])
    header = next(csv.reader([head[first]], delimiter=separator, skipinitialspace=True))
    skipped = first + 1
    if all(_is_number(cell) for cell in header if cell.strip()):  # the names may stand in the comment above
        above = head[first - 1].lstrip("#% \t") if first else ""
        named = next(csv.reader([above], delimiter=separator, skipinitialspace=True), [])
        header = named if len(named) == len(header) else [f"column{k + 1}" for k in range(len(header))]
        skipped = first
    names = _unique([name.strip().strip('"') for name in header])
    comma = separator != "," and any("," in line for line in head[skipped : skipped + 5])
    try:
        return arrow_csv.read_csv(
            path,
            read_options=arrow_csv.ReadOptions(column_names=names, skip_rows=skipped),
            parse_options=arrow_csv.ParseOptions(delimiter=separator, ignore_empty_lines=True),
            convert_options=arrow_csv.ConvertOptions(
                decimal_point="," if comma else ".",
                true_values=["True", "true", "TRUE"],
                false_values=["False", "false", "FALSE"],
                strings_can_be_null=True,
            ),
        )
    except pa.ArrowInvalid as error:
        raise LogError(f"{path}: cannot be read as CSV: {str(error).splitlines()[0]}") from None


def _separator(lines: list[str]) -> str:
    """The sign that parts all the first lines into the same number of cells, more than one."""
    best, most = ",", 1
    for separator in SEPARATORS:
        counts = {len(row) for row in csv.reader(lines[:10], delimiter=separator, skipinitialspace=True) if row}
        if len(counts) == 1 and (count := counts.pop()) > most:
            best, most = separator, count
    return best


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _unique(names: list[str]) -> list[str]:
    seen: dict[str, int] = {}
    out = []
    for place, name in enumerate(names):
        name = name or f"column{place + 1}"
        seen[name] = seen.get(name, 0) + 1
        out.append(name if seen[name] == 1 else f"{name}_{seen[name]}")
    return out
