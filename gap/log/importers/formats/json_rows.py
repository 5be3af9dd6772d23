"""JSON as tables: a list of rows, a mapping of columns, or one row a line; nested rows become dotted names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa

from .....common.documents import RECORDING, DocumentError, parse_json, read_text
from ...types import LogError
from ..names import said
from ..recording import RECORDED, NoRecording, Recording, plain_facts
from ..unit_words import measures, unit_of
from ..units import POSITION
from .bam import OF_UNITS, is_bam, read_bam
from .cells import numeric_columns
from .tables import ENDINGS, recording_of

LINES = (".jsonl", ".ndjson")
LEAST = 2
"""Samples of a recording at least."""
SPARSE, FREE = 10, 1_000_000
"""Times as many cells as have a value that a table of rows may have, beside those that are free."""
ANGLES = ("position", "goal", "link_position")


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
        raise NoRecording(
            f"{path}: is no recording: a list of rows, a mapping of columns to lists of one length, one row a line, or "
            "the list 'entries' of BAM is expected."
        )
    names = _columns(content) if isinstance(content, Mapping) else {}
    other = sorted(names.keys() - {*table.column_names, _rows_in(names)})
    notes = [f"left out, for they do not have {len(table)} samples: {', '.join(other)}"] if other else []
    recording = recording_of(table, path, notes)
    own = plain_facts(content) if isinstance(content, Mapping) else {}
    return [_with_units(replace(recording, facts={**recording.facts, **own}), content)]


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
        text = read_text(path, RECORDING)
    except DocumentError as error:
        raise LogError(f"{path}: {error.problem}; export it again.") from None
    if path.suffix.lower() not in LINES:
        try:
            return parse_json(text)
        except DocumentError as error:
            first = error
        if not text.lstrip().startswith("{"):
            raise LogError(f"{path}: {first.problem}; export it again.") from None
    rows, lines = [], [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip()]
    for k, line in lines:
        try:
            rows.append(parse_json(line))
        except DocumentError as error:
            if line is lines[-1][1] and len(rows) >= LEAST:  # cut off
                break
            raise LogError(f"{path}: line {k} is not JSON: it {error.problem}; correct or remove it.") from None
    return rows


def table_of(content: Any) -> pa.Table | None:
    """The table that JSON holds; None where it holds none."""
    if isinstance(content, Mapping):
        columns = _columns(content)
        if rows := _rows_in(columns):
            return table_of(columns[rows])
        lengths = [len(cells) for cells in columns.values()]
        length = max(set(lengths), key=lambda n: (lengths.count(n), n), default=0)
        kept = {name: cells for name, cells in columns.items() if len(cells) == length}
        return _table(kept) if length >= LEAST else None
    rows = content if isinstance(content, list) else []
    if len(rows) < LEAST or not all(isinstance(row, Mapping) for row in rows):
        return None
    flat = [_flat(row) for row in rows]
    names = dict.fromkeys(name for row in flat for name in row)
    if len(names) * len(flat) > SPARSE * sum(map(len, flat)) + FREE:
        return None
    return _table({name: [row.get(name) for row in flat] for name in names})


def _rows_in(columns: Mapping[str, list[Any]]) -> str:
    """Name of the one list of rows of a mapping where no other list is as long; empty elsewhere."""
    rows = [name for name, cells in columns.items() if cells and all(isinstance(row, Mapping) for row in cells)]
    if len(rows) != 1 or sum(len(cells) >= len(columns[rows[0]]) for cells in columns.values()) > 1:
        return ""
    return rows[0]


def _with_units(recording: Recording, content: Any) -> Recording:
    """The recording with the units that its file says beside the columns; they stand in brackets behind the names.

    They are said by the names of columns, or by one word for the angles.
    """
    entries = [content[key] for key in OF_UNITS if key in content] if isinstance(content, Mapping) else []
    names: dict[str, str] = {}
    units = dict(recording.units)
    for name in recording.columns:
        role = recording.roles.get(name, "").rpartition(".")[2]
        open_unit = not (units.get(name) or said(name).unit)
        for entry in entries:
            word = entry.get(name, entry.get(name.partition("[")[0])) if isinstance(entry, Mapping) else entry
            unit = unit_of(word) if isinstance(word, str) else ""
            angle = measures(unit, *POSITION) and (role or said(name).signal) in ANGLES
            if not (open_unit and unit and (isinstance(entry, Mapping) or angle)):
                continue
            if role:  # of which the format says the unit, too
                units[name] = unit
            else:
                names[name] = f"{name} [{unit}]"
    columns = {names.get(name, name): values for name, values in recording.columns.items()}
    note = ("the units that the file says stand in brackets behind the names",) if names else ()
    return replace(recording, columns=columns, units=units, notes=(*recording.notes, *note))


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
