"""Variables of a file by their names: vectors become columns, single numbers facts, a cell or structure a run, runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...types import Array, LogError
from ..recording import Recording
from .structures import flatten, is_list, parted, spread

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


def recording_of(path: Path, kind: str, content: Mapping[str, Any], name: str, said: tuple[str, ...] = ()) -> Recording:
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
    other = sorted(key for key, values in columns.items() if len(values) != length)
    notes = (*said, f"left out, for they do not have {length} samples: {', '.join(other)}") if other else said
    kept = {key: values for key, values in columns.items() if len(values) == length}
    left |= dict.fromkeys(words, WORDS)
    return Recording(name, kept, path, kind, facts, notes=notes, left=left)


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
