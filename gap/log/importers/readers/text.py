"""Text files as tables: their encoding, what stands above the samples, what parts the cells; pandas reads the rest."""

from __future__ import annotations

import codecs
import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from .....common.documents import RECORDING, read_bytes
from ...types import LogError
from ..expression import unit_of
from ..recording import NoRecording

SEPARATORS = (",", ";", "\t", "|", " ")
COMMENTS = ("#", "%")
BRACKETS = " -[]()"  # about a unit below a name, or in place of none
HEAD_LINES, LAST_LINES = 400, 12
"""Lines that tell how a file is laid out, and those at their end that tell the separator: what a tool writes above the
samples stands before them."""
MISSING = ("", "-", "--", "---", "nan", "null", "none", "n/a", "na", "inf", "-inf", "#n/a", "ovf")
NUMBER = r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?"
LIST = r"[\[(]\s*[-+]?[\d.][-+\d.eE,;\s]*[\])]"
"""Numbers in brackets, with commas or without."""
STAMP = r"(?:\d+ days? )?\d[\d.:/-]*[:/.-]\d[\dT :.,+-]*(?:Z|\s*[AaPp][Mm])?"
VALUE = re.compile("|".join((NUMBER, LIST, STAMP)))
"""How a number, a list of numbers, a date or a time is written."""
LONGEST_CELL = 300
"""Letters of a cell that may be a number, and of the name of a column."""
LONG = re.compile(rf"[^\s,;|]{{{LONGEST_CELL + 1},}}")
"""A word that is cut: no number is so long, and patterns take time with the square of a word."""
CONTROL = re.compile(r"[\x00-\x08\x0e-\x19\x1b-\x1f]")
"""Signs that no text has."""


@dataclass
class _Layout:
    """How a file is laid out: names of its columns, lines above the first sample, the sign between cells, notes."""

    names: list[str]
    skipped: int
    separator: str
    notes: list[str]


def read_text(path: Path) -> tuple[pd.DataFrame, list[str]]:
    """A text file as a table of text, and notes on how it was read.

    Raises:
        LogError: it is no text, is empty, or a row has other cells than the rest.
    """
    text, encoding = _decoded(read_bytes(path, RECORDING), path)
    lines = (
        LONG.sub(lambda word: word[0][: LONGEST_CELL + 1], text).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    )
    layout = _layout(lines[:HEAD_LINES], path)
    if encoding == "cp1252":
        layout.notes.append("the file is read as Windows text (cp1252), for it is no UTF-8")
    return pd.DataFrame(_rows(lines, layout, path), columns=layout.names, dtype="str"), layout.notes


def _decoded(raw: bytes, path: Path) -> tuple[str, str]:
    """A text by its mark or its bytes, and its encoding."""
    marked = raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    for encoding in ("utf-16",) if marked else ("utf-8-sig", "cp1252"):
        try:
            text = raw.decode(encoding)
        except UnicodeDecodeError:
            continue
        if not CONTROL.search(text[: 1 << 16]):
            return text, encoding
    raise NoRecording(f"{path}: is not a text file; export the log as CSV or Parquet.")


def _rows(lines: Sequence[str], layout: _Layout, path: Path) -> list[list[str]]:
    """Cells of the samples; a last line that was cut off is left out, which is noted.

    Raises:
        LogError: another line has fewer or more cells than columns.
    """
    width, rows = len(layout.names), []
    filled = [k for k in range(layout.skipped, len(lines)) if _is_filled(lines[k])]
    for k in filled:
        cells = _split(lines[k], layout.separator)
        if len(cells) == width:
            rows.append(cells)
        elif k == filled[-1] and len(cells) < width:
            layout.notes.append(f"the last line has {len(cells)} of {width} values and is left out")
        else:
            count = f"{len(cells)} value{'s' * (len(cells) != 1)}"
            raise LogError(f"{path}: line {k + 1} has {count} for {width} columns; complete or remove it.")
    return rows


# --- layout ----------------------------------------------------------------------------------------------------------


