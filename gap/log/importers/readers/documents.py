"""JSON as recordings: a list of rows, a mapping of columns, one row a line, BAM's entries, or runs with vectors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from .....common.documents import RECORDING, DocumentError, parse_json, read_text
from ...reader import MINIMUM_SAMPLES
from ...types import LogError
from ..names import said
from ..recording import FEWEST_RECORDED, NoRecording, Recording, plain_facts
from ..units import measures, unit_of
from .cells import numeric_columns
from .tables import ENDINGS, recording_of
from .trees import is_structures, recordings_of

LINES = (".jsonl", ".ndjson")
EMPTY_CELLS, FREE_CELLS = 10, 1_000_000
"""Times as many cells as have a value that a table of rows may have, beside those that are free."""
OF_BAM = frozenset(["mass", "arm_mass", "length", "kp", "vin", "motor", "trajectory"])
"""What recorders of BAM say of a run, beside its entries."""
OF_UNITS = ("unit", "units")
"""Keys with which a file says the unit of its columns, one for all of its angles or by their names."""


def is_bam(content: Any) -> bool:
    """Whether the content of a JSON file is a recording of BAM (github.com/Rhoban/bam), whose units are fixed."""
    of_entries = isinstance(content, dict) and isinstance(content.get("entries"), list)
    return of_entries and not OF_BAM.isdisjoint(content) and content.keys().isdisjoint(OF_UNITS)


def read_json(path: Path) -> list[Recording]:
    """The recordings of a JSON file.

    Raises:
        LogError: it is no JSON, or holds none.
    """
    content = _content(path)
    bam = is_bam(content)
    if not bam and (runs := _runs(content)):
        return recordings_of(path, "json", runs)
    frame, left = _frame(content["entries"] if bam else content)
    if frame is None:
        raise NoRecording(
            f"{path}: is no recording: a list of rows, a mapping of columns to lists of one length, one row a line, "
            "runs with vectors, or the list 'entries' of BAM is expected."
        )
    notes = [f"left out, for they do not have {len(frame)} samples: {', '.join(left)}"] if left else []
    facts = plain_facts(content) if isinstance(content, Mapping) else {}
    recording = recording_of(frame, path, notes, facts)
    return [replace(recording, kind="bam", facts=facts) if bam else _with_units(recording, content)]


def is_recording(path: Path) -> bool:
    """Whether a JSON file of a folder is a recording, and not a description."""
    try:
        content = _content(path)
    except (LogError, DocumentError):
        return False
    if is_bam(content) or _runs(content):
        return True
    frame = (
        None if any(path.with_suffix(ending).is_file() for ending in ENDINGS) else _frame(content)[0]
    )  # which it describes
    return frame is not None and len(frame) >= FEWEST_RECORDED and bool(numeric_columns(frame).columns)


def _content(path: Path) -> Any:
    """A JSON file, or the list of its lines where each is JSON of its own."""
    text = read_text(path, RECORDING)
    try:
        return parse_json(text, str(path)) if path.suffix.lower() not in LINES else _lines(path, text)
    except DocumentError as error:
        if path.suffix.lower() not in LINES and error.line and text.lstrip().startswith("{"):
            return _lines(path, text)
        raise


def _lines(path: Path, text: str) -> list[Any]:
    rows, lines = [], [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip()]
    for k, line in lines:
        try:
            rows.append(parse_json(line))
        except DocumentError as error:
            if line is lines[-1][1] and len(rows) >= MINIMUM_SAMPLES:  # cut off
                break
            raise LogError(f"{path}: line {k} is not JSON: it {error.problem}; correct or remove it.") from None
    return rows


def _runs(content: Any) -> dict[str, Any]:
    """A list of runs with vectors, or a mapping to one, with what stands beside it; empty where there is none."""
    whole = content if isinstance(content, Mapping) else {"runs": content}
    long = (len(vector) for value in whole.values() if is_structures(value) for one in value
            for vector in one.values()
            if isinstance(vector, list) and len(vector) >= max(FEWEST_RECORDED, len(value)))  # fmt: skip
    return {str(name): _arrays(value) for name, value in whole.items()} if any(long) else {}


def _arrays(value: Any) -> Any:
    """Lists of numbers as arrays."""
    if isinstance(value, Mapping):
        return {str(name): _arrays(one) for name, one in value.items()}
    if not isinstance(value, list) or is_structures(value):
        return [_arrays(one) for one in value] if isinstance(value, list) else value
    try:
        return np.array(value, np.float64)
    except (TypeError, ValueError):
        return value if all(isinstance(one, str) for one in value) else None


def _frame(content: Any) -> tuple[pd.DataFrame | None, list[str]]:
    """The table that JSON holds, None where it holds none, and names of lists of other lengths."""
    if isinstance(content, Mapping):
        columns = {name: cells for name, cells in _flat(content).items() if isinstance(cells, list)}
        lengths = [len(cells) for cells in columns.values()]
        rows = [name for name, cells in columns.items() if is_structures(cells) and len(cells) == max(lengths)]
        if len(rows) == 1 and lengths.count(max(lengths)) == 1:
            return _frame(columns[rows[0]])[0], sorted(columns.keys() - rows)
        length = max(set(lengths), key=lambda n: (lengths.count(n), n), default=0)
        kept = {name: cells for name, cells in columns.items() if len(cells) == length}
        content = [dict(zip(kept, row, strict=True)) for row in zip(*kept.values(), strict=True)]
        return _frame(content)[0], sorted(columns.keys() - kept.keys())
    if not is_structures(content) or len(content) < MINIMUM_SAMPLES:
        return None, []
    flat = [_flat(row) for row in content]
    names = dict.fromkeys(name for row in flat for name in row)
    if len(names) * len(flat) > EMPTY_CELLS * sum(map(len, flat)) + FREE_CELLS:
        return None, []
    return pd.DataFrame({name: _series([row.get(name) for row in flat]) for name in names}), []


def _flat(row: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Entries of a mapping by their dotted names; arrays stay lists."""
    out: dict[str, Any] = {}
    for name, value in row.items():
        out |= _flat(value, f"{above}{name}.") if isinstance(value, Mapping) else {f"{above}{name}": value}
    return out


def _series(cells: list[Any]) -> pd.Series:
    """Cells as pandas has them; of several kinds as text."""
    kinds = {
        list if isinstance(cell, list) else str if isinstance(cell, str) else float
        for cell in cells
        if cell is not None
    }
    if kinds == {float} and not all(isinstance(cell, int) for cell in cells):
        return pd.Series(cells, dtype=np.float64)
    mixed = len(kinds) > 1
    return pd.Series([str(cell) if mixed and cell is not None else cell for cell in cells], dtype=object)


def _with_units(recording: Recording, content: Any) -> Recording:
    """The recording with the units that its file says beside the columns, by their names or by one word for the
    angles."""
    entries = [content[key] for key in OF_UNITS if key in content] if isinstance(content, Mapping) else []
    units: dict[str, str] = {}
    for column in recording.columns if entries else ():
        name = recording.parts.get(column, ("", column))[1]
        for entry in entries if not said(name).unit else ():
            word = entry.get(name, entry.get(name.partition("[")[0])) if isinstance(entry, Mapping) else entry
            unit = unit_of(word) if isinstance(word, str) else ""
            angle = measures(unit, "angle", "way") and said(name).signal in ("position", "goal", "link_position")
            if unit and (isinstance(entry, Mapping) or angle):
                units[column] = unit
    return replace(recording, units=units)
