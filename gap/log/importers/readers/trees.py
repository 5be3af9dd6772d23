"""Nested variables as recordings: vectors become columns, single numbers facts, structures joints, signals or runs.

A structure is a mapping, an array of them a list of mappings, a cell a list of arrays.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...types import Array, LogError
from ..clocks import clock_units, together
from ..names import is_a, said
from ..recording import Recording

PREFIX = re.compile(r"(.*?\d+)_(.+)")
"""``run1_t``: a name with its number, and the name of what is its own."""
FEWEST_SERIES = 2
"""Series beside its clock that a run has at least: one alone is a signal with its stamps."""
OF_A_SIGNAL = frozenset(["values", "dimensions", "label", "title", "plotStyle", "blockName", "stateName",
                         "inReferencedModel", "sampleTime", "valueDimensions"])  # fmt: skip
"""Fields that Simulink gives a signal."""

Tree = Mapping[str, Any]


def recordings_of(path: Path, kind: str, content: Tree) -> list[Recording]:
    """The recordings that variables make: their vectors of one length; those of other lengths are left out and said.

    Args:
        path: file that holds them.
        kind: of the file.
        content: arrays, numbers, words, mappings and lists of these by name; None where what the file holds is none of
            these.

    Raises:
        LogError: there are no vectors.
    """
    places: dict[str, str] = {}
    flat = _flat(_by_cells(content, places), places)
    runs, notes = _runs(flat, places)
    return [
        _recording(path, kind, own, f"{path.stem}-{name}" if name else path.stem, notes) for name, own in runs.items()
    ]


# --- structures ------------------------------------------------------------------------------------------------------


def _flat(content: Tree, places: dict[str, str], above: str = "", whole: Tree | None = None) -> dict[str, Any]:
    """Variables, those of structures by their dotted names; a signal of Simulink is its values.

    The structures of an array are called by their labels, or by their number.

    Args:
        content: the variables.
        places: takes the number of each structure of an array by its dotted name.
        above: what the names begin with.
        whole: variables that all of them lie in; None: these.
    """
    out: dict[str, Any] = {}
    whole = content if whole is None else whole
    for key, value in content.items():
        name = f"{above}{key}"
        if _is_signal(value):
            out[_label(value) or name] = np.squeeze(value["values"])
        elif isinstance(value, Mapping):
            out |= _flat(value, places, f"{name}.", whole)
        elif not is_structures(value):
            out[name] = value
        else:
            labels = [_label(one) for one in value]
            taken = {one.partition(".")[0] for one in (*whole, *out)}
            alone = all(map(_is_signal, value))  # and no structure with several
            if len({*labels} - {""} - taken) < len(labels):
                labels = [f"{name.replace('.', '_') if alone else name}{k + 1}" for k in range(len(value))]
            for k, (label, one) in enumerate(zip(labels, value, strict=True)):
                places[label] = f"{k + 1:0{len(str(len(value)))}}"
                own = {key: field for key, field in one.items() if key != "name"}
                out |= (
                    _flat({label: one | {"label": label}}, places) if alone else _flat(own, places, f"{label}.", whole)
                )
    return out


def _by_cells(content: Tree, places: dict[str, str]) -> Tree:
    """Variables in which cells of arrays, of which each has a place for a run, are structures of these runs."""
    lists = {name: value for name, value in content.items() if isinstance(value, list) and value}
    cells = {name: value for name, value in lists.items()
             if all(isinstance(one, np.ndarray) and one.size > 1 for one in value)}  # fmt: skip
    counts = [len(value) for value in cells.values()]
    count = max(set(counts), key=lambda n: (counts.count(n), n), default=1)
    if count < 2:
        return content
    runs = [{name: value[k] for name, value in cells.items() if len(value) == count} for k in range(count)]
    return {name: value for name, value in content.items() if name not in cells} | {"run": runs}


def _is_signal(value: Any) -> bool:
    return isinstance(value, Mapping) and "values" in value and not value.keys() - OF_A_SIGNAL


def _label(value: Tree) -> str:
    """What a structure calls itself, as a column may be called."""
    word = next((value[key] for key in ("label", "name") if isinstance(value.get(key), str)), "")
    return re.sub(r"\W+", "_", word.strip()).strip("_")


def is_structures(value: Any) -> bool:
    """Whether a variable is an array of structures."""
    return isinstance(value, list) and bool(value) and all(isinstance(one, Mapping) for one in value)


def _words(name: str) -> set[str]:
    return set(re.findall("[a-z]+", re.sub("(?<=[a-z])(?=[A-Z])", " ", name).lower()))


def _is_vector(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.ndim == 1 and len(value) > 1 and value.dtype.kind in "fiu"


# --- runs ------------------------------------------------------------------------------------------------------------


def _runs(flat: Tree, places: Mapping[str, str]) -> tuple[dict[str, dict[str, Any]], tuple[str, ...]]:
    """Variables of each run by its name, where structures or prefixes are a run each, else all under an empty name; and
    notes on what they were taken for. What stands beside the runs is in each of them."""
    paths = {name: _path(name) for name in flat}
    for above in sorted({path[:k] for path in paths.values() for k in range(len(path) - 1)}, key=len):
        children: dict[str, dict[str, Any]] = {}
        owner: dict[str, str] = {}
        for name, path in paths.items():
            if path[: len(above)] == above and len(path) > len(above) + 1:
                owner[name] = child = path[len(above)]
                own = name[len("".join(path[: len(above) + 1])) + len(above) + 1 :]
                children.setdefault(child, {})[own] = flat[name]
        rest = {name: value for name, value in flat.items() if name not in owner}
        number = {child: places.get(".".join((*above, child)), "") for child in children}
        runs, note = _siblings(children, above[-1] if above else "", number, rest)
        if runs:
            shared = {name: value for name, value in flat.items() if owner.get(name) not in runs}
            taken = any(own.keys() & shared.keys() for own in runs.values())
            order = sorted(runs, key=lambda name: (len(name), name)) if _numbered(runs) else list(runs)
            return {
                number[run] or run: shared
                | {f"run.{name}" if taken else name: value for name, value in runs[run].items()}
                for run in order
            }, (note,) * bool(note)
        if note:
            return {"": dict(flat)}, (note,)
    return {"": dict(flat)}, ()


def _path(name: str) -> tuple[str, ...]:
    """Parts of a name: those of structures, and at its end a number's prefix."""
    *above, last = name.split(".")
    match = PREFIX.fullmatch(last)
    return (*above, match[1], match[2]) if match else (*above, last)


