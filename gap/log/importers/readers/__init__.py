"""Readers of foreign files, one a format: each gives recordings with their columns as they are called there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from .....common.documents import DocumentError, regular
from ...sidecar import FOLDER_DEFAULTS
from ...types import LogError
from ..recording import NoRecording, Recording
from . import arrays, bags, tables
from .cells import LONGEST_CELL
from .documents import LINES, is_recording, read_json
from .lerobot import is_lerobot, read_lerobot

LARGEST_FILE = 2**36
"""Size of a recording that is read [B]: what reads it takes it in parts, or has a bound of its own."""
DEEPEST_FOLDER = 4
"""Folders below one in which recordings are looked for."""
READERS: dict[tuple[str, ...], Callable[[Path], list[Recording]]] = {
    (*tables.ENDINGS, ".log"): tables.read_table,
    (".json", *LINES): read_json,
    (".mat",): arrays.read_matlab,
    (".npz", ".npy"): arrays.read_numpy,
    arrays.HDF5: arrays.read_hdf5,
    arrays.TENSORS: arrays.read_tensors,
    bags.ENDINGS: bags.read_bag,
}
KNOWN = tuple(ending for endings in READERS for ending in endings if ending not in (".log", ".npy"))


def read_recordings(path: Path) -> list[Recording]:
    """The recordings of a file, or of all files of a folder; where it has none itself, of the folders in it.

    Raises:
        LogError: one sentence that says which file, what is wrong with it and what to do.
    """
    return read_source(path)[0]


def read_source(path: Path) -> tuple[list[Recording], list[str]]:
    """The recordings as :func:`read_recordings` has them, and sentences on files of a folder that hold no sample.

    Raises:
        LogError: one sentence that says which file, what is wrong with it and what to do.
    """
    if not path.exists():
        raise LogError(f"{path}: no such file or folder.")
    if not path.is_dir() or is_lerobot(path) or bags.is_bag(path):
        return _read_one(path), []
    empty: dict[Path, NoRecording] = {}
    found = _in_folder(path, empty)
    if not found and empty:
        raise next(iter(empty.values()))
    if not found:
        raise LogError(
            f"{path}: holds no recording that is known: {', '.join(KNOWN)}, or a LeRobot data set; nor do the folders "
            "in it."
        )
    recordings = [
        replace(recording, name="-".join((*file.relative_to(path).parts[:-1], recording.name)))
        for file, inside in found
        for recording in inside
    ]
    names: dict[str, Path] = {}
    for recording in recordings:
        if recording.name in names:
            other = names[recording.name].name
            raise LogError(f"{recording.source}: {other} has the same name; rename one, or import one at a time.")
        names[recording.name] = recording.source
    return recordings, [_why_left(file, fault) for file, fault in empty.items()]


def _why_left(file: Path, fault: NoRecording) -> str:
    """What is wrong with a file of a folder, without what to do about it: it is left out."""
    return f"{file.name} {str(fault).removeprefix(f'{file}: ').partition('; ')[0].rstrip('.')}"


def _in_folder(folder: Path, empty: dict[Path, NoRecording], depth: int = 0) -> list[tuple[Path, list[Recording]]]:
    """Files, bags and data sets of a folder with their recordings, else those of the folders in it.

    Folders of logs that were imported already are left out.

    Args:
        folder: to look into.
        empty: takes the files that hold no sample.
        depth: of the folder below the one that was asked for.
    """
    entries = [path for path in sorted(folder.iterdir()) if not path.name.startswith(".")]
    found = []
    for path in filter(_is_recording, entries):
        try:
            found.append((path, _read_one(path)))
        except NoRecording as fault:
            empty[path] = fault
    if found or depth == DEEPEST_FOLDER:
        return found
    folders = (path for path in entries if path.is_dir() and not (path / FOLDER_DEFAULTS).is_file())
    for inner in folders:
        found += [(inner, read_lerobot(inner))] if is_lerobot(inner) else _in_folder(inner, empty, depth + 1)
    return found


def _read_one(path: Path) -> list[Recording]:
    """The recordings of one file, bag or data set, within bounds."""
    try:
        if not path.is_dir():
            regular(path, LARGEST_FILE)
        recordings = _read(path)
    except DocumentError as error:
        raise LogError(f"{error}; export it again.") from None
    for name in (name for recording in recordings for name in recording.columns):
        if len(name) > LONGEST_CELL:
            raise LogError(f"{path}: column '{name[:40]}...' has a name of {len(name)} letters; give it a shorter one.")
    return recordings


def _read(path: Path) -> list[Recording]:
    if path.is_dir():
        return read_lerobot(path) if is_lerobot(path) else bags.read_bag(path)
    ending = path.suffix.lower()
    reader = next((reader for endings, reader in READERS.items() if ending in endings), None)
    if reader:
        return reader(path)
    if ending in arrays.PICKLES:
        raise LogError(
            f"{path}: is a pickle, which is not loaded, for it can run any code; save its arrays as a file of named "
            f"arrays, np.savez('{path.stem}.npz', **arrays), where arrays is a dict with a vector for each column."
        )
    raise LogError(f"{path}: is of no kind that is read; there are {', '.join(KNOWN)}, and LeRobot data sets.")


def _is_recording(path: Path) -> bool:
    """Whether a file of a folder is a recording, and not a licence or a description."""
    if path.name.startswith(".") or path.name.lower() in ("readme.txt", "license.txt"):
        return False
    if path.is_dir():
        return bags.is_bag(path)
    return is_recording(path) if path.suffix.lower() == ".json" else path.suffix.lower() in KNOWN
