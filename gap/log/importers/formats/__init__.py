"""Readers of foreign files, one a format: each gives recordings with their columns as they are called there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ...types import LogError
from ..recording import Recording
from . import hdf5, ros, tables
from .json_rows import LINES, is_recording, read_json
from .lerobot import is_lerobot, read_lerobot
from .matlab import read_matlab, read_numpy
from .tables import read_table

KNOWN = (*tables.ENDINGS, ".json", *LINES, ".mat", ".npz", *hdf5.ENDINGS, *ros.ENDINGS)


def read_recordings(path: Path) -> list[Recording]:
    """The recordings of a file, or of all files of a folder.

    Raises:
        LogError: one sentence that says which file, what is wrong with it and what to do.
    """
    if not path.exists():
        raise LogError(f"{path}: no such file or folder.")
    if path.is_dir() and is_lerobot(path):
        return read_lerobot(path)
    if ros.is_bag(path):
        return ros.read_bag(path)
    if path.is_file():
        return _reader(path)(path)
    files = [file for file in sorted(path.iterdir()) if _is_recording(file)]
    if not files:
        raise LogError(f"{path}: holds no recording that is known: {', '.join(KNOWN)}, or a LeRobot data set.")
    recordings = [
        recording for file in files for recording in (ros.read_bag if ros.is_bag(file) else _reader(file))(file)
    ]
    names: dict[str, Path] = {}
    for recording in recordings:
        if recording.name in names:
            other = names[recording.name].name
            raise LogError(f"{recording.source}: {other} has the same name; rename one, or import one at a time.")
        names[recording.name] = recording.source
    return recordings


def _reader(path: Path) -> Callable[[Path], list[Recording]]:
    ending = path.suffix.lower()
    if ending in (".json", *LINES):
        return read_json
    if ending == ".mat":
        return read_matlab
    if ending in hdf5.ENDINGS:
        return hdf5.read_hdf5
    if ending == ".npz":
        return read_numpy
    if ending in tables.ENDINGS:
        return read_table
    raise LogError(f"{path}: is of no kind that is read; there are {', '.join(KNOWN)}, and LeRobot data sets.")


def _is_recording(path: Path) -> bool:
    """Whether a file of a folder is a recording, and not a licence or a description."""
    if path.name.startswith(".") or path.name.lower() in ("readme.txt", "license.txt"):
        return False
    if path.is_dir():
        return ros.is_bag(path)
    return is_recording(path) if path.suffix.lower() == ".json" else path.suffix.lower() in KNOWN