def _numbered(names: Any) -> bool:
    return len({re.sub(r"[_-]?\d+\Z", "", name) for name in names}) == 1 and all(name[-1:].isdigit() for name in names)


def _siblings(
    children: dict[str, dict[str, Any]], above: str, number: Mapping[str, str], rest: Tree
) -> tuple[dict[str, dict[str, Any]], str]:
    """Those of the variables that lie side by side which are a run each, and a note on what they are taken for.

    They are called so, or have a clock each, or are numbered and of different lengths, or are an array without a clock.
    Several joints may have a clock each, too: of one recording where all clocks are the same.

    Args:
        children: variables by what lies side by side.
        above: name of the structure that they lie in.
        number: of each child in its array; empty where it is in none.
        rest: variables that lie elsewhere.
    """
    forms: dict[frozenset[str], list[str]] = {}
    for name, own in children.items():
        if sum(map(_series, own.values())) >= FEWEST_SERIES and not said(name).signal:
            forms.setdefault(frozenset(key for key, value in own.items() if _series(value)), []).append(name)
    alike = max(forms.values(), key=len, default=[])
    listed = all(number[name] for name in alike)
    clocks = [clock for name in alike if (clock := _clock(children[name])) is not None]
    timed = len(clocks) == len(alike) and all(
        sum(map(_series, children[name].values())) > FEWEST_SERIES for name in alike
    )
    joints = any(is_a("joints", *_words(name)) for name in (above, *alike))
    logs = {"log", "logs"} if joints or not all(name[-1:].isdigit() for name in alike) else set()
    plural = is_a("runs", *(one for one in _words(above) - {"logs"} if one.endswith("s")))
    called = all(is_a("runs", *(_words(name) - logs)) for name in alike) or (plural and timed)
    lengths = {tuple(len(value) for value in children[name].values() if _series(value)) for name in alike}
    called |= (_numbered(alike) and len(lengths) > 1) or (listed and not joints and not clocks and _clock(rest) is None)
    if len(alike) < 2 or not (called or timed):
        return {}, ""
    names = ", ".join(alike[:3]) + ", ..." * (len(alike) > 3)
    same = bool(clocks) and (all(np.array_equal(one, clocks[0]) for one in clocks) or together(clocks))
    if same and not called and (joints or not listed):
        note = f"{names} were recorded at one time, by their clocks, and are taken for joints of one recording"
        return {}, "" if joints else note
    stems = {name.rstrip("0123456789") for name in alike} - {""}
    runs = {name: own for name, own in children.items()
            if name in alike or (name.rstrip("0123456789") in stems and _clock(own) is not None)}  # fmt: skip
    return runs, "" if called else f"{names} have a clock each and are taken for a recording each"


