"""Text files as tables: their encoding, what stands above the samples, what parts the cells; pandas reads the rest."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from .....common.documents import RECORDING, read_bytes
from ...types import LogError
from ..recording import NoRecording
from ..units import unit_of
from .cells import FORMULA, LONGEST_CELL, is_value

SEPARATORS = (",", ";", "\t", "|", " ")
COMMENTS = ("#", "%")
HEAD_LINES, LAST_LINES = 400, 12
"""Lines that tell how a file is laid out, and those at their end that tell the separator: what a tool writes above the
samples stands before them."""
MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
LABELLED = re.compile(r"\s*[\"']?([A-Za-zÀ-ÿ_][^:=,;]*?)[\"']?\s*[:=]\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*\Z")
"""A cell with its name: ``goal:12.5``, as for Arduino's plotter."""
WRAPPED = re.compile(r"\s*[\[({]([^\[\](){}]*)[\])}],?\s*\Z")
"""A line in brackets, as of JSON."""
LONG = re.compile(rf"[^\s,;|]{{{LONGEST_CELL + 1},}}")
"""A word that is cut: no number is so long, and patterns take time with the square of a word."""
CONTROL = re.compile(r"[\x00-\x08\x0e-\x19\x1b-\x1f]")
"""Signs that no text has."""


@dataclass
class _Layout:
    """How a file is laid out: names of its columns, lines above the first sample, the sign between cells, whether each
    cell names its column, and notes for people."""

    names: list[str]
    skipped: int
    separator: str
    labels: bool
    notes: list[str]


def read_text(path: Path) -> tuple[pd.DataFrame, list[str]]:
    """A text file as a table of text, and notes on how it was read.

    Raises:
        LogError: it is no text, is empty, or a row has other cells than the rest.
    """
    raw = read_bytes(path, RECORDING)
    encoding = _encoding(raw[: 1 << 16], path)
    text = LONG.sub(lambda word: word[0][: LONGEST_CELL + 1], raw.decode(encoding, "replace"))
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    layout = _layout(lines[:HEAD_LINES], path)
    if encoding == "cp1252":
        layout.notes.append("the file is read as Windows text (cp1252), for it is no UTF-8")
    return pd.DataFrame(_rows(lines, layout, path), columns=layout.names, dtype="str"), layout.notes


def _rows(lines: Sequence[str], layout: _Layout, path: Path) -> list[list[str]]:
    """Cells of the samples; a last line that was cut off is left out, which is noted.

    Raises:
        LogError: another line has fewer or more cells than columns.
    """
    width, rows = len(layout.names), []
    filled = [k for k in range(layout.skipped, len(lines)) if _is_filled(lines[k])]
    for k in filled:
        cells = _split(lines[k], layout.separator)
        if len(cells) != width:
            if k == filled[-1] and len(cells) < width:
                layout.notes.append(f"the last line has {len(cells)} of {width} values and is left out")
                break
            count = f"{len(cells)} value{'s' * (len(cells) != 1)}"
            raise LogError(f"{path}: line {k + 1} has {count} for {width} columns; complete or remove it.")
        if layout.labels:
            cells = [match[2] if (match := LABELLED.match(cell)) else cell for cell in cells]
        rows.append(cells)
    return rows


def _encoding(raw: bytes, path: Path) -> str:
    """Encoding of a text by its mark and its bytes."""
    for mark, name in MARKS:
        if raw.startswith(mark):
            return name
    for name in ("utf8", "utf-16-le", "utf-16-be", "cp1252"):
        try:
            text = codecs.getincrementaldecoder(name)().decode(raw)
        except UnicodeDecodeError:
            continue
        if not CONTROL.search(text) and (
            not name.startswith("utf-16") or sum(map(str.isascii, text)) > 0.9 * len(text)
        ):
            return name
    raise NoRecording(f"{path}: is not a text file; export the log as CSV or Parquet.")


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
    counts = [len(rows[k]) for k in filled[-LAST_LINES:]]
    width = max(set(counts), key=counts.count)
    labelled = [k for k in filled if len(rows[k]) == width and all(map(LABELLED.match, rows[k]))]
    notes: list[str] = []
    if labelled and labelled[-1] in filled[-2:]:
        names = [match[1] if (match := LABELLED.match(cell)) else "" for cell in rows[labelled[-1]]]
        return _Layout(_unique(names, notes), labelled[0], separator, True, notes)
    usual = _usual(rows, filled, width)
    start = next((k for k in filled if len(rows[k]) == width and _is_sample(rows[k], usual)), None)
    if start is None or not usual:
        cells = (cell.strip(" \"'") for k in filled for cell in rows[k])
        what = "has no column of numbers; export it as CSV with one header line, or as Parquet"
        if len(filled) == 1 and start is None:
            what = "has names, but no samples; record the log again or leave the file out"
        elif any(map(FORMULA.match, cells)):
            what = "holds formulas of a spreadsheet, which are not computed; export values"
        raise NoRecording(f"{path}: {what}.")
    names = _names(lines, rows, [k for k in filled if k < start], start, width, path, notes)
    if long := next((name for name in names if len(name) > LONGEST_CELL), ""):
        raise LogError(
            f"{path}: column '{long[:40]}...' has a name of over {LONGEST_CELL} letters; give it a shorter one."
        )
    return _Layout(_unique(names, notes), start, separator, False, notes)


