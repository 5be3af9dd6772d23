"""Cells of foreign tables as numbers: large counts, stamps, times of day, dates, grouped thousands, lists."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime
from functools import partial

import numpy as np
import pyarrow as pa
from pyarrow import compute

from ...types import Array
from ..unit_words import unit_of

EXACT = 2**53
"""Whole numbers beyond this one are not exact as float64."""
PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
DAY = 86400.0  # [s]
STRAY = 0.02
"""Share of cells that may be no number in a column of numbers."""
MISSING = frozenset(["", "-", "--", "---", "nan", "null", "none", "n/a", "na", "inf", "-inf", "#n/a", "ovf"])
LONGEST_CELL = 300
"""Letters of a cell that may be a number, and of the name of a column."""
PLAIN = re.compile(r"[-+]?(\d+[.,]?\d*|[.,]\d+)([eE][-+]?\d+)?\Z")
GROUPED = {
    ",": re.compile(r"[-+]?[1-9]\d{0,2}(\.\d{3})+(,\d*)?\Z"),
    ".": re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?\Z"),
}
"""Numbers with grouped thousands, by the sign of their decimals."""
OTHER_SIGN = {",": ".", ".": ","}
QUANTITY = re.compile(r"([-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?)\s*([^\d\s.,;:+-]\S*)\Z")
CLOCK = re.compile(
    r"(?:(?P<days>\d+) days? )?(?:(?P<hours>\d{1,3}):)?(?P<minutes>\d{1,2}):(?P<seconds>\d{1,2}(?:[.,]\d+)?)"
    r"\s*(?P<half>[AaPp][Mm])?\Z"
)
DATES = ("%d.%m.%Y", "%Y/%m/%d", "%Y-%m-%d", "%m/%d/%Y", "%d/%m/%Y", "%d-%m-%Y", "%d.%m.%y", "%m/%d/%y")

LOOKED_AT = 1000
"""Cells of a column of text that tell how it is written."""


@dataclass
class Cells:
    """What a table holds.

    Attributes:
        columns: of numbers.
        left: why each other column is none.
        notes: what was read otherwise than it stands, for people.
    """

    columns: dict[str, Array] = field(default_factory=dict)
    left: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def numeric_columns(table: pa.Table) -> Cells:
    """Columns that hold numbers, and why the others do not.

    Lists of a fixed length become one column for each place, ``state[0]``; stamps and times of day become seconds,
    ``stamp_s``; counts that float64 cannot hold are counted from the first one.
    """
    while any(pa.types.is_struct(kind) for kind in table.schema.types):
        table = table.flatten()
    out = Cells()
    columns, left = out.columns, out.left
    for name, chunks in zip(table.column_names, table.columns, strict=True):
        if len(name) > LONGEST_CELL:
            left[name[:40]] = f"its name has {len(name)} letters"
            continue
        kind = chunks.type
        if pa.types.is_dictionary(kind):
            chunks = chunks.cast(kind.value_type)
            kind = chunks.type
        if chunks.null_count == len(chunks):
            left[name] = "it is empty"
        elif pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind):
            places = _places(chunks)
            columns |= {f"{name}[{place}]": values for place, values in enumerate(places)}
            if not places:
                left[name] = "lists of different lengths, or not of numbers"
        elif pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
            columns[f"{name}_s"] = _from_first(chunks.cast(pa.int64())) / PER_SECOND[kind.unit]
        elif pa.types.is_time(kind):
            width = pa.int32() if pa.types.is_time32(kind) else pa.int64()
            columns[f"{name}_s"] = _across_midnight(_floats(chunks.cast(width)) / PER_SECOND[kind.unit])
        elif pa.types.is_integer(kind):
            columns[name] = _counts(chunks)
        elif pa.types.is_floating(kind) or pa.types.is_boolean(kind) or pa.types.is_decimal(kind):
            columns[name] = _floats(chunks)
        elif pa.types.is_string(kind) or pa.types.is_large_string(kind):
            texts = chunks.to_pylist()
            if max(len(text) for text in texts if text is not None) > LONGEST_CELL:
                left[name] = "it holds long words, no numbers"
            else:
                _take_text(name, texts, out)
        else:
            left[name] = f"it holds {kind} values, no numbers"
    return out


def _floats(chunks: pa.ChunkedArray) -> Array:
    whole = chunks.combine_chunks().cast(pa.float64(), safe=False)
    return np.asarray(whole.to_numpy(zero_copy_only=False), np.float64)


def _from_first(counts: pa.ChunkedArray) -> Array:
    """Whole numbers counted from the first one that is known, while they are still exact."""
    known = counts.drop_null()
    return _floats(compute.subtract(counts, known[0]) if len(known) else counts)


def _counts(chunks: pa.ChunkedArray) -> Array:
    extremes = compute.min_max(chunks).as_py()
    if max(abs(extremes["min"]), abs(extremes["max"])) <= EXACT:
        return _floats(chunks)
    return _from_first(chunks.cast(pa.int64())) if extremes["max"] < 2**63 else _floats(chunks)


def _places(chunks: pa.ChunkedArray) -> list[Array]:
    """The places of lists that are all equally long and hold numbers; none else."""
    rows = chunks.combine_chunks()
    if rows.null_count or len(rows) == 0:
        return []
    flat, count = rows.flatten(), len(rows)
    inner = flat.type
    if len(flat) % count or not (pa.types.is_integer(inner) or pa.types.is_floating(inner)):
        return []
    width = len(flat) // count
    if not pa.types.is_fixed_size_list(rows.type) and (np.diff(rows.offsets.to_numpy()) != width).any():
        return []
    places = (pa.chunked_array([flat.take(pa.array(range(place, len(flat), width)))]) for place in range(width))
    return [(_counts if pa.types.is_integer(inner) and one.null_count < count else _floats)(one) for one in places]


# --- text ------------------------------------------------------------------------------------------------------------


def _take_text(name: str, cells: Sequence[str | None], out: Cells) -> None:
    """A column of text: numbers and times that are written in an unusual way, or the reason why it is left out."""
    stripped = ["" if cell is None else cell.strip().strip("'\"") for cell in cells]
    known = [cell for cell in stripped if cell.lower() not in MISSING]
    if not known:
        out.left[name] = "it is empty"
        return
    units = {found[1] if (found := quantity(cell)) else "" for cell in known}
    if len(units) == 1 and "" not in units:
        out.columns[f"{name} [{units.pop()}]"] = np.array([(quantity(c) or (np.nan,))[0] for c in stripped])
        return
    reader, seconds = _reader(known)
    if reader is None:
        words = list(dict.fromkeys(known[:1000]))
        named = ", ".join(repr(word[:20]) for word in words[:3]) + ", ..." * (len(words) > 3)
        out.left[name] = f"it holds text, no numbers: {named}"
        return
    values = np.array([_or_nan(reader, cell) for cell in stripped])
    odd = [cell for cell in known if np.isnan(_or_nan(reader, cell))]
    if odd:
        cells_are = f"{len(odd)} cells of {name} are" if len(odd) > 1 else f"1 cell of {name} is"
        out.notes.append(f"{cells_are} no number and read as no value, the first {odd[0][:20]!r}")
    out.columns[f"{name}_s" if seconds else name] = _across_midnight(values) if seconds else values


def _or_nan(reader: Callable[[str], float], cell: str) -> float:
    try:
        return reader(cell)
    except ValueError:
        return float("nan")


def _reader(known: Sequence[str]) -> tuple[Callable[[str], float] | None, bool]:
    """What reads nearly all cells of a column, and whether it gives seconds; None where nothing does."""

    sample = known[:: max(len(known) // LOOKED_AT, 1)]

    def fits(test: Callable[[str], object]) -> bool:
        return sum(bool(test(cell)) for cell in sample) >= (1.0 - STRAY) * len(sample)

    if fits(CLOCK.match):
        return _time_of_day, True
    for form in DATES:
        if fits(lambda cell, form=form: _dated(cell, form) is not None):
            return partial(_stamp, form=form, since=next(day for cell in known if (day := _dated(cell, form)))), True
    for decimal, grouped in GROUPED.items():
        read = partial(_number, decimal=decimal)
        one = any(grouped.match(cell) and OTHER_SIGN[decimal] in cell for cell in known)
        if one and fits(lambda cell, read=read: not np.isnan(_or_nan(read, cell))):
            return read, False
    if fits(PLAIN.match):
        return partial(_number, decimal=""), False
    return None, False


def _number(cell: str, decimal: str) -> float:
    """A number with its thousands grouped, or with either sign of decimals where ``decimal`` is empty."""
    if not decimal:
        return float(cell.replace(",", "."))
    if OTHER_SIGN[decimal] in cell and not GROUPED[decimal].match(cell):
        raise ValueError(cell)
    return float(cell.replace(OTHER_SIGN[decimal], "").replace(decimal, "."))


def quantity(cell: str) -> tuple[float, str] | None:
    """Number and unit of a cell such as ``12.5 deg``."""
    match = QUANTITY.match(cell)
    unit = unit_of(match[2]) if match else ""
    return (float(match[1].replace(",", ".")), unit) if match and unit else None


def _time_of_day(cell: str) -> float:
    match = CLOCK.match(cell)
    if not match:
        raise ValueError(cell)
    hours = float(match["hours"] or 0)
    if match["half"]:
        hours = hours % 12 + 12 * (match["half"].lower() == "pm")
    of_day = 3600.0 * hours + 60.0 * float(match["minutes"]) + float(match["seconds"].replace(",", "."))
    return DAY * float(match["days"] or 0) + of_day


def _dated(cell: str, form: str) -> date | None:
    try:
        return datetime.strptime(re.split(r"[\sT]", cell, maxsplit=1)[0], form).date()
    except ValueError:
        return None


def _stamp(cell: str, form: str, since: date) -> float:
    """Seconds since a day began."""
    day, _, rest = cell.replace("T", " ").partition(" ")
    days = (datetime.strptime(day, form).date() - since).days
    return days * DAY + (_time_of_day(rest.strip()) if rest.strip() else 0.0)


def _across_midnight(seconds: Array) -> Array:
    """Times of day that run on past midnight."""
    steps = np.diff(seconds, prepend=seconds[:1])
    return seconds + DAY * np.cumsum(np.nan_to_num(steps) < -0.5 * DAY)
