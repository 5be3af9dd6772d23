"""Structures of a file and arrays of them: of a joint or a signal each, which are columns, and else of a run each.

Structures side by side, and numbered prefixes (``run1_t``), are a run each where each has a clock of its own.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..evidence import clock_units
from ..names import said
from ..per_joint import together
from .long_form import JOINT

JOINTS = (JOINT - {"name", "id"}) | {"axes", "motors", "servos", "actuators", "drive", "drives", "leg", "legs", "arm",
                                     "arms", "gelenke"}  # fmt: skip
"""Words for an array of structures that are a joint each."""
RUNS = frozenset(["run", "runs", "trial", "trials", "episode", "episodes", "test", "tests", "experiment", "experiments",
                  "demo", "demos", "rollout", "rollouts", "recording", "recordings", "rec", "log", "logs", "exp",
                  "ep", "seq", "sequence", "traj", "trajectory", "measurement"])  # fmt: skip
"""Words for structures that are a run each, though the runs may have one clock."""
WEAK = frozenset(["log", "logs"])
"""Those that may also be of a joint, as in ``servoLog``."""
PREFIX = re.compile(r"(.*?\d+)_(.+)")
"""``run1_t``: a name with its number, and the name of what is its own."""
LEAST = 2
"""Series beside its clock that a run has at least: one alone is a signal with its stamps."""
OF_A_SIGNAL = frozenset(["values", "dimensions", "label", "title", "plotStyle", "blockName", "stateName",
                         "inReferencedModel", "sampleTime", "valueDimensions"])  # fmt: skip
"""Fields that Simulink gives a signal."""


def flatten(name: str, value: Any, flat: dict[str, Any]) -> None:
    """Put a variable among the others; fields of a structure by their own names."""
    if not hasattr(value, "_fieldnames"):
        flat[name] = value
    elif _is_signal(value):
        _put_signal(name, value, 1, flat)
    else:
        for key in value._fieldnames:
            flatten(f"{name}.{key}", getattr(value, key), flat)


def spread(content: Mapping[str, Any]) -> dict[str, Any]:
    """Variables in which each array of structures that is no array of runs has become columns of one recording.

    Signals of Simulink (``simout.signals(k).values``) are called by their labels, joints by their number, or by their
    field ``name``.
    """
    out = {name: value for name, value in content.items() if not is_structures(value)}
    for name, value in content.items():
        if name in out:
            continue
        if all(map(_is_signal, value)):
            for k, one in enumerate(value):
                _put_signal(name, one, k + 1, out)
        elif _are_joints(name, value, content):
            inner = _by_label(_labels(name, value), value)
            if inner.keys() & out.keys():  # another array has joints of these names
                inner = _by_label([f"{name}{k + 1}" for k in range(len(value))], value)
            out |= spread(inner)
        else:
            out[name] = value
    return out


def _by_label(labels: Sequence[str], value: Sequence[Any]) -> dict[str, Any]:
    """Fields of structures behind a label for each."""
    out: dict[str, Any] = {}
    for label, one in zip(labels, value, strict=True):
        flatten(label, one, out)
    return out


def is_structures(value: Any) -> bool:
    """Whether a variable is an array of structures."""
    return is_list(value) and all(hasattr(one, "_fieldnames") for one in value)


def is_list(value: Any) -> bool:
    """Whether a variable is a list of several things: a cell, or an array of structures."""
    return isinstance(value, np.ndarray) and value.dtype == object and value.ndim == 1 and len(value) > 1


def _is_signal(value: Any) -> bool:
    """Whether a structure is a signal of Simulink's ``Structure With Time``."""
    fields = set(value._fieldnames)
    return "values" in fields and bool({"label", "dimensions"} & fields) and fields <= OF_A_SIGNAL


def _put_signal(name: str, signal: Any, number: int, flat: dict[str, Any]) -> None:
    """Put the values of a signal among the variables, by its label where it has one."""
    label = getattr(signal, "label", "")
    own = label.strip() if isinstance(label, str) and label.strip() else f"signal{number}"
    block = name.removesuffix(".signals")
    free = next(one for one in (own, f"{block}.{own}", f"{block}.signal{number}.{own}") if one not in flat)
    flat[free] = signal.values


def _are_joints(name: str, value: Sequence[Any], content: Mapping[str, Any]) -> bool:
    """Whether structures are a joint each: by the name of their array, or since their only clock lies outside it."""
    fields = [_vectors(one) for one in value]
    if any(said(key).signal == "time" for own in fields for key in own):
        return False
    words = _words(name.rpartition(".")[2])
    if words & JOINTS and not words & (RUNS - WEAK):  # servoLog
        return True
    lengths = {len(vector) for own in fields for vector in own.values()}
    return len(lengths) == 1 and not words & RUNS and bool(lengths & _clocks(content))


def _words(name: str) -> set[str]:
    return set(re.findall("[a-z]+", re.sub("(?<=[a-z])(?=[A-Z])", " ", name).lower()))