def _names(
    lines: Sequence[str], rows: dict[int, list[str]], above: list[int], start: int, width: int, path: Path,
    notes: list[str],
) -> list[str]:  # fmt: skip
    """Names of the columns from what stands above the first sample."""
    header: list[str] = []
    units: list[str] = []
    if above:
        header = rows[above[-1]]
        said = [unit_of(cell) for cell in header]
        if len(above) > 1 and any(said) and all(u or not c.strip(" -[]()") for u, c in zip(said, header, strict=True)):
            header, units = rows[above[-2]], said
            notes.append("the row below the names has the units, which stand in brackets behind them")
        elif len(header) not in (width, width - 1):
            header = _other_split(lines[above[-1]], width)
            if not header and len(rows[above[-1]]) > 1:
                count = len(rows[above[-1]])
                raise LogError(f"{path}: line {above[-1] + 1} has {count} names for {width} columns; name each column.")
    elif start:  # the names may stand in a comment
        header = _other_split(lines[start - 1].lstrip("#% \t"), width)
    if not header:
        return [""] * width
    if len(header) == width - 1:  # a separator at the end of each row, or rows that are numbered
        header = [*header, ""] if not rows.get(start, [""])[-1].strip() else ["", *header]
    named = [name.strip().strip('"').strip() for name in header]
    return [f"{name} [{unit}]" if unit else name for name, unit in zip(named, [*units, *[""] * width], strict=False)]


def _usual(rows: dict[int, list[str]], filled: Sequence[int], width: int) -> list[int]:
    """Columns that hold numbers or times in most of the last rows."""
    last = [rows[k] for k in filled[-LAST_LINES:] if len(rows[k]) == width and (k != filled[0] or len(filled) == 1)]
    return [at for at in range(width) if 2 * sum(is_value(row[at]) for row in last) > len(last)]


def _other_split(line: str, width: int) -> list[str]:
    """Names in a line that is parted by another sign than the samples; none where no sign gives one for each."""
    tries = [_cells(line, separator) for separator in (",", ";", "\t")]
    tries += [re.split(r"\s{2,}|\t", line.strip()), _split(line, " ")]
    return next((names for names in tries if len(names) == width), [])


def _is_sample(row: Sequence[str], usual: Sequence[int]) -> bool:
    cells = [row[at].strip() for at in usual if row[at].strip()]
    return bool(cells) and all(map(is_value, cells))


def _separator(lines: Sequence[str]) -> str:
    """The sign that parts the lines into the most numbers, and into as many in each."""
    best, most = ",", 1
    for separator in SEPARATORS:
        rows = [_split(line, separator) for line in lines]
        counts = [len(row) for row in rows]
        usual = max(set(counts), key=counts.count)
        if usual < 2 or counts.count(usual) < 0.8 * len(counts):
            continue
        values = sum(bool(is_value(cell) or LABELLED.match(cell)) for row in rows for cell in row)
        if values > most:
            best, most = separator, values
    return best


def _cells(line: str, separator: str) -> list[str]:
    if '"' not in line:
        return line.split(separator)
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=separator == ","), [])
    except csv.Error:  # a cell of more than 128 KiB
        return [line]


def _split(line: str, separator: str) -> list[str]:
    """Cells of a line; runs of blanks part them, brackets around it go."""
    if line[:1] in "[({ " and (wrapped := WRAPPED.match(line)) and any(sign.isdigit() for sign in line):
        line = wrapped[1]
    return _cells(re.sub(r"[ \t]+", " ", line.strip()), " ") if separator == " " else _cells(line, separator)


def _is_filled(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith(COMMENTS)


def _unique(names: Sequence[str], notes: list[str]) -> list[str]:
    seen: dict[str, int] = {}
    out = []
    for place, name in enumerate(names):
        name = name or f"column{place + 1}"
        seen[name] = seen.get(name, 0) + 1
        out.append(name if seen[name] == 1 else f"{name}_{seen[name]}")
    if several := [name for name, count in seen.items() if count > 1]:
        notes.append(f"several columns are called {', '.join(several)}; the second of them is {several[0]}_2 here")
    return out
