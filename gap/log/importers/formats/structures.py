"""Structures of a file and arrays of them: of a joint or a signal each, which are columns, and else of a run each."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..evidence import clock_units
from ..names import said
from .long_form import JOINT

JOINTS = (JOINT - {"name", "id"}) | {"axes", "motors", "servos", "actuators", "drive", "drives", "leg", "legs", "arm",
                                     "arms", "gelenke"}  # fmt: skip
"""Words for an array of structures that are a joint each."""
RUNS = frozenset(["run", "runs", "trial", "trials", "episode", "episodes", "test", "tests", "experiment", "experiments",
                  "demo", "demos", "rollout", "rollouts", "recording", "recordings", "rec", "log", "logs"])  # fmt: skip
"""Words for an array of structures that are a run each, though the runs may have one clock."""
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
    words = set(re.findall("[a-z]+", re.sub("(?<=[a-z])(?=[A-Z])", " ", name.rpartition(".")[2]).lower()))
    if words & JOINTS and not words & (RUNS - {"log", "logs"}):  # servoLog
        return True
    lengths = {len(vector) for own in fields for vector in own.values()}
    return len(lengths) == 1 and not words & RUNS and bool(lengths & _clocks(content))


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
