"""Nested variables as recordings: vectors become columns, single numbers facts, structures joints, signals or runs.

A structure is a mapping, an array of them a list of mappings.
"""

from __future__ import annotations

import pickle
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from .....common.documents import RECORDING, DocumentError, load_arrays, regular
from .....common.extras import needed_for
from ...types import Array, LogError
from ..clocks import clock_units, together
from ..names import is_a, said
from ..recording import Recording

PREFIX = re.compile(r"(.*?\d+)_(.+)")
"""``run1_t``: a name with its number, and the name of what is its own."""
FEWEST_OF_A_RUN = 3
"""Columns of a run at least, with its clock: one beside it is a signal with its stamps."""

Tree = Mapping[str, Any]


def recordings_of(path: Path, kind: str, content: Tree) -> list[Recording]:
    """The recordings that variables make: their vectors of one length; those of other lengths are left out and said.

    Args:
        path: file that holds them.
        kind: of the file.
        content: arrays, numbers, words, mappings and lists of these by name; None where what the file holds is none of
            these.

    Raises:
        LogError: there are no vectors, or parts with clocks that differ.
    """
    numbers: dict[str, str] = {}
    flat = _flat(content, numbers)
    return [
        _recording(path, kind, own, f"{path.stem}-{name}" if name else path.stem)
        for name, own in _runs(flat, numbers).items()
    ]


def is_structures(value: Any) -> bool:
    """Whether a value is an array of structures."""
    return isinstance(value, list) and bool(value) and all(isinstance(one, Mapping) for one in value)


def _flat(content: Tree, numbers: dict[str, str], above: str = "") -> dict[str, Any]:
    """Variables, those of structures by their dotted names; ``numbers`` takes the place of each structure of an
    array."""
    out: dict[str, Any] = {}
    for key, value in content.items():
        name = f"{above}{key}"
        if isinstance(value, Mapping):
            out |= _flat(value, numbers, f"{name}.")
        elif is_structures(value):
            for k, one in enumerate(value, 1):
                numbers[f"{name}{k}"] = f"{k:0{len(str(len(value)))}}"
                out |= _flat(one, numbers, f"{name}{k}.")
        else:
            out[name] = value
    return out


# --- runs ------------------------------------------------------------------------------------------------------------


def _runs(flat: Tree, numbers: Mapping[str, str]) -> dict[str, Tree]:
    """Variables by run, each with those that all share; of one run under an empty name."""
    paths = {name: _path(name) for name in flat}
    for depth in range(1, max(map(len, paths.values()), default=0)):
        parents: dict[tuple[str, ...], dict[str, dict[str, str]]] = {}
        for name, path in paths.items():
            if len(path) > depth:
                own = parents.setdefault(path[: depth - 1], {}).setdefault(path[depth - 1], {})
                own[".".join(path[depth:])] = name
        for above, children in parents.items():
            forms: dict[frozenset[str], list[str]] = {}
            for child, own in children.items():
                series = frozenset(key for key, name in own.items() if _is_series(flat[name]))
                if series and not said(child).signal:
                    forms.setdefault(series, []).append(child)
            alike = sorted(max(forms.values(), key=len, default=[]), key=len)
            stems = {child.rstrip("0123456789") for child in alike} - {""}
            members = [
                child for child in sorted(children, key=len) if child in alike or child.rstrip("0123456789") in stems
            ]
            theirs = {name for child in members for name in children[child].values()}
            rest = {name: value for name, value in flat.items() if name not in theirs}
            runs = {child: {key: flat[name] for key, name in children[child].items()} for child in members}
            number = {child: numbers.get(".".join((*above, child)), "") for child in members}
            if _are_runs(
                {child: runs[child] for child in alike}, above[-1] if above else "", all(number.values()), rest
            ):
                return {number[child] or child: {**rest, **own} for child, own in runs.items()}
    return {"": flat}


def _path(name: str) -> tuple[str, ...]:
    """Parts of a name: those of structures, and at its end a number's prefix."""
    *above, last = name.split(".")
    match = PREFIX.fullmatch(last)
    return (*above, match[1], match[2]) if match else (*above, last)


def _are_runs(children: Mapping[str, Tree], above: str, listed: bool, rest: Tree) -> bool:
    """Whether parts of one form are a run each: they are called so, or are no joints and have a clock each, or are an
    array beside no clock."""
    words = [set(re.findall("[a-z]+", name.lower())) for name in (above, *children)]
    if len(children) < 2:
        return False
    if all(is_a("runs", *own) for own in words[1:]) or is_a("runs", *(one for one in words[0] if one[-1:] == "s")):
        return True
    timed = all(_clock(own) and sum(map(_is_series, own.values())) >= FEWEST_OF_A_RUN for own in children.values())
    clocks = [np.asarray(own[_clock(own)], np.float64) for own in children.values() if timed]
    beside = together(clocks) or (not listed and all(np.array_equal(one, clocks[0]) for one in clocks))
    joints = any(is_a("joints", *own) for own in words)
    return not joints and ((timed and not beside) or (listed and not _clock(rest)))


