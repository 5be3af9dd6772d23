"""MATLAB and NumPy files: their variables by name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from .....common.documents import RECORDING, DocumentError, load_array, load_arrays
from ...types import LogError
from ..evidence import clock_units
from ..names import said
from ..recording import Recording
from .hdf5 import read_matlab73
from .variables import recordings_of


def read_matlab(path: Path) -> list[Recording]:
    """The recordings of a file, of any version.

    Raises:
        LogError: it is damaged, or has no vectors.
        MissingPackage: it is of version 7.3, and the extra ``hdf5`` is not installed.
    """
    try:
        content = loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:
        return [_one_clock(one) for one in read_matlab73(path)]
    except (MatReadError, OSError, ValueError, TypeError) as error:
        raise LogError(f"{path}: is not a MATLAB file, or a damaged one: {str(error).splitlines()[0]}.") from None
    named = {name: value for name, value in content.items() if not name.startswith("__")}
    return [_one_clock(one) for one in recordings_of(path, "matlab", named)]


def read_numpy(path: Path) -> list[Recording]:
    """The recordings of a file of named arrays, as MATLAB's.

    Raises:
        LogError: it is damaged, or has no vectors.
    """
    try:
        arrays = load_arrays(path, RECORDING)
    except DocumentError as error:
        raise LogError(f"{path}: {error.problem}.") from None
    content = {name: None if value is None else _plain_array(value) for name, value in arrays.items()}
    return recordings_of(path, "numpy", content)


def read_array(path: Path) -> list[Recording]:
    """The recordings of a file of one array: a matrix of a column for each signal, or records with named fields.

    Raises:
        LogError: it is damaged, or holds no numbers.
    """
    try:
        array = load_array(path, RECORDING)
    except DocumentError as error:
        raise LogError(
            f"{path}: {error.problem}; save named arrays, np.savez('{path.stem}.npz', **arrays), where arrays is a "
            "dict with a vector for each column."
        ) from None
    fields = array.dtype.names
    content = {name: array[name] for name in fields} if fields else {path.stem: np.squeeze(array)}
    return recordings_of(path, "numpy", content)


def _plain_array(value: np.ndarray) -> Any:
    return str(value) if value.ndim == 0 and value.dtype.kind == "U" else np.squeeze(value)


def _one_clock(recording: Recording) -> Recording:
    """A recording without the clocks of structures that a name such as ``pos.Time`` would make a position."""
    ends = {name: name.rpartition(".")[2] for name in recording.columns if "." in name}
    clocks = [name for name, end in ends.items() if said(end).signal == "time" and clock_units(recording.columns[name])]
    same = [name for name in clocks if np.array_equal(recording.columns[name], recording.columns[clocks[0]])]
    misread = [name for name in same if said(name).signal != "time"]
    if not misread:
        return recording
    kept = next((name for name in same if name not in misread), ends[misread[0]])
    columns = {name: values for name, values in recording.columns.items() if name not in misread}
    columns.setdefault(kept, recording.columns[misread[0]])
    return replace(recording, columns=columns, left=recording.left | dict.fromkeys(misread, f"the clock {kept}"))