def _layout(lines: Sequence[str], path: Path) -> _Layout:
    """What the first lines of a file say of it.

    Raises:
        NoRecording: it holds no samples.
    """
    filled = [k for k, line in enumerate(lines) if _is_filled(line)]
    if not filled:
        raise NoRecording(f"{path}: is empty; record the log again or leave the file out.")
    separator = _separator([lines[k] for k in filled[-LAST_LINES:]])
    rows = {k: _split(lines[k], separator) for k in filled}
    width = Counter(len(rows[k]) for k in filled[-LAST_LINES:]).most_common(1)[0][0]
    last = [rows[k] for k in filled[-LAST_LINES:] if len(rows[k]) == width and (k != filled[0] or len(filled) == 1)]
    usual = [at for at in range(width) if 2 * sum(is_value(row[at]) for row in last) > len(last)]
    start = next((k for k in filled if len(rows[k]) == width and _is_sample(rows[k], usual)), None)
    if start is None or not usual:
        what = "has no column of numbers; export it as CSV with one header line, or as Parquet"
        if len(filled) == 1 and start is None:
            what = "has names, but no samples; record the log again or leave the file out"
        raise NoRecording(f"{path}: {what}.")
    notes: list[str] = []
    names = _names(lines, [rows[k] for k in filled if k < start], rows[start], start, path, notes)
    return _Layout(_unique(names, notes), start, separator, notes)


def _names(
    lines: Sequence[str], above: list[list[str]], first: list[str], start: int, path: Path, notes: list[str]
) -> list[str]:
    """Names of the columns from what stands above the first sample, in a comment where nothing else does."""
    width, header, units = len(first), above[-1] if above else [], list[str]()
    said = {cell: unit_of(cell) for cell in header if cell.strip(BRACKETS)}
    if len(above) > 1 and len(above[-2]) == len(header) and 2 * sum(map(bool, said.values())) > len(said):
        header, units = above[-2], [said.get(cell) or cell.strip(BRACKETS) for cell in header]
        notes.append("the row below the names has the units, which stand in brackets behind them")
    if len(header) not in (width, width - 1) and start:  # parted by another sign than the samples
        line = lines[start - 1].lstrip("#% \t")
        tries = [_split(line, separator) for separator in SEPARATORS]
        found = next((names for names in tries if len(names) == width), [])
        if not found and len(header) > 1:
            raise LogError(f"{path}: line {start} has {len(header)} names for {width} columns; name each column.")
        header = found
    if not header:
        return [""] * width
    if len(header) == width - 1:  # a separator at the end of each row, or rows that are numbered
        header = [*header, ""] if not first[-1].strip() else ["", *header]
    named = [name.strip().strip('"').strip() for name in header]
    return [f"{name} [{unit}]" if unit else name for name, unit in zip(named, [*units, *[""] * width], strict=False)]


def is_value(cell: str) -> bool:
    """Whether a cell of text may be a number, a list of numbers or a time."""
    text = cell.strip().strip("'\"")
    return bool(VALUE.fullmatch(text)) or text.lower() in (*MISSING[4:], "true", "false")


def _is_sample(row: Sequence[str], usual: Sequence[int]) -> bool:
    cells = [row[at].strip() for at in usual if row[at].strip()]
    return bool(cells) and all(map(is_value, cells))


def _separator(lines: Sequence[str]) -> str:
    """The sign that parts the lines into the most numbers, and into as many in each."""
    best, most = ",", 1
    for separator in SEPARATORS:
        rows = [_split(line, separator) for line in lines]
        count, times = Counter(map(len, rows)).most_common(1)[0]
        values = sum(is_value(cell) for row in rows for cell in row)
        if count > 1 and times >= 0.8 * len(rows) and values > most:
            best, most = separator, values
    return best


def _split(line: str, separator: str) -> list[str]:
    """Cells of a line; runs of blanks part them."""
    line = re.sub(r"[ \t]+", " ", line.strip()) if separator == " " else line
    if '"' not in line:
        return line.split(separator)
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=separator == ","), [])
    except csv.Error:  # a cell of more than 128 KiB
        return [line]


def _is_filled(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith(COMMENTS)


def _unique(names: Sequence[str], notes: list[str]) -> list[str]:
    seen: Counter[str] = Counter()
    out = []
    for place, name in enumerate(names, 1):
        name = name or f"column{place}"
        seen[name] += 1
        out.append(name if seen[name] == 1 else f"{name}_{seen[name]}")
    if several := [name for name, count in seen.items() if count > 1]:
        notes.append(f"several columns are called {', '.join(several)}; the second of them is {several[0]}_2 here")
    return out
