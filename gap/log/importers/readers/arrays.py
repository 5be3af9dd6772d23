"""Files of arrays: MATLAB of any version, NumPy, HDF5 and tensors of PyTorch, by the names of their variables."""

from __future__ import annotations

import math
import pickle
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from .....common.documents import RECORDING, DocumentError, load_array, load_arrays, regular
from .....common.extras import needed_for
from ...types import LogError
from ..recording import Recording
from .trees import recordings_of

HDF5, TENSORS, PICKLES = (".h5", ".hdf5"), (".pt", ".pth"), (".pkl", ".pickle")
DAMAGED = (OSError, KeyError, RuntimeError, ValueError, TypeError, IndexError, AttributeError)
"""What libraries raise of a file that is torn, or of what they do not know."""
STORAGES = {"FloatStorage": "<f4", "DoubleStorage": "<f8", "HalfStorage": "<f2", "LongStorage": "<i8",
            "IntStorage": "<i4", "ShortStorage": "<i2", "CharStorage": "<i1", "ByteStorage": "<u1",
            "BoolStorage": "?"}  # fmt: skip
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
            content = _as_lists(read_mat(path))
        except DAMAGED as error:
            raise _damaged(path, "not a MATLAB", error) from None
    except (MatReadError, *DAMAGED) as error:
        raise _damaged(path, "not a MATLAB", error) from None
    return recordings_of(path, "matlab", {name: _plain(value) for name, value in content.items() if name[:2] != "__"})


def _damaged(path: Path, kind: str, error: Exception) -> LogError:
    why = str(error).splitlines()[0] if str(error) else type(error).__name__
    return LogError(f"{path}: is {kind} file, or a damaged one: {why}.")


def _as_lists(value: Any) -> Any:
    """Arrays of structures as lists of mappings: pymatreader has a mapping of lists."""
    if not isinstance(value, dict):
        return value
    inner = {name: _as_lists(one) for name, one in value.items()}
    counts = {len(one) if isinstance(one, list) else -1 for one in inner.values()}
    if len(counts) == 1 and (count := counts.pop()) > 1 and "joint_names" not in inner:
        return [{name: one[k] for name, one in inner.items()} for k in range(count)]
    return inner


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
    """The recordings of a file of named arrays, as MATLAB's; or of one array: a matrix of a column for each signal, or
    records with named fields.

    Raises:
        LogError: it is damaged, or has no vectors.
    """
    try:
        if path.suffix.lower() == ".npz":
            return recordings_of(
                path, "numpy", {name: _plain(one) for name, one in load_arrays(path, RECORDING).items()}
            )
        array = load_array(path, RECORDING)
    except DocumentError as error:
        more = "" if path.suffix.lower() == ".npz" else f"; {_save_as(path)}"
        raise LogError(f"{path}: {error.problem}{more}.") from None
    fields = array.dtype.names
    return recordings_of(
        path, "numpy", {name: array[name] for name in fields} if fields else {path.stem: _plain(array)}
    )


def _save_as(path: Path) -> str:
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


# --- tensors of PyTorch ----------------------------------------------------------------------------------------------


def read_tensors(path: Path) -> list[Recording]:
    """The recordings of a file of ``torch.save``: a mapping of tensors. Nothing in the file is run.

    Raises:
        LogError: it is damaged, or holds anything but tensors, numbers and words.
    """
    try:
        regular(path, RECORDING)
        with zipfile.ZipFile(path) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > RECORDING:
                raise LogError(f"{path}: unpacks to more than {RECORDING // 2**20} MiB, the most that is read.")
            name = next(name for name in archive.namelist() if name.rpartition("/")[2] == "data.pkl")
            content = _Tensors(archive, name.removesuffix("data.pkl")).load()
    except DocumentError as error:
        raise LogError(f"{path}: {error.problem}.") from None
    except (StopIteration, zipfile.BadZipFile, pickle.UnpicklingError, EOFError, *DAMAGED) as error:
        why = str(error) or "it has no tensors"
        raise LogError(
            f"{path}: is no file of tensors that is read without running what it holds: {why}; {_save_as(path)}."
        ) from None
    if not isinstance(content, dict):
        content = {path.stem: content}
    return recordings_of(path, "torch", {str(key): _plain(value) for key, value in content.items()})


class _Tensors(pickle.Unpickler):
    """Tensors of an archive of PyTorch as arrays; any other object than theirs is refused."""

    def __init__(self, archive: zipfile.ZipFile, folder: str) -> None:
        super().__init__(archive.open(f"{folder}data.pkl"))
        self.archive, self.folder = archive, folder

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == ("collections", "OrderedDict"):
            return dict
        if module == "torch._utils" and name in ("_rebuild_tensor_v2", "_rebuild_tensor"):
            return _tensor
        if module in ("torch", "torch.storage") and name in STORAGES:
            return STORAGES[name]
        raise pickle.UnpicklingError(f"it holds {module}.{name}, which is not loaded, for it can run any code")

    def persistent_load(self, pid: Any) -> np.ndarray:
        kind, key = pid[1], str(pid[2])
        if pid[0] != "storage" or kind not in STORAGES.values() or not key.isalnum():
            raise pickle.UnpicklingError("it refers to something else than a tensor")
        return np.frombuffer(self.archive.read(f"{self.folder}data/{key}"), kind)


def _tensor(storage: np.ndarray, offset: int, size: tuple[int, ...], stride: tuple[int, ...], *_: Any) -> np.ndarray:
    """A tensor as an array of its own, within its storage."""
    if min((offset, *size, *stride), default=0) < 0 or len(size) > 4:
        raise pickle.UnpicklingError("a tensor has a shape that is none")
    if not all(size):
        return np.zeros(size, storage.dtype)
    last = offset + sum((n - 1) * step for n, step in zip(size, stride, strict=True))
    if last >= len(storage) or math.prod(size) * storage.itemsize > RECORDING:  # a stride of 0 repeats without an end
        raise pickle.UnpicklingError("a tensor lies outside of its storage, or is too large")
    strides = [step * storage.itemsize for step in stride]
    return np.lib.stride_tricks.as_strided(storage[offset:], size, strides).copy()
