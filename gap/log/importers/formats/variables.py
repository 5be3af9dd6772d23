"""Variables of a file by their names: vectors become columns, single numbers facts, a cell or structure a run, runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...types import Array, LogError
from ..evidence import clock_units
from ..names import said
from ..recording import Recording
from .structures import flatten, is_list, parted, spread

HELD = frozenset(["goal", "goal_velocity", "torque_command"])
"""Signals that hold until the next one is sent."""
WORDS = "it holds text, no numbers"


def recordings_of(path: Path, kind: str, content: Mapping[str, Any]) -> list[Recording]:
    """The recordings that variables make: their vectors of one length; those of other lengths are left out and said.

    Args:
        path: file that holds them.
        kind: of the file.
        content: arrays, numbers, words, structures with ``_fieldnames`` and arrays of arrays by name; None where
            what the file holds is none of these.

    Raises:
        LogError: there are no vectors.
    """
    flat: dict[str, Any] = {}
    for name, value in content.items():
        flatten(name, value, flat)
    parts, notes = parted(flat)
    return [
        recording_of(path, kind, spread(run), name, notes)
        for part, own in parts.items()
        for name, run in _runs(spread(own), f"{path.stem}-{part}" if part else path.stem).items()
    ]


def _runs(content: Mapping[str, Any], stem: str) -> dict[str, dict[str, Any]]:
    """The variables of each run by its name: one run, or as many as cells or arrays of structures have places.

    What is the same for all runs is in each of them. A name that an array of structures has says nothing of a joint.
    """
    several = {name: value for name, value in content.items() if _has_runs(value)}
    if not several:
        return {stem: dict(content)}
    counts = [len(value) for value in several.values()]
    count = max(set(counts), key=lambda n: (counts.count(n), n))
    runs: dict[str, dict[str, Any]] = {}
    for k in range(count):
        own = {name: value for name, value in content.items() if name not in several}
        for name, value in several.items():
            if len(value) == count:
                fields: dict[str, Any] = {}
                flatten(name, value[k], fields)
                short = {key.removeprefix(f"{name}."): held for key, held in fields.items()}
                own |= fields if short.keys() & own.keys() else short
        runs[f"{stem}-{k + 1:0{len(str(count))}}"] = own
    return runs


def _has_runs(value: Any) -> bool:
    """Whether a variable is a cell of arrays, or an array of structures: one for each run."""
    return (
        is_list(value)
        and all(hasattr(one, "_fieldnames") or (isinstance(one, np.ndarray) and one.size > 1) for one in value)
        and not any(isinstance(one, np.ndarray) and one.dtype.kind in "US" for one in value)
    )


def recording_of(
    path: Path, kind: str, content: Mapping[str, Any], name: str, notes: tuple[str, ...] = ()
) -> Recording:
    """The one recording that variables of a run make, with what is said of it already.

    Raises:
        LogError: there are no vectors.
    """
    columns: dict[str, Array] = {}
    facts: dict[str, float | str] = {}
    left: dict[str, str] = {}
    words = {key: list(map(str, value)) for key, value in content.items() if _is_words(value)}
    for key, value in content.items():
        if key not in words:
            _collect(key, value, [*words.values()], columns, facts, left)
    if not columns:
        why = next((f" ({key}: {reason})" for key, reason in left.items()), "")
        raise LogError(f"{path}: has no vectors of numbers{why}; a log is one vector for each signal and one of time.")
    lengths = [len(values) for values in columns.values()]
    length = max(set(lengths), key=lambda n: (lengths.count(n), n))
    columns, of_held = _held_goals(columns, length)
    notes = (*notes, *of_held)
    other = sorted(key for key, values in columns.items() if len(values) != length)
    if other:
        notes = (*notes, f"left out, for they do not have {length} samples: {', '.join(other)}")
    kept = {key: values for key, values in columns.items() if len(values) == length}
    left |= dict.fromkeys(words, WORDS)
    return Recording(name, kept, path, kind, facts, notes=notes, left=left)


def _held_goals(columns: dict[str, Array], length: int) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Goals with a clock of their own, each held until the next at the times of the other columns, and notes on them.

    Args:
        columns: by name; those of a structure have its name before a point.
        length: of the columns that the recording is made of.
    """
    fields = {key: key.rpartition(".")[::2] for key in columns}
    clocks = {key: columns[key] for key, (_, own) in fields.items() if said(own).signal == "time"}
    clocks = {key: values for key, values in clocks.items() if clock_units(values)}
    at = next((values for values in clocks.values() if len(values) == length), None)
    out, notes = dict(columns), ()
    for key, time in clocks.items():
        above = fields[key][0]
        if at is None or len(time) == length or not above or time[0] > at[-1] or time[-1] < at[0]:
            continue
        beside = [name for name in columns if name != key and fields[name][0] == above]
        if not beside or any(said(name).signal not in HELD or len(columns[name]) != len(time) for name in beside):
            continue
        before = np.searchsorted(time, at, side="right") - 1
        out |= {name: np.where(before >= 0, columns[name][before], np.nan) for name in beside}
        del out[key]
        notes = (*notes, f"each sample of {', '.join(beside)} is held until its next one, by its own clock {key}")
    return out, notes


def _is_words(value: Any) -> bool:
    """Whether a variable is a list of words: a cell of text, or a matrix of letters."""
    return (
        isinstance(value, np.ndarray)
        and value.ndim == 1
        and len(value) > 1
        and value.dtype.kind in "UO"
        and all(isinstance(one, str) for one in value)
    )


def _collect(
    name: str,
    value: Any,
    names: Sequence[Sequence[str]],
    columns: dict[str, Array],
    facts: dict[str, float | str],
    left: dict[str, str],
) -> None:
    """Put a variable where it belongs; columns of a matrix by the one list of words that is as long, else by number."""
    if value is None:
        left[name] = "no vector or matrix of numbers"
        return
    if isinstance(value, str):
        facts[name] = value
        return
    if np.iscomplexobj(value):
        left[name] = "complex numbers, where a log has real ones"
        return
    try:
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        left[name] = "no numbers, or vectors of several lengths"
        return
    if array.ndim == 0:
        facts[name] = float(array)
    elif array.ndim == 1 and len(array) > 1:
        columns[name] = array
    elif array.ndim == 2 and array.size:
        rows = array if array.shape[0] >= array.shape[1] else array.T
        places = _places(name, rows.shape[1], names)
        columns |= {place: rows[:, k].copy() for k, place in enumerate(places)}


def _places(name: str, count: int, names: Sequence[Sequence[str]]) -> list[str]:
    """Names of the columns of a matrix."""
    alike = {tuple(words) for words in names if len(words) == count and len(set(words)) == count}
    if len(alike) == 1:
        return [f"{word}.{name}" for word in next(iter(alike))]
    return [f"{name}[{place}]" for place in range(count)]
