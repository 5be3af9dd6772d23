"""Cells of foreign tables as numbers: large counts, stamps, times of day, dates, grouped thousands, lists."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from decimal import Decimal
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from ...types import Array
from ..units import unit_of

EXACT = 2**53
"""Whole numbers beyond this one are not exact as float64."""
DAY = 86400.0  # [s]
STRAY = 0.02
"""Share of cells that may be no number in a column of numbers."""
MISSING = frozenset(["", "-", "--", "---", "nan", "null", "none", "n/a", "na", "inf", "-inf", "#n/a", "ovf"])
PLAIN = re.compile(r"[-+]?(\d+[.,]?\d*|[.,]\d+)([eE][-+]?\d+)?\Z")
LIST = re.compile(r"[\[(]\s*[-+]?[\d.][-+\d.eE,;\s]*[\])]\Z")
"""Numbers in brackets, with commas or without."""
GROUPED = {
    ",": re.compile(r"[-+]?[1-9]\d{0,2}(\.\d{3})+(,\d*)?\Z"),
    ".": re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?\Z"),
}
"""Numbers with grouped thousands, by the sign of their decimals."""
QUANTITY = re.compile(r"([-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?)\s*([^\d\s.,;:+-]\S*)\Z")
FORMULA = re.compile(r"[=@]\s*[\w+(-]")
"""What a spreadsheet would compute, or run: ``=A1*2``, ``=cmd|calc``."""
CLOCK = re.compile(
    r"(?:(?P<days>\d+) days? )?(?:(?P<hours>\d{1,3}):)?(?P<minutes>\d{1,2}):(?P<seconds>\d{1,2}(?:[.,]\d+)?)"
    r"\s*(?P<half>[AaPp][Mm])?\Z"
)
DATED = re.compile(
    r"(?P<day>\d{1,4}[-./]\d{1,2}[-./]\d{1,4})(?:[T ]+(?P<clock>\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d+)?)?\s*(?:[AaPp][Mm])?)"
    r"(?:Z|[-+]\d\d:?\d\d)?)?\Z"
)
DATES = ("%d.%m.%Y", "%Y/%m/%d", "%Y-%m-%d", "%m/%d/%Y", "%d/%m/%Y", "%d-%m-%Y", "%d.%m.%y", "%m/%d/%y")
LONGEST_CELL = 300
"""Letters of a cell that may be a number, and of the name of a column."""
LOOKED_AT = 1000
"""Cells of a column of text that tell how it is written."""


@dataclass
class Cells:
    """What a table holds: columns of numbers, why each other one is none, and what was read otherwise than it
    stands."""

    columns: dict[str, Array] = field(default_factory=dict)
    left: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def numeric_columns(frame: pd.DataFrame) -> Cells:
    """Columns that hold numbers, and why the others do not.

    Lists of a fixed length become one column for each place, ``state[0]``; stamps and times of day become seconds,
    ``stamp_s``; counts that float64 cannot hold are counted from the first one.
    """
    out = Cells()
    for name in map(str, frame.columns):
        if len(name) > LONGEST_CELL:
            out.left[name[:40]] = f"its name has {len(name)} letters"
        else:
            _take(name, frame[name], out)
    return out


def _take(name: str, cells: Any, out: Cells) -> None:
    """Put a column where it belongs."""
    kind, known = cells.dtype.kind, cells.dropna()
    first = known.iloc[0] if len(known) else None
    if first is None:
        out.left[name] = "it is empty"
    elif kind in "Mm":
        since = cells - first if kind == "M" else cells
        out.columns[f"{name}_s"] = since.dt.total_seconds().to_numpy(np.float64)
    elif kind in "iufb" or isinstance(first, Decimal | bool | int | float | np.number):
        out.columns[name] = _numbers(cells, known)
    elif isinstance(first, str):
        _take_text(name, ["" if pd.isna(cell) else str(cell).strip().strip("'\"") for cell in cells], out)
    elif isinstance(first, dict):
        for key, own in pd.json_normalize([cell or {} for cell in cells]).items():
            _take(f"{name}.{key}", own, out)
    elif isinstance(first, list | tuple | np.ndarray):
        _take_lists(name, cells.tolist(), out)
    elif hasattr(first, "hour"):  # a time of day
        out.columns[f"{name}_s"] = _across_midnight(np.array([_time_of_day(str(cell)) for cell in cells]))
    else:
        out.left[name] = f"it holds {type(first).__name__} values, no numbers"


def _numbers(cells: pd.Series, known: pd.Series) -> Array:
    """Numbers as float64; whole ones beyond its digits are counted from the first that is known."""
    if cells.dtype.kind in "iuO" and any(
        isinstance(cell, int | np.integer) and abs(int(cell)) > EXACT for cell in known
    ):
        first = int(known.iloc[0])
        return np.array([np.nan if pd.isna(cell) else float(int(cell) - first) for cell in cells])
    return np.array([np.nan if cell is None else cell for cell in cells.tolist()], np.float64)


def _take_lists(name: str, rows: Sequence[Any], out: Cells) -> None:
    """The places of lists that are all equally long and hold numbers; none else."""
    try:
        matrix = np.array([np.asarray(row) for row in rows])
    except ValueError:
        matrix = np.zeros((0, 0), object)
    if matrix.ndim != 2 or matrix.dtype.kind not in "iufb":
        out.left[name] = "lists of different lengths, or not of numbers"
        return
    for place, column in enumerate(matrix.T):
        out.columns[f"{name}[{place}]"] = _numbers(pd.Series(column), pd.Series(column))


# --- text ------------------------------------------------------------------------------------------------------------


def _take_text(name: str, cells: Sequence[str], out: Cells) -> None:
    """A column of text: numbers and times that are written in an unusual way, or the reason why it is left out."""
    known = [cell for cell in cells if cell.lower() not in MISSING]
    if not known or max(map(len, cells)) > LONGEST_CELL:
        out.left[name] = "it holds long words, no numbers" if known else "it is empty"
        return
    if all(map(LIST.match, cells)):
        _take_lists(name, [[float(part) for part in re.split(r"[,;\s]+", cell[1:-1].strip())] for cell in cells], out)
        return
    units = {found[1] if (found := quantity(cell)) else "" for cell in known}
    if len(units) == 1 and "" not in units:
        out.columns[f"{name} [{units.pop()}]"] = np.array([(quantity(cell) or (np.nan,))[0] for cell in cells])
        return
    reader, seconds = _reader(known)
    if formula := next((cell for cell in known if FORMULA.match(cell)), ""):
        out.notes.append(
            f"{name} has formulas of a spreadsheet, which are not computed ({formula[:20]!r}): export values"
        )
    if reader is None and formula:
        out.left[name] = f"it holds formulas of a spreadsheet, which are not computed: export values ({formula[:20]!r})"
        return
    if reader is None:
        words = list(dict.fromkeys(known[:LOOKED_AT]))
        named = ", ".join(repr(word[:20]) for word in words[:3]) + ", ..." * (len(words) > 3)
        out.left[name] = f"it holds text, no numbers: {named}"
        return
    values = np.array([_or_nan(reader, cell) for cell in cells])
    if odd := [cell for cell in known if np.isnan(_or_nan(reader, cell))]:
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

    def fits(reader: Callable[[str], float]) -> bool:
        return sum(not np.isnan(_or_nan(reader, cell)) for cell in sample) >= (1.0 - STRAY) * len(sample)

    if fits(_time_of_day):
        return _time_of_day, True
    for form in DATES if DATED.match(sample[0]) else ():
        stamp = lambda cell, form=form: _stamp(cell, form)  # noqa: E731
        if fits(stamp):
            since = DAY * (min(_or_nan(stamp, cell) for cell in sample) // DAY)
            return partial(_stamp, form=form, since=since), True
    for decimal, grouped in GROUPED.items():
        number = lambda cell, decimal=decimal: _number(cell, decimal)  # noqa: E731
        other = "." if decimal == "," else ","
        if any(grouped.match(cell) and other in cell for cell in known) and fits(number):
            return number, False
    plain = lambda cell: float(cell.replace(",", ".")) if PLAIN.match(cell) else np.nan  # noqa: E731
    return (plain, False) if fits(plain) else (None, False)


def _number(cell: str, decimal: str) -> float:
    """A number with its thousands grouped."""
    other = "." if decimal == "," else ","
    if other in cell and not GROUPED[decimal].match(cell):
        raise ValueError(cell)
    return float(cell.replace(other, "").replace(decimal, "."))


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


def _stamp(cell: str, form: str, since: float = 0.0) -> float:
    """Seconds of a date with a time of day, since 1970 or later."""
    match = DATED.match(cell)
    if not match:
        raise ValueError(cell)
    days = datetime.strptime(match["day"], form).toordinal() - datetime(1970, 1, 1).toordinal()
    return days * DAY - since + (_time_of_day(match["clock"].strip()) if match["clock"] else 0.0)


def _across_midnight(seconds: Array) -> Array:
    """Times of day that run on past midnight."""
    steps = np.diff(seconds, prepend=seconds[:1])
    return seconds + DAY * np.cumsum(np.nan_to_num(steps) < -0.5 * DAY)
