"""MATLAB and NumPy files: their variables by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from ...types import LogError
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
        return read_matlab73(path)
    except (MatReadError, OSError, ValueError, TypeError) as error:
        raise LogError(f"{path}: is not a MATLAB file, or a damaged one: {str(error).splitlines()[0]}.") from None
    return recordings_of(path, "matlab", {name: value for name, value in content.items() if not name.startswith("__")})


def read_numpy(path: Path) -> list[Recording]:
    """The recordings of a file of named arrays, as MATLAB's.

    Raises:
        LogError: it is damaged, or has no vectors.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            content = {name: _plain_array(file, name) for name in file.files}
    except (OSError, ValueError, EOFError, AttributeError, BadZipFile) as error:
        said = str(error).splitlines()[0] if str(error) else "it is empty"
        raise LogError(f"{path}: is no file of named arrays (np.savez), or a damaged one: {said}.") from None
    return recordings_of(path, "numpy", content)


def read_array(path: Path) -> list[Recording]:
    """The recordings of a file of one array: a matrix of a column for each signal, or records with named fields.

    Raises:
        LogError: it is damaged, or holds no numbers.
    """
    try:
        array = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        said = str(error).splitlines()[0] if str(error) else "it is empty"
        if "Object arrays" in said:
            said = "it holds Python objects, which are not loaded, for they can run any code"
        raise LogError(
            f"{path}: {said}; save named arrays, np.savez('{path.stem}.npz', **arrays), where arrays is a dict with a "
            "vector for each column."
        ) from None
    fields = array.dtype.names
    content = {name: array[name] for name in fields} if fields else {path.stem: np.squeeze(array)}
    return recordings_of(path, "numpy", content)


def _plain_array(file: Any, name: str) -> Any:
    """An array of a file; None where it holds Python objects, which are not loaded."""
    try:
        value = file[name]
    except ValueError:
        return None
    return str(value) if value.ndim == 0 and value.dtype.kind == "U" else np.squeeze(value)
