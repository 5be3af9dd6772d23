"""CSV, Parquet and other tables of any origin: separators, comment lines and decimal commas as they come."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

from ...types import LogError
from ..recording import NoRecording, Recording, facts_beside
from .cells import numeric_columns
from .long_form import LongForm, pivoted
from .text import read_text

ENDINGS = (".csv", ".tsv", ".txt", ".dat", ".parquet")


def read_table(path: Path) -> list[Recording]:
    """The one recording of a file.

    Raises:
        LogError: it cannot be read, has no header, or no column of numbers, or has joints of different times.
    """
    table, notes = (_parquet(path), []) if path.suffix.lower() == ".parquet" else read_text(path)
    return [recording_of(table, path, notes)]


def recording_of(table: pa.Table, path: Path, notes: list[str]) -> Recording:
    """The recording that a table is.

    Raises:
        LogError: it has no column of numbers, or has joints of different times.
    """
    cells = numeric_columns(table)
    if not cells.columns:
        why = _first_reason(cells.left)
        raise NoRecording(
            f"{path}: has no column of numbers{why}; export it as CSV with one header line, or as Parquet."
        )
    long = pivoted(table, cells, path) or LongForm(cells)
    cells = long.cells
    facts, of_facts = facts_beside(path)
    notes = [*notes, *cells.notes, *of_facts]
    return Recording(path.stem, cells.columns, path, "table", facts, long.roles, tuple(notes), long.units, cells.left)


def _first_reason(left: dict[str, str]) -> str:
    return next((f" ('{name}': {why})" for name, why in left.items()), "")


def _parquet(path: Path) -> pa.Table:
    try:
        return parquet.read_table(path)
    except (pa.ArrowInvalid, OSError):
        raise LogError(f"{path}: is not a Parquet file, or a damaged one; copy or convert it again.") from None