def parted(flat: Mapping[str, Any]) -> tuple[dict[str, dict[str, Any]], tuple[str, ...]]:
    """Variables of each run by its name, where structures or prefixes are a run each; else all under an empty name.

    What stands beside the runs is in each of them.

    Returns:
        The variables of each, and notes on what they were taken for.
    """
    paths = {name: _path(name) for name in flat}
    for above in sorted({path[:k] for path in paths.values() for k in range(len(path) - 1)}, key=len):
        children: dict[str, dict[str, Any]] = {}
        owner: dict[str, str] = {}
        for name, path in paths.items():
            if path[: len(above)] == above and len(path) > len(above) + 1:
                child = path[len(above)]
                own = name[len("".join(path[: len(above) + 1])) + len(above) + 1 :]
                children.setdefault(child, {})[own] = flat[name]
                owner[name] = child
        runs, note = _siblings(children, above[-1] if above else "")
        if runs:
            shared = {name: value for name, value in flat.items() if owner.get(name) not in runs}
            taken = any(own.keys() & shared.keys() for own in runs.values())
            return {
                run: shared | {f"run.{name}" if taken else name: value for name, value in own.items()}
                for run, own in runs.items()
            }, (note,) * bool(note)
        if note:
            return {"": dict(flat)}, (note,)
    return {"": dict(flat)}, ()


def _path(name: str) -> tuple[str, ...]:
    """Parts of a name: those of structures, and at its end a number's prefix."""
    *above, last = name.split(".")
    match = PREFIX.fullmatch(last)
    return (*above, match[1], match[2]) if match else (*above, last)


def _siblings(children: Mapping[str, dict[str, Any]], above: str) -> tuple[dict[str, dict[str, Any]], str]:
    """Those of the variables that lie side by side which are a run each, and a note on what they are taken for.

    Several joints may have a clock each, too: of one recording where all clocks are the same, and nothing is called a
    run.
    """
    forms: dict[frozenset[str], list[str]] = {}
    for name, own in children.items():
        if _clock(own) is not None and sum(map(_series, own.values())) > LEAST and not said(name).signal:
            forms.setdefault(frozenset(key for key, value in own.items() if _series(value)), []).append(name)
    alike = max(forms.values(), key=len, default=[])
    several = any(word.endswith("s") for word in _words(above) & (RUNS - WEAK))  # of test.left and .right, test is one
    called = bool(alike) and (several or all(map(_called_run, alike)))
    if len(alike) < 2 or (not called and any(_words(name) & JOINTS for name in (above, *alike))):
        return {}, ""
    clocks = [clock for name in alike if (clock := _clock(children[name])) is not None]
    names = ", ".join(alike[:3]) + ", ..." * (len(alike) > 3)
    if not called and (all(np.array_equal(clock, clocks[0]) for clock in clocks) or together(clocks)):
        return {}, f"{names} were recorded at one time, by their clocks, and are taken for joints of one recording"
    stems = {name.rstrip("0123456789") for name in alike} - {""}
    brothers = [
        name for name, own in children.items() if name.rstrip("0123456789") in stems and _clock(own) is not None
    ]
    runs = {name: children[name] for name in children if name in (*alike, *brothers)}
    return runs, "" if called else f"{names} have a clock each and are taken for a recording each"


def _called_run(name: str) -> bool:
    words = _words(name)
    return bool(words & (RUNS - WEAK)) or bool(words & WEAK and re.search(r"\d", name))


def _clock(variables: Mapping[str, Any]) -> np.ndarray | None:
    """The vector that is called as a clock and runs as one."""
    named = (value for key, value in variables.items() if said(key).signal == "time" and _is_vector(value))
    clocks = (np.asarray(value, np.float64) for value in named)
    return next((clock for clock in clocks if clock_units(clock)), None)


def _series(value: Any) -> int:
    """Columns that a variable makes, at least."""
    if is_structures(value):
        return 0 if all(map(_is_signal, value)) else len(value)
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub" or value.size < 2:
        return 0
    return min(value.shape) if value.ndim == 2 else 1


def _vectors(structure: Any) -> dict[str, np.ndarray]:
    """Vectors of a structure by the names of their fields."""
    flat: dict[str, Any] = {}
    for key in structure._fieldnames:
        flatten(key, getattr(structure, key), flat)
    return {key.rpartition(".")[2]: value for key, value in flat.items() if _is_vector(value)}


def _clocks(content: Mapping[str, Any]) -> set[int]:
    """Lengths of the vectors that are called as a clock and run as one."""
    named = (value for key, value in content.items() if said(key).signal == "time" and _is_vector(value))
    return {len(value) for value in named if clock_units(np.asarray(value, np.float64))}


def _is_vector(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.ndim == 1 and len(value) > 1 and value.dtype.kind in "fiu"


def _labels(name: str, value: Sequence[Any]) -> list[str]:
    """Names of joints: their own where each has one, else the name of their array with their number."""
    own = [getattr(one, "name", None) for one in value]
    words = [re.sub(r"\W+", "_", word.strip()).strip("_") for word in own if isinstance(word, str)]
    if len(set(words)) == len(value) and all(words):
        return words
    return [f"{name}{k + 1}" for k in range(len(value))]
