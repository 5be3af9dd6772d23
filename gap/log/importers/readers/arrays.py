"""Files of arrays: MATLAB of any version, NumPy, HDF5 and tensors of PyTorch, by the names of their variables."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from .....common.documents import RECORDING, DocumentError, load_arrays, regular
from .....common.extras import needed_for
from ...types import LogError
from ..recording import Recording
from .trees import recordings_of

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