def _clock(variables: Tree) -> str:
    """Name of the vector that is called as a clock and runs as one; empty where there is none."""
    return next((name for name, value in variables.items() if _is_series(value) and _is_clock(name, value)), "")


def _is_clock(name: str, values: Any) -> bool:
    named = said(name.rpartition(".")[2]).signal == "time" and np.ndim(values) == 1
    return named and bool(clock_units(np.asarray(values, np.float64)))


def _is_series(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and value.size > 1 and value.ndim <= 2


# --- one recording ---------------------------------------------------------------------------------------------------


def _recording(path: Path, kind: str, content: Tree, name: str) -> Recording:
    """The one recording that variables of a run make.

    Raises:
        LogError: there are no vectors, or parts with clocks that differ.
    """
    columns: dict[str, Array] = {}
    facts: dict[str, float | str] = {}
    left: dict[str, str] = {}
    lists = [value for value in content.values() if isinstance(value, list)]
    words = [value for value in lists if all(isinstance(one, str) for one in value)]
    for key, value in content.items():
        if isinstance(value, str):
            facts[key] = value
        elif why := _collect(key, value, words, columns, facts):
            left[key] = why
    if not columns:
        why = next((f" ({key}: {reason})" for key, reason in left.items()), "")
        raise LogError(f"{path}: has no vectors of numbers{why}; a log is one vector for each signal and one of time.")
    lengths = Counter(len(values) for values in columns.values())
    length = max(lengths, key=lambda n: (lengths[n], n))
    other = sorted(key for key, values in columns.items() if len(values) != length)
    notes = (f"left out, for they do not have {length} samples: {', '.join(other)}",) * bool(other)
    kept = {key: values for key, values in columns.items() if len(values) == length}
    clocks = [key for key, values in kept.items() if "." in key and _is_clock(key, values)]
    for key in clocks[1:]:  # of a part; a name such as pos.Time would make it a position
        if not np.array_equal(kept[key], kept[clocks[0]]):
            raise LogError(
                f"{path}: {clocks[0]} and {key} are clocks that differ, and a log has one; save each part as a file of "
                "its own, or all signals at the times of one."
            )
        left[key] = f"the clock {clocks[0]}"
        del kept[key]
    return Recording(name, kept, path, kind, facts, dict.fromkeys(clocks[:1], "time"), notes, left=left)


def _collect(
    name: str, value: Any, names: Sequence[Sequence[str]], columns: dict[str, Array], facts: dict[str, float | str]
) -> str:
    """Put a variable where it belongs, columns of a matrix by the one list of words that is as long, else by number;
    why it is none of numbers, else empty."""
    if value is None or isinstance(value, list):
        return "no vector or matrix of numbers"
    if np.iscomplexobj(value):
        return "complex numbers, where a log has real ones"
    try:
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        return "no numbers"
    if array.ndim == 0:
        facts[name] = float(array)
    elif array.ndim == 1 and len(array) > 1:
        columns[name] = array
    elif array.ndim == 2 and array.size:
        rows = array if array.shape[0] >= array.shape[1] else array.T
        alike = {tuple(words) for words in names if len(words) == rows.shape[1] == len(set(words))}
        called = [f"{word}.{name}" for word in alike.pop()] if len(alike) == 1 else []
        for k in range(rows.shape[1]):
            columns[called[k] if called else f"{name}[{k}]"] = rows[:, k].copy()
    return ""


# --- files of arrays: MATLAB of any version, NumPy, HDF5 and tensors of PyTorch, by the names of their variables -----

HDF5, TENSORS, PICKLES = (".h5", ".hdf5"), (".pt", ".pth"), (".pkl", ".pickle", ".npy")
DAMAGED = (OSError, KeyError, RuntimeError, ValueError, TypeError, IndexError, AttributeError)
"""What libraries raise of a file that is torn, or of what they do not know."""
MATLAB73 = "Reading MATLAB files of version 7.3"


def read_matlab(path: Path) -> list[Recording]:
    """The recordings of a MATLAB file.

    Raises:
        LogError: it is damaged, or has no vectors.
        MissingPackage: it is of version 7.3, and the extra ``hdf5`` is not installed.
    """
    try:
        content = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        with needed_for(MATLAB73, ", or save it in MATLAB with save(name, '-v7')"):
            import h5py  # noqa: F401  pymatreader asks for it
            from pymatreader import read_mat
        try:
            content = read_mat(path)
        except DAMAGED as error:
            raise _damaged(path, "not a MATLAB", error) from None
    except (MatReadError, *DAMAGED) as error:
        raise _damaged(path, "not a MATLAB", error) from None
    return recordings_of(path, "matlab", {name: _plain(value) for name, value in content.items() if name[:2] != "__"})


def _damaged(path: Path, kind: str, error: Exception) -> LogError:
    why = str(error).splitlines()[0] if str(error) else type(error).__name__
    return LogError(f"{path}: is {kind} file, or a damaged one: {why}.")


def _plain(value: Any) -> Any:
    """What a library gives as mappings, lists, arrays of numbers, numbers and words."""
    if isinstance(value, dict):
        return {str(name): _plain(one) for name, one in value.items()}
    if isinstance(value, np.ndarray):
        if value.dtype.kind == "O":
            return [_plain(one) for one in value.ravel()]
        if value.dtype.kind == "U":
            return str(value) if value.ndim == 0 else [str(one) for one in value.ravel()]
        return np.squeeze(value) if value.dtype.kind in "fiubc" and value.size else None
    if isinstance(value, list):
        return [_plain(one) for one in value] or None
    return value if isinstance(value, str | int | float | complex | np.number) or value is None else str(value)


def read_numpy(path: Path) -> list[Recording]:
    """The recordings of a file of named arrays, as MATLAB's.

    Raises:
        LogError: it is damaged, or has no vectors.
    """
    try:
        named = load_arrays(path, RECORDING)
    except DocumentError as error:
        raise LogError(f"{path}: {error.problem}; {save_as(path)}.") from None
    return recordings_of(path, "numpy", {name: _plain(one) for name, one in named.items()})


def save_as(path: Path) -> str:
    """How to save what a pickle or a single array holds."""
    file = f"np.savez('{path.stem}.npz', **arrays)"
    return f"save named arrays, {file}, where arrays is a dict with a vector for each column"


def read_hdf5(path: Path) -> list[Recording]:
    """The recordings of an HDF5 file; data sets of more than two dimensions, images among them, are not loaded.

    Raises:
        LogError: it is damaged, or has no vectors.
        MissingPackage: the extra ``hdf5`` is not installed.
    """
    with needed_for("Reading HDF5 files"):
        import h5py
    try:
        with h5py.File(path) as file:
            content = _group(file, h5py.check_string_dtype)
    except DAMAGED as error:
        raise _damaged(path, "no HDF5", error) from None
    return recordings_of(path, "hdf5", content)


def _group(group: Any, is_text: Any) -> dict[str, Any]:
    """Data sets and attributes of a group by their names."""
    out: dict[str, Any] = {}
    for name, value in group.attrs.items():
        plain = value.decode() if isinstance(value, bytes) else value
        if isinstance(plain, str | int | float | np.number):
            out[name] = plain
    for name, item in group.items():
        if hasattr(item, "keys"):
            out[name] = _group(item, is_text)
        elif item.dtype.kind in "fiub" and item.ndim <= 2:
            out[name] = np.squeeze(item[()])
        elif is_text(item.dtype) is not None and item.ndim <= 1 and item.shape is not None:
            words = np.asarray(item.asstr()[()], object)
            out[name] = str(words) if words.ndim == 0 else [str(word) for word in words]
        else:
            out[name] = None  # images and tables: told, not loaded
    return out


def read_tensors(path: Path) -> list[Recording]:
    """The recordings of a file of ``torch.save``: a mapping of tensors. Nothing in the file is run.

    Raises:
        LogError: it is damaged, or holds anything but tensors, numbers and words.
        MissingPackage: PyTorch is not installed.
    """
    with needed_for("Reading tensors of PyTorch"):
        import torch
    regular(path, RECORDING)
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, EOFError, *DAMAGED):
        raise LogError(
            f"{path}: is no file of tensors: it is damaged, or holds what can run any code; {save_as(path)}."
        ) from None
    content = content if isinstance(content, dict) else {path.stem: content}
    tensors = {str(key): value for key, value in content.items()}
    for name, value in tensors.items():
        if isinstance(value, torch.Tensor):  # a stride of 0 repeats without an end
            if value.numel() * value.element_size() > RECORDING:
                raise LogError(f"{path}: {name} unpacks to more than {RECORDING // 2**20} MiB, the most that is read.")
            tensors[name] = value.numpy()
    return recordings_of(path, "torch", {name: _plain(value) for name, value in tensors.items()})
