"""HDF5 files: data sets by their paths, numbered groups as runs; and MATLAB's of version 7.3, which are HDF5."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from .....common.extras import needed_for
from ...types import Array, LogError
from ..recording import Recording
from .variables import recording_of, recordings_of

ENDINGS = (".h5", ".hdf5")
RUN = re.compile(r"(demo|episode|ep|traj\w*|run|trial|test|experiment|exp|rollout|recording|rec|seq\w*|log)[_-]?\d+")
"""Names of groups that are a run each, whatever their lengths."""
DAMAGED = (OSError, KeyError, RuntimeError, ValueError, TypeError, IndexError)
"""What the library raises of a file that is torn, or of what it does not know."""
NUMBERED = re.compile(r"(.*?)[_-]?\d+")


def read_hdf5(path: Path) -> list[Recording]:
    """The recordings of a file: groups that have the same data sets and are numbered are a run each.

    Data sets of more than two dimensions, images among them, are not loaded.

    Raises:
        LogError: it is damaged, or has no vectors.
        MissingPackage: the extra ``hdf5`` is not installed.
    """
    with needed_for("Reading HDF5 files"):
        import h5py
    try:
        with h5py.File(path) as file:
            content = dict(_contents(file))
    except DAMAGED as error:
        raise LogError(f"{path}: is no HDF5 file, or a damaged one: {str(error).splitlines()[0]}.") from None
    runs = _runs(content)
    return [recording_of(path, "hdf5", own, f"{path.stem}-{name}" if name else path.stem) for name, own in runs.items()]


def _is_text(kind: np.dtype) -> bool:
    """Whether a data set holds words; other objects are references, or lists of changing length."""
    import h5py

    return h5py.check_string_dtype(kind) is not None


def _contents(group: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Data sets and attributes below a group, by their paths."""
    for name, value in group.attrs.items():
        plain = value.decode() if isinstance(value, bytes) else value
        if isinstance(plain, str | int | float | np.number):
            yield (*path, name), plain
    for name, item in group.items():
        if hasattr(item, "keys"):
            yield from _contents(item, (*path, name))
        elif item.dtype.kind in "fiub" and item.ndim <= 2:
            yield (*path, name), np.squeeze(item[()])
        elif _is_text(item.dtype) and item.ndim <= 1 and item.shape is not None:
            words = np.asarray(item.asstr()[()], object)
            yield (*path, name), str(words) if words.ndim == 0 else words
        else:
            yield (*path, name), None  # images and tables: told, not loaded


def _runs(content: Mapping[tuple[str, ...], Any]) -> dict[str, dict[str, Any]]:
    """Variables of each run by its name; those that stand above the runs are in each of them."""
    above = next((parent for parent in _parents(content) if _are_runs(_children(content, parent))), None)
    if above is None:
        return {"": {".".join(path): value for path, value in content.items()}}
    children = _children(content, above)
    shared = {
        ".".join(path): value for path, value in content.items() if not (path[: len(above)] == above and
                                                                         path[len(above)] in children)
    }  # fmt: skip
    return {name: shared | {".".join(path): value for path, value in own.items()} for name, own in children.items()}


def _parents(content: Mapping[tuple[str, ...], Any]) -> list[tuple[str, ...]]:
    """Paths of groups, those at the top first."""
    return sorted({path[:k] for path in content for k in range(len(path))}, key=len)


def _children(content: Mapping[tuple[str, ...], Any], parent: tuple[str, ...]) -> dict[str, dict[tuple[str, ...], Any]]:
    """Groups right below one by their names, in the order of their numbers, each with what is below it."""
    at = len(parent)
    out: dict[str, dict[tuple[str, ...], Any]] = {}
    for path, value in content.items():
        if path[:at] == parent and len(path) > at + 1 and NUMBERED.fullmatch(path[at]):
            out.setdefault(path[at], {})[path[at + 1 :]] = value
    return dict(sorted(out.items(), key=lambda one: (len(one[0]), one[0])))


def _are_runs(children: Mapping[str, Mapping[tuple[str, ...], Any]]) -> bool:
    """Whether groups are a run each, and not a joint each: by their names, or since their lengths differ."""
    forms = {frozenset(path for path, value in own.items() if np.ndim(value) > 0) for own in children.values()}
    stems = {match[1] for name in children if (match := NUMBERED.fullmatch(name))}
    if len(forms) != 1 or len(stems) != 1 or not next(iter(forms)):
        return False
    lengths = {tuple(len(value) for value in own.values() if np.ndim(value) > 0) for own in children.values()}
    return all(RUN.fullmatch(name.lower()) for name in children) or len(lengths) > 1


def read_matlab73(path: Path) -> list[Recording]:
    """The recordings of a MATLAB file of version 7.3.

    Raises:
        LogError: it is damaged, or has no vectors.
        MissingPackage: the extra ``hdf5`` is not installed.
    """
    with needed_for("Reading MATLAB files of version 7.3", ", or save it in MATLAB with save(name, '-v7')"):
        import h5py
    try:
        with h5py.File(path) as file:
            content = {name: _matlab(item, file) for name, item in file.items() if not name.startswith("#")}
    except DAMAGED as error:
        raise LogError(f"{path}: is not a MATLAB file, or a damaged one: {str(error).splitlines()[0]}.") from None
    return recordings_of(path, "matlab", content)


def _matlab(item: Any, file: Any) -> Any:
    """A variable of a MATLAB file as SciPy gives those of older versions."""
    if hasattr(item, "keys"):
        fields = {name: _matlab(field, file) for name, field in item.items()}
        lists = [name for name, field in item.items() if _refers(field) and "MATLAB_class" not in field.attrs]
        if not lists:
            return _structure(fields)
        count = len(fields[lists[0]])
        return _objects([_structure({name: fields[name][k] for name in lists}) for k in range(count)])
    if _refers(item):
        return _objects([_matlab(file[one], file) for one in np.ravel(item[()])])
    if item.attrs.get("MATLAB_empty", 0):
        return None
    value = np.squeeze(np.asarray(item[()]))
    if item.attrs.get("MATLAB_class", b"") == b"char":
        return "".join(map(chr, np.ravel(value)))
    if value.dtype.names == ("real", "imag"):
        return value["real"] + 1j * value["imag"]
    return value.T if value.dtype.kind in "fiub" else None


def _refers(item: Any) -> bool:
    """Whether a data set refers to others: a cell, or a field of an array of structures."""
    return not hasattr(item, "keys") and item.dtype.kind == "O"


def _structure(fields: Mapping[str, Any]) -> SimpleNamespace:
    return SimpleNamespace(**fields, _fieldnames=list(fields))


def _objects(items: list[Any]) -> Array:
    out = np.empty(len(items), object)
    out[:] = items
    return out
