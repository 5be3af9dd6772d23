"""Text files as tables: their encoding, what stands above the samples, what parts the cells."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pyarrow as pa
from pyarrow import csv as arrow_csv

from ...types import LogError
from ..recording import NoRecording
from ..unit_words import unit_of
from .cells import CLOCK, GROUPED, LONGEST_CELL, PLAIN, quantity

SEPARATORS = (",", ";", "\t", "|", " ")
COMMENTS = ("#", "%")
_HEAD_BYTES = 1 << 16
_LAST = 12
"""Lines at the end of the head that tell the separator; what a tool writes above the samples stands before them."""
MARKS = ((codecs.BOM_UTF8, "utf8"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
LABELLED = re.compile(r"\s*[\"']?([A-Za-zÀ-ÿ_][^:=,;]*?)[\"']?\s*[:=]\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*\Z")
"""A cell with its name: ``goal:12.5``, as for Arduino's plotter."""
STAMP = re.compile(r"\d{1,2}:\d{2}:\d{2}[.,]\d+\Z")
STAMPED = re.compile(r"(\d{1,2}:\d{2}:\d{2}[.,]\d+) -> ")
"""What Arduino's monitor puts before a line."""
WRAPPED = re.compile(r"\s*[\[({]([^\[\](){}]*)[\])}],?\s*\Z")
"""A line in brackets, as of JSON."""
DATED = re.compile(
    r"\d{1,4}[-./]\d{1,2}[-./]\d{1,4}([T ]+\d{1,2}:\d{2}(:\d{2}([.,]\d+)?)?\s*([AaPp][Mm]|Z|[-+]\d\d:?\d\d)?)?\Z"
)
WORDS = frozenset(["true", "false", "nan", "null", "none", "na", "n/a", "inf", "-inf"])
LONG = re.compile(rf"[^\s,;|]{{{LONGEST_CELL + 1},}}")
CONTROL = re.compile(r"[\x00-\x08\x0e-\x19\x1b-\x1f]")
"""Signs that no text has."""
BOM = "\ufeff"


@dataclass
class _Layout:
    """How a file is laid out.

    Attributes:
        names: of its columns.
        skipped: lines above the first sample.
        separator: between cells.
        comma: whether decimals stand behind a comma.
        notes: for people.
        rewrite: lines are no CSV as they stand.
        words: no column holds numbers in most of the last lines.
        labels: each cell names its column.
        ends: line behind the last sample; None at the end of the file.
    """

    names: list[str]
    skipped: int
    separator: str
    comma: bool
    notes: list[str] = field(default_factory=list)
    rewrite: bool = False
    words: bool = False
    labels: bool = False
    ends: int | None = None


def read_text(path: Path) -> tuple[pa.Table, list[str]]:
    """A text file as a table, and notes on how it was read.

    Raises:
        LogError: it is no text, is empty, or a row has other cells than the rest.
    """
    try:
        with open(path, "rb") as file:
            raw = file.read(_HEAD_BYTES)
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}.") from None
    encoding = _encoding(raw, path)
    head = _shortened(codecs.getincrementaldecoder(encoding)("replace").decode(raw).lstrip(BOM))
    lines = _lines(head) if len(raw) < _HEAD_BYTES else _lines(head)[:-1] or [head]
    layout = _layout(lines, path)
    if encoding == "cp1252":
        layout.notes.append("the file is read as Windows text (cp1252), for it is no UTF-8")
    try:
        if not layout.rewrite:
            return _arrow(path, layout, layout.skipped, layout.separator, encoding), layout.notes
        text = _shortened(path.read_bytes().decode(encoding, "replace"))
        return _arrow(_rewritten(text, layout), layout, 0, ",", "utf8"), layout.notes
    except pa.ArrowInvalid as error:
        said = str(error).splitlines()[0]
    if layout.words:
        raise _no_numbers(path)
    text = _shortened(path.read_bytes().decode(encoding, "replace"))
    _check_rows(text, layout, path)
    try:
        return _arrow(_rewritten(text, layout), layout, 0, ",", "utf8"), layout.notes
    except pa.ArrowInvalid:
        raise LogError(f"{path}: cannot be read as CSV: {said}; export it again.") from None


def _no_numbers(path: Path) -> NoRecording:
    return NoRecording(f"{path}: has no column of numbers; export it as CSV with one header line, or as Parquet.")


def _arrow(source: Path | io.BytesIO, layout: _Layout, skipped: int, separator: str, encoding: str) -> pa.Table:
    return arrow_csv.read_csv(
        source,
        read_options=arrow_csv.ReadOptions(column_names=layout.names, skip_rows=skipped, encoding=encoding),
        parse_options=arrow_csv.ParseOptions(delimiter=separator, ignore_empty_lines=True),
        convert_options=arrow_csv.ConvertOptions(
            decimal_point="," if layout.comma else ".",
            true_values=["True", "true", "TRUE"],
            false_values=["False", "false", "FALSE"],
            strings_can_be_null=True,
        ),
    )


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
    """What the first lines of a file say of it."""
    filled = [k for k, line in enumerate(lines) if _is_filled(line)]
    if not filled:
        raise NoRecording(f"{path}: is empty; record the log again or leave the file out.")
    tail = [lines[k] for k in filled[-_LAST:]]
    separator, stamped = _separator(tail), all(STAMPED.match(line) for line in tail)
    rows = {k: _split(lines[k], separator) for k in filled}
    counts = [len(rows[k]) for k in filled[-_LAST:]]
    width = max(set(counts), key=counts.count)
    labelled = [k for k in filled if len(rows[k]) == width and all(map(_is_labelled, rows[k]))]
    if labelled and labelled[-1] in filled[-2:]:
        names = [_label(cell, k) for k, cell in enumerate(rows[labelled[-1]])]
        notes: list[str] = []
        return _Layout(_unique(names, notes), labelled[0], separator, False, notes, rewrite=True, labels=True)
    usual = _usual(rows, filled, width)
    start = next((k for k in filled if len(rows[k]) == width and _is_sample(rows[k], usual)), None)
    if len(filled) == 1 and start is None:
        raise NoRecording(f"{path}: has names, but no samples; record the log again or leave the file out.")
    if start is None or not usual:
        start = filled[1] if len(filled) > 1 else filled[0]
    above = [k for k in filled if k < start]
    notes = []
    try:
        names = _names(lines, rows, above, start, width, path, notes)
    except LogError:
        if usual:
            raise
        raise _no_numbers(path) from None
    samples = [rows[k] for k in filled if k >= start][:20]
    comma = any("," in cell for row in samples for cell in row if PLAIN.match(cell.strip()))
    rewrite = stamped or separator == " " or all(WRAPPED.match(line) for line in tail)
    return _Layout(_unique(names, notes), start, separator, comma, notes, rewrite, words=not usual)