def _clock(variables: Tree) -> Array | None:
    """The vector that is called as a clock and runs as one."""
    named = (value for key, value in variables.items() if _is_vector(value) and _is_clock(key))
    return next((clock for clock in named if clock_units(np.asarray(clock, np.float64))), None)


def _series(value: Any) -> int:
    """Columns that a variable makes, at least."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub" or value.size < 2:
        return 0
    return min(value.shape) if value.ndim == 2 else 1


# --- one recording ---------------------------------------------------------------------------------------------------


def _recording(path: Path, kind: str, content: Tree, name: str, notes: tuple[str, ...]) -> Recording:
    """The one recording that variables of a run make, with what is said of it already.

    Raises:
        LogError: there are no vectors.
    """
    columns: dict[str, Array] = {}
    facts: dict[str, float | str] = {}
    left: dict[str, str] = {}
    words = [value for value in content.values() if _is_words(value)]
    for key, value in content.items():
        if isinstance(value, str):
            facts[key] = value
        elif why := _collect(key, value, words, columns, facts):
            left[key] = why
    if not columns:
        why = next((f" ({key}: {reason})" for key, reason in left.items()), "")
        raise LogError(f"{path}: has no vectors of numbers{why}; a log is one vector for each signal and one of time.")
    lengths = [len(values) for values in columns.values()]
    length = max(set(lengths), key=lambda n: (lengths.count(n), n))
    other = sorted(key for key, values in columns.items() if len(values) != length)
    of_other = (f"left out, for they do not have {length} samples: {', '.join(other)}",) * bool(other)
    kept = {key: values for key, values in columns.items() if len(values) == length}
    clocks = [key for key, values in kept.items() if "." in key and _is_clock(key) and clock_units(values)]
    for key in clocks[1:]:  # a name such as pos.Time would make it a position
        left[key] = f"the clock {clocks[0]}" if np.array_equal(kept[key], kept[clocks[0]]) else "another clock"
        del kept[key]
    roles = dict.fromkeys(clocks[:1], "time")
    return Recording(name, kept, path, kind, facts, roles, (*notes, *of_other), left=left)


def _is_clock(name: str) -> bool:
    return said(name.rpartition(".")[2]).signal == "time"


def _is_words(value: Any) -> bool:
    """Whether a variable is a list of words: a cell of text, or a matrix of letters."""
    return isinstance(value, list) and len(value) > 1 and all(isinstance(one, str) for one in value)


def _collect(
    name: str, value: Any, names: Sequence[Sequence[str]], columns: dict[str, Array], facts: dict[str, float | str]
) -> str:
    """Put a variable where it belongs, columns of a matrix by the one list of words that is as long, else by number;
    why it is none of numbers, else empty."""
    if value is None:
        return "no vector or matrix of numbers"
    if _is_words(value):
        return "it holds text, no numbers"
    if np.iscomplexobj(value):
        return "complex numbers, where a log has real ones"
    try:
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        return "no numbers, or vectors of several lengths"
    if array.ndim == 0:
        facts[name] = float(array)
    elif array.ndim == 1 and len(array) > 1:
        columns[name] = array
    elif array.ndim == 2 and array.size:
        rows = array if array.shape[0] >= array.shape[1] else array.T
        alike = {tuple(words) for words in names if len(words) == rows.shape[1] == len(set(words))}
        called = (
            [f"{word}.{name}" for word in alike.pop()]
            if len(alike) == 1
            else [f"{name}[{k}]" for k in range(rows.shape[1])]
        )
        columns |= {label: rows[:, k].copy() for k, label in enumerate(called)}
    return ""
