"""Recordings of one folder whose columns have the same names, and different units."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..types import Array
from .column import span, taken, without_doubt
from .mapping import Question
from .names import said
from .recording import Recording
from .units import Read

PAIRS = {180.0 / math.pi: "deg and rad", 1e3: "mm and m"}
CLOCK_PAIRS = {1e3: "ms and s", 1e6: "us and s"}
"""Two units by their ratio."""
WITHIN = 1.8
"""Motions of two runs whose ratio is this near to one of two units may be in these."""
CLOCK_WITHIN = 1.3
"""The same of sample periods, which vary less than motions."""
MOVES = 10
"""Values that a column has at least in a run in which it moves."""


def differing_units(recordings: Sequence[Recording], columns: Mapping[str, Read]) -> list[Question]:
    """Questions on columns that look to be in another unit in one run than in another."""
    if len(recordings) < 2:
        return []
    found = []
    for name, read in columns.items():
        source = next(iter(taken(read.text, recordings[0])), None)
        if source is None:
            continue
        open_unit = not (without_doubt(recordings[0].units.get(source, "")) or said(source).unit)
        if name == "time":
            asked = _apart(recordings, source, _period, CLOCK_PAIRS, True)
        elif name.endswith(".position") and open_unit:
            asked = _apart(recordings, source, _motion, PAIRS, False)
        else:
            continue
        if asked:
            goal = f"{name.rpartition('.')[0]}.goal"
            found.append(Question((name, goal) if goal in columns else (name,), asked))
    return found


def _apart(
    recordings: Sequence[Recording],
    source: str,
    size: Callable[[Array], float],
    pairs: Mapping[float, str],
    clock: bool,
) -> str:
    """The question on one column; empty where the runs agree."""
    sizes = [(size(run.columns[source]), run.name) for run in recordings]
    sizes = [one for one in sizes if one[0] > 0.0]
    if len(sizes) < 2:
        return ""
    (low, low_run), (high, high_run) = min(sizes), max(sizes)
    near = math.log(CLOCK_WITHIN if clock else WITHIN)
    pair = next((pair for factor, pair in pairs.items() if abs(math.log(high / low / factor)) < near), None)
    if pair is None:
        return ""
    what = "has a sample each" if clock else "moves by"
    return (
        f"{source} {what} {high:.4g} in {high_run} and {low:.4g} in {low_run}: are these in {pair}? If so, import them "
        "one at a time, each in its unit; else remove this question"
    )


def _period(values: Array) -> float:
    steps = np.diff(values[np.isfinite(values)])
    return float(np.median(steps)) if len(steps) else 0.0


def _motion(values: Array) -> float:
    return span(values) if len(np.unique(values[np.isfinite(values)])) > MOVES else 0.0
