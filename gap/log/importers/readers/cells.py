"""Cells of foreign tables as numbers, by pandas: counts, stamps, times of day, dates, grouped thousands, lists."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, field
from decimal import Decimal
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from ...types import Array
from ..recording import LARGEST_EXACT, STRAY_SHARE
from ..units import unit_of

SECONDS_A_DAY = 86400.0  # [s]
MISSING = ("", "-", "--", "---", "nan", "null", "none", "n/a", "na", "inf", "-inf", "#n/a", "ovf")
NUMBER = r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?"
LIST = r"[\[(]\s*[-+]?[\d.][-+\d.eE,;\s]*[\])]"
"""Numbers in brackets, with commas or without."""
QUANTITY = re.compile(rf"({NUMBER})\s*([^\d\s.,;:+-]\S*)")
FORMULA = re.compile(r"[=@]\s*[\w+(-]")
"""What a spreadsheet would compute, or run: ``=A1*2``, ``=cmd|calc``."""
STAMP = r"(?:\d+ days? )?\d[\d.:/-]*[:/.-]\d[\dT :.,+-]*(?:Z|\s*[AaPp][Mm])?"
VALUE = re.compile("|".join((NUMBER, LIST, STAMP)))
"""How a number, a list of numbers, a date or a time is written."""
LONGEST_CELL = 300
"""Letters of a cell that may be a number, and of the name of a column."""
CELLS_LOOKED_AT = 1000
"""Cells of a column of text that tell how it is written."""


@dataclass
class Cells:
    """What a table holds: columns of numbers, why each other one is none, and what was read otherwise than it
    stands."""

    columns: dict[str, Array] = field(default_factory=dict)
    left: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def is_value(cell: str) -> bool:
    """Whether a cell of text may be a number, a list of numbers or a time."""
    text = cell.strip().strip("'\"")
    return bool(VALUE.fullmatch(text)) or text.lower() in (*MISSING[4:], "true", "false") or bool(quantity(text))


def quantity(cell: str) -> tuple[float, str] | None:
    """Number and unit of a cell such as ``12.5 deg``."""
    match = QUANTITY.fullmatch(cell)
    unit = unit_of(match[2]) if match else ""
    return (float(match[1].replace(",", ".")), unit) if match and unit else None


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
        out.columns[name] = _numbers(cells)
    elif isinstance(first, str):
        _take_text(name, cells.fillna("").astype(str).str.strip().str.strip("'\""), out)
    elif isinstance(first, dict):
        for key, own in pd.json_normalize([cell or {} for cell in cells]).items():
            _take(f"{name}.{key}", own, out)
    elif isinstance(first, list | tuple | np.ndarray):
        _take_lists(name, cells.tolist(), out)
    elif hasattr(first, "hour"):  # a time of day
        _take_text(name, cells.astype(str), out)
    else:
        out.left[name] = f"it holds {type(first).__name__} values, no numbers"


def _numbers(cells: Any) -> Array:
    """Numbers as float64; whole ones beyond its digits are counted from the first that is known."""
    known = cells.dropna()
    if cells.dtype.kind in "iuO" and any(
        isinstance(cell, int | np.integer) and abs(int(cell)) > LARGEST_EXACT for cell in known
    ):
        first = int(known.iloc[0])
        return np.array([np.nan if pd.isna(cell) else float(int(cell) - first) for cell in cells])
    return np.array([np.nan if cell is None else cell for cell in cells.tolist()], np.float64)


def _take_lists(name: str, rows: list[Any], out: Cells) -> None:
    """The places of lists that are all equally long and hold numbers; none else."""
    try:
        matrix = np.array([np.asarray(row) for row in rows])
    except ValueError:
        matrix = np.zeros((0, 0), object)
    if matrix.ndim != 2 or matrix.dtype.kind not in "iufb":
        out.left[name] = "lists of different lengths, or not of numbers"
        return
    for place, column in enumerate(matrix.T):
        out.columns[f"{name}[{place}]"] = _numbers(pd.Series(column))


# --- text ------------------------------------------------------------------------------------------------------------


def _take_text(name: str, cells: Any, out: Cells) -> None:
    """A column of text: numbers and times that are written in an unusual way, or the reason why it is left out."""
    low = cells.str.lower()
    there, cells = ~low.isin(MISSING), cells.mask(low == "true", "1").mask(low == "false", "0")
    known: Any = cells[there]
    plain: Any = pd.to_numeric(cells, errors="coerce")
    if not len(known) or cells.str.len().max() > LONGEST_CELL:
        out.left[name] = "it holds long words, no numbers" if len(known) else "it is empty"
        return
    if plain[there].notna().all():
        out.columns[name] = _numbers(plain)
        return
    if cells.str.fullmatch(LIST).all():
        _take_lists(name, [[float(part) for part in re.split(r"[,;\s]+", cell[1:-1].strip())] for cell in cells], out)
        return
    sizes = [quantity(cell) for cell in known]
    if units := {size[1] for size in sizes if size} if all(sizes) else set():
        name = f"{name} [{units.pop()}]" if len(units) == 1 else name
        known = pd.Series([str(size[0]) for size in sizes if size], known.index)
    if formula := next((cell for cell in known if FORMULA.match(cell)), ""):
        out.notes.append(
            f"{name} has formulas of a spreadsheet, which are not computed ({formula[:20]!r}): export values"
        )
    values, seconds = _read(known)
    if values is None:
        words = list(dict.fromkeys(known[:CELLS_LOOKED_AT]))
        named = ", ".join(repr(word[:20]) for word in words[:3]) + ", ..." * (len(words) > 3)
        computed = f"formulas of a spreadsheet, which are not computed: export values ({formula[:20]!r})"
        out.left[name] = f"it holds {computed if formula else f'text, no numbers: {named}'}"
        return
    if len(odd := known[values.isna()]):
        cells_are = f"{len(odd)} cells of {name} are" if len(odd) > 1 else f"1 cell of {name} is"
        out.notes.append(f"{cells_are} no number and read as no value, the first {odd.iloc[0][:20]!r}")
    whole = values.reindex(cells.index).to_numpy(np.float64)
    out.columns[f"{name}_s" if seconds else name] = _across_midnight(whole) if seconds else whole


def _read(known: Any) -> tuple[Any, bool]:
    """Numbers of nearly all cells of a column, and whether these are seconds; None where they are none."""
    sample = known.iloc[:: max(len(known) // CELLS_LOOKED_AT, 1)]
    readers = [(_number, False), (_duration, True)]
    if sample.str.contains(":").mean() >= 1.0 - STRAY_SHARE:
        readers += [(partial(_stamp, dayfirst=dayfirst), True) for dayfirst in (False, True)]
    for reader, seconds in readers:
        if reader(sample).notna().mean() >= 1.0 - STRAY_SHARE:
            return reader(known), seconds
    return None, False


def _number(cells: Any) -> Any:
    """Numbers with decimals behind either sign."""
    plain = cells.where(cells.str.fullmatch(NUMBER))
    return pd.to_numeric(plain.str.replace(",", ".", regex=False), errors="coerce")


def _duration(cells: Any) -> Any:
    """Seconds of times of day and of durations: ``12:00:00.01``, ``00.01`` behind minutes, ``1 days 12:00:00``."""
    whole = cells.str.replace(",", ".", regex=False).str.replace(r"^(\d{1,2}:\d{1,2}(?:\.\d+)?)$", r"00:\1", regex=True)
    return pd.to_timedelta(whole.where(whole.str.contains(":")), errors="coerce").dt.total_seconds()


def _stamp(cells: Any, dayfirst: bool) -> Any:
    """Seconds of times and of dates with a time, all written as the first is, since the first of the days."""
    plain = cells.str.replace(",", ".", regex=False)
    with warnings.catch_warnings(action="ignore"):  # of words that are no dates
        found = pd.to_datetime(plain, errors="coerce", dayfirst=dayfirst, utc=True)
    return (found - found.dt.normalize().min()).dt.total_seconds()


def _across_midnight(seconds: Array) -> Array:
    """Times of day that run on past midnight."""
    steps = np.diff(seconds, prepend=seconds[:1])
    return seconds + SECONDS_A_DAY * np.cumsum(np.nan_to_num(steps) < -0.5 * SECONDS_A_DAY)
