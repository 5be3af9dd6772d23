"""MATLAB files: vectors become columns, single numbers facts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

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
    columns: dict[str, Array] = {}
    facts: dict[str, float | str] = {}
    for name, value in content.items():
        if not name.startswith("__"):
            _collect(name, value, columns, facts)
    if not columns:
        raise LogError(f"{path}: has no vectors of numbers; a log is one vector for each signal and one of time.")
    lengths = [len(values) for values in columns.values()]
    length = max(set(lengths), key=lambda n: (lengths.count(n), n))
    other = sorted(name for name, values in columns.items() if len(values) != length)
    notes = (f"left out, for they do not have {length} samples: {', '.join(other)}",) if other else ()
    kept = {name: values for name, values in columns.items() if len(values) == length}
    return [Recording(path.stem, kept, path, "matlab", facts, notes=notes)]


def _collect(name: str, value: Any, columns: dict[str, Array], facts: dict[str, float | str]) -> None:
    """Put a variable where it belongs; fields of a structure and columns of a matrix by their own names."""
    if hasattr(value, "_fieldnames"):
        for key in value._fieldnames:
            _collect(f"{name}.{key}", getattr(value, key), columns, facts)
        return
    if isinstance(value, str):
        facts[name] = value
        return
    try:
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        return
    if array.ndim == 0:
        facts[name] = float(array)
    elif array.ndim == 1 and len(array) > 1:
        columns[name] = array
    elif array.ndim == 2 and array.size:
        rows = array if array.shape[0] >= array.shape[1] else array.T
        for place in range(rows.shape[1]):
            columns[f"{name}[{place}]"] = rows[:, place].copy()
