"""JSON as recordings: a list of rows, a mapping of columns, one row a line, BAM's entries, or runs with vectors."""

from __future__ import annotations

from collections import Counter
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
from .tables import recording_of
from .trees import is_structures, recordings_of

LINES = (".jsonl", ".ndjson")
EMPTY_CELLS, FREE_CELLS = 10, 1_000_000
"""Times as many cells as have a value that a table of rows may have, beside those that are free."""
OF_BAM = frozenset(["mass", "arm_mass", "length", "kp", "vin", "motor", "trajectory"])
"""What recorders of BAM say of a run, beside its entries."""
OF_UNITS = {"unit", "units"}
"""Keys with which a file says units in its own way: those of columns whose names say none are asked about."""


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
    columns = _columns(content["entries"] if bam else content)
    lengths = Counter(map(len, columns.values()))
    length = max(lengths, key=lambda n: (lengths[n], n), default=0)
    kept = {name: cells for name, cells in columns.items() if len(cells) == length}
    if length < MINIMUM_SAMPLES:
        raise NoRecording(
            f"{path}: is no recording: a list of rows, a mapping of columns to lists of one length, one row a line, "
            "runs with vectors, or the list 'entries' of BAM is expected."
        )
    left = sorted(columns.keys() - kept.keys())
    notes = [f"left out, for they do not have {length} samples: {', '.join(left)}"] if left else []
    above = {name.partition(".")[0] for name in kept}
    if isinstance(content, Mapping) and len(above) == 1 and is_structures(content.get(rows := above.pop())):
        kept = {name.removeprefix(f"{rows}."): cells for name, cells in kept.items()}
    facts = plain_facts(content) if isinstance(content, Mapping) else {}
    frame = pd.DataFrame({name: _series(cells) for name, cells in kept.items()})
    recording = recording_of(frame, path, notes, facts)
    if bam:
        return [replace(recording, kind="bam", facts=facts)]
    open_ones = (
        {name: said(name) for name in recording.columns}
        if isinstance(content, Mapping) and OF_UNITS & content.keys()
        else {}
    )
    units = {name: "?" for name, claim in open_ones.items() if not claim.unit and claim.signal != "time"}
    return [replace(recording, units=units)]


def _content(path: Path) -> Any:
    """A JSON file, or the list of its lines where each is JSON of its own."""
    text = read_text(path, RECORDING)
    if path.suffix.lower() not in LINES:
        return parse_json(text, str(path))
    rows = []
    for k, line in enumerate(text.splitlines(), 1):
        try:
            rows += [parse_json(line)] if line.strip() else []
        except DocumentError as error:
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


def _columns(content: Any) -> dict[str, list[Any]]:
    """Lists by their dotted names; those of rows by the names in the rows, none where these are mostly empty."""
    if isinstance(content, Mapping):
        return {f"{key}{f'.{name}' * bool(name)}": cells
                for key, value in content.items() for name, cells in _columns(value).items()}  # fmt: skip
    if not is_structures(content):
        flat = isinstance(content, list) and content and not any(isinstance(one, Mapping) for one in content)
        return {"": content} if flat else {}
    flat = [_flat(row) for row in content]
    names = dict.fromkeys(name for row in flat for name in row)
    if len(names) * len(flat) > EMPTY_CELLS * sum(map(len, flat)) + FREE_CELLS:
        return {}
    return {name: [row.get(name) for row in flat] for name in names}


def _flat(row: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Entries of a mapping by their dotted names; arrays stay lists."""
    out: dict[str, Any] = {}
    for name, value in row.items():
        out |= _flat(value, f"{above}{name}.") if isinstance(value, Mapping) else {f"{above}{name}": value}
    return out


def _series(cells: list[Any]) -> pd.Series:
    """Cells as pandas has them; of several kinds as text."""
    known = [cell for cell in cells if cell is not None]
    numbers = all(isinstance(cell, int | float) for cell in known)
    if numbers and any(isinstance(cell, float) for cell in known):
        return pd.Series(cells, dtype=np.float64)
    mixed = not numbers and len({type(cell) for cell in known}) > 1
    return pd.Series([str(cell) if mixed and cell is not None else cell for cell in cells], dtype=object)
