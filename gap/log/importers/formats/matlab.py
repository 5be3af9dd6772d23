"""MATLAB and NumPy files: vectors become columns, single numbers facts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from ...types import Array, LogError
from ..recording import Recording

HDF5 = "v7.3"


def read_matlab(path: Path) -> list[Recording]:
    """The recordings of a file: its vectors of one length; those of other lengths are left out and said.

    Raises:
        LogError: it is damaged or of version 7.3, or has no vectors.
    """
    try:
        content = loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:
        raise LogError(
            f"{path}: is of version 7.3 (HDF5), which is not read; save it in MATLAB with save(name, '-v7')."
        ) from None
    except (MatReadError, OSError, ValueError, TypeError) as error:
        raise LogError(f"{path}: is not a MATLAB file, or a damaged one: {str(error).splitlines()[0]}.") from None
    return [_recording(path, "matlab", {name: value for name, value in content.items() if not name.startswith("__")})]


def read_numpy(path: Path) -> list[Recording]:
    """The recording of a file of named arrays, as MATLAB's.

    Raises:
        LogError: it is damaged, or has no vectors.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            content = {name: _plain_array(file, name) for name in file.files}
    except (OSError, ValueError, EOFError, AttributeError, BadZipFile) as error:
        said = str(error).splitlines()[0] if str(error) else "it is empty"
        raise LogError(f"{path}: is no file of named arrays (np.savez), or a damaged one: {said}.") from None
    return [_recording(path, "numpy", content)]


def _plain_array(file: Any, name: str) -> Any:
    """An array of a file; None where it holds Python objects, which are not loaded."""
    try:
        value = file[name]
    except ValueError:
        return None
    return str(value) if value.ndim == 0 and value.dtype.kind == "U" else np.squeeze(value)


def _recording(path: Path, kind: str, content: Mapping[str, Any]) -> Recording:
    columns: dict[str, Array] = {}
    facts: dict[str, float | str] = {}
    left: dict[str, str] = {}
    for name, value in content.items():
        _collect(name, value, columns, facts, left)
    if not columns:
        why = next((f" ({name}: {reason})" for name, reason in left.items()), "")
        raise LogError(f"{path}: has no vectors of numbers{why}; a log is one vector for each signal and one of time.")
    lengths = [len(values) for values in columns.values()]
    length = max(set(lengths), key=lambda n: (lengths.count(n), n))
    other = sorted(name for name, values in columns.items() if len(values) != length)
    notes = (f"left out, for they do not have {length} samples: {', '.join(other)}",) if other else ()
    kept = {name: values for name, values in columns.items() if len(values) == length}
    return Recording(path.stem, kept, path, kind, facts, notes=notes, left=left)


def _collect(
    name: str, value: Any, columns: dict[str, Array], facts: dict[str, float | str], left: dict[str, str]
) -> None:
    """Put a variable where it belongs; fields of a structure and columns of a matrix by their own names."""
    if hasattr(value, "_fieldnames"):
        for key in value._fieldnames:
            _collect(f"{name}.{key}", getattr(value, key), columns, facts, left)
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
        words = all(isinstance(one, str) for one in np.ravel(np.asarray(value, object)))
        left[name] = "it holds text, no numbers" if words else "no numbers, or vectors of several lengths"
        return
    if array.ndim == 0:
        facts[name] = float(array)
    elif array.ndim == 1 and len(array) > 1:
        columns[name] = array
    elif array.ndim == 2 and array.size:
        rows = array if array.shape[0] >= array.shape[1] else array.T
        for place in range(rows.shape[1]):
            columns[f"{name}[{place}]"] = rows[:, place].copy()