def _is_labelled(cell: str) -> bool:
    return bool(LABELLED.match(cell) or STAMP.match(cell))


def _label(cell: str, place: int) -> str:
    match = LABELLED.match(cell)
    return match[1] if match else f"column{place + 1}"


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
        return [f"column{k + 1}" for k in range(width)]
    if len(header) == width - 1:  # a separator at the end of each row, or rows that are numbered
        header = [*header, ""] if not rows.get(start, [""])[-1].strip() else ["", *header]
    named = [name.strip().strip('"').strip() for name in header]
    return [f"{name} [{unit}]" if unit else name for name, unit in zip(named, [*units, *[""] * width], strict=False)]


def _usual(rows: dict[int, list[str]], filled: Sequence[int], width: int) -> list[int]:
    """Columns that hold numbers or times in most of the last rows."""
    last = [rows[k] for k in filled[-_LAST:] if len(rows[k]) == width]
    return [at for at in range(width) if 2 * sum(_is_value(row[at]) for row in last) > len(last)]


def _other_split(line: str, width: int) -> list[str]:
    """Names in a line that is parted by another sign than the samples; none where no sign gives one for each."""
    tries = [_cells(line, separator) for separator in (",", ";", "\t")]
    tries += [re.split(r"\s{2,}|\t", line.strip()), _split(line, " ")]
    return next((names for names in tries if len(names) == width), [])


def _is_sample(row: Sequence[str], usual: Sequence[int]) -> bool:
    cells = [row[at].strip() for at in usual if row[at].strip()]
    return bool(cells) and all(map(_is_value, cells))


def _is_value(cell: str) -> bool:
    text = cell.strip().strip("'\"")
    shapes = (PLAIN, CLOCK, DATED, *GROUPED.values())
    return any(shape.match(text) for shape in shapes) or text.lower() in WORDS or bool(quantity(text))


def _separator(lines: Sequence[str]) -> str:
    """The sign that parts the lines into the most numbers, and into as many in each."""
    best, most = ",", 1
    for separator in SEPARATORS:
        rows = [_split(line, separator) for line in lines]
        counts = [len(row) for row in rows]
        usual = max(set(counts), key=counts.count)
        if usual < 2 or counts.count(usual) < 0.8 * len(counts):
            continue
        values = sum(_is_value(cell) or _is_labelled(cell) for row in rows for cell in row)
        if values > most:
            best, most = separator, values
    return best


def _cells(line: str, separator: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=separator == ","), [])
    except csv.Error:  # a cell of more than 128 KiB
        return [line]


def _split(line: str, separator: str) -> list[str]:
    """Cells of a line that is no plain CSV: runs of blanks part them, a stamp before the line is a cell."""
    stamp = STAMPED.match(line)
    rest = line[stamp.end() :] if stamp else line
    if (wrapped := WRAPPED.match(rest)) and any(sign.isdigit() for sign in rest):
        rest = wrapped[1]
    if separator == " ":
        cells = next(csv.reader([re.sub(r"[ \t]+", " ", rest.strip())], delimiter=" "), [])
    else:
        cells = _cells(rest, separator)
    return [stamp[1], *cells] if stamp else cells


def _rewritten(text: str, layout: _Layout) -> io.BytesIO:
    """Samples of a file as plain CSV."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    for line in _lines(text)[layout.skipped : layout.ends]:
        if not _is_filled(line):
            continue
        cells = _split(line, layout.separator)
        if layout.labels:
            cells = [match[2] if (match := LABELLED.match(cell)) else cell for cell in cells]
        writer.writerow(cells)
    return io.BytesIO(out.getvalue().encode())


def _check_rows(text: str, layout: _Layout, path: Path) -> None:
    """Each row has the same number of cells; a last one that was cut off is left out, which is noted."""
    width = len(layout.names)
    lines = _lines(text)
    filled = [k for k, line in enumerate(lines) if k >= layout.skipped and _is_filled(line)]
    for k in filled:
        count = len(_split(lines[k], layout.separator))
        if count == width:
            continue
        if k == filled[-1] and count < width:
            layout.ends = k
            layout.notes.append(f"the last line has {count} of {width} values and is left out")
            return
        raise LogError(
            f"{path}: line {k + 1} has {count} value{'s' * (count != 1)} for {width} columns; complete or remove it."
        )


def _shortened(text: str) -> str:
    """A text whose long words are cut: no number is so long, and patterns take time with the square of a word."""
    return LONG.sub(lambda word: word[0][:LONGEST_CELL], text)


def _lines(text: str) -> list[str]:
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


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
