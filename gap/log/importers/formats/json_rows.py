"""JSON as tables: a list of rows, a mapping of columns, or one row a line; nested rows become dotted names."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa

from ...types import LogError
from ..recording import Recording, plain_facts
from .bam import is_bam, read_bam
from .cells import numeric_columns
from .tables import ENDINGS, recording_of

LINES = (".jsonl", ".ndjson")
LEAST, RECORDED = 2, 10
"""Samples of a recording at least, and of one that stands among other files of a folder."""


def read_json(path: Path) -> list[Recording]:
    """The one recording of a JSON file: of BAM, or a table.

    Raises:
        LogError: it is no JSON, or holds neither.
    """
    content = _content(path)
    if is_bam(content):
        return read_bam(path)
    table = table_of(content)
    if table is None:
        raise LogError(
            f"{path}: is no recording: a list of rows, a mapping of columns to lists of one length, one row a line, or "
            "the list 'entries' of BAM is expected."
        )
    names = _columns(content) if isinstance(content, Mapping) else {}
    other = sorted(names.keys() - {*table.column_names})
    notes = [f"left out, for they do not have {len(table)} samples: {', '.join(other)}"] if other else []
    recording = recording_of(table, path, notes)
    own = plain_facts(content) if isinstance(content, Mapping) else {}
    return [replace(recording, facts={**recording.facts, **own})]


def is_recording(path: Path) -> bool:
    """Whether a JSON file of a folder is a recording, and not a description."""
    try:
        content = _content(path)
    except LogError:
        return False
    if is_bam(content):
        return True
    beside = any(path.with_suffix(ending).is_file() for ending in ENDINGS)  # which it describes
    table = None if beside else table_of(content)
    return table is not None and len(table) >= RECORDED and bool(numeric_columns(table).columns)


def _content(path: Path) -> Any:
    """A JSON file, or the list of its lines where each is JSON of its own."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: cannot be read as text: {str(error).splitlines()[0]}; export it again.") from None
    if path.suffix.lower() not in LINES:
        try:
            return json.loads(text)
        except ValueError as error:
            first = error
        if not text.lstrip().startswith("{"):
            raise LogError(f"{path}: is not JSON: {first}.") from None
    rows, lines = [], [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip()]
    for k, line in lines:
        try:
            rows.append(json.loads(line))
        except ValueError as error:
            if line is lines[-1][1] and len(rows) >= LEAST:  # cut off
                break
            raise LogError(f"{path}: line {k} is not JSON: {error}; correct or remove it.") from None
    return rows


def table_of(content: Any) -> pa.Table | None:
    """The table that JSON holds; None where it holds none."""
    if isinstance(content, Mapping):
        columns = _columns(content)
        lengths = [len(cells) for cells in columns.values()]
        length = max(set(lengths), key=lambda n: (lengths.count(n), n), default=0)
        kept = {name: cells for name, cells in columns.items() if len(cells) == length}
        return _table(kept) if length >= LEAST else None
    rows = content if isinstance(content, list) else []
    if len(rows) < LEAST or not all(isinstance(row, Mapping) for row in rows):
        return None
    flat = [_flat(row) for row in rows]
    names = dict.fromkeys(name for row in flat for name in row)
    return _table({name: [row.get(name) for row in flat] for name in names})


def _columns(content: Mapping[str, Any], above: str = "") -> dict[str, list[Any]]:
    """Lists of a mapping by their dotted names; single numbers and words are no columns."""
    out: dict[str, list[Any]] = {}
    for name, value in content.items():
        if isinstance(value, Mapping):
            out |= _columns(value, f"{above}{name}.")
        elif isinstance(value, list):
            out[f"{above}{name}"] = value
    return out


def _flat(row: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Entries of a row by their dotted names; arrays stay lists."""
    out: dict[str, Any] = {}
    for name, value in row.items():
        out |= _flat(value, f"{above}{name}.") if isinstance(value, Mapping) else {f"{above}{name}": value}
    return out


def _table(columns: Mapping[str, list[Any]]) -> pa.Table:
    return pa.table({name: _array(cells) for name, cells in columns.items()})


def _array(cells: list[Any]) -> pa.Array:
    """Cells as Arrow takes them; of several kinds, as text."""
    try:
        return pa.array(cells)
    except (pa.ArrowInvalid, pa.ArrowTypeError, OverflowError):
        return pa.array([None if cell is None else str(cell) for cell in cells])
