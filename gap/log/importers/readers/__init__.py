"""Readers of foreign files, one a format: each gives recordings with their columns as they are called there."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from .....common.documents import DocumentError, regular
from ...sidecar import FOLDER_DEFAULTS
from ...types import COMMANDS, LogError
from ..clocks import find_clock, in_force, offset_note, overlap, together
from ..lines import bare
from ..names import said
from ..recording import NoRecording, Recording
from . import bags, tables, trees
from .documents import LINES, read_json
from .tables import is_lerobot, read_lerobot
from .text import LONGEST_CELL

LARGEST_FILE = 2**36
"""Size of a recording that is read [B]: what reads it takes it in parts, or has a bound of its own."""
DEEPEST_FOLDER = 4
"""Folders below one in which recordings are looked for."""
READERS: dict[tuple[str, ...], Callable[[Path], list[Recording]]] = {
    (*tables.ENDINGS, ".log"): tables.read_table,
    (".json", *LINES): read_json,
    (".mat",): trees.read_matlab,
    (".npz",): trees.read_numpy,
    trees.HDF5: trees.read_hdf5,
    trees.TENSORS: trees.read_tensors,
    bags.ENDINGS: bags.read_bag,
}
KNOWN = tuple(ending for endings in READERS for ending in endings if ending != ".log")
TELLING = re.compile(
    r"[_\W]*(states?|commands?|cmds?|feedback|measured|goals?|targets?|actions?|sensors?|motors?)[_\W]*", re.I
)
"""Words that tell the state's file of a run from the command's."""


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
    empty: dict[Path, LogError] = {}
    found = _in_folder(path, empty)
    if not found:
        kinds = f"{', '.join(KNOWN)}, or a LeRobot data set; nor do the folders in it."
        raise next(iter(empty.values()), LogError(f"{path}: holds no recording that is known: {kinds}"))
    recordings: dict[str, Recording] = {}
    for file, recording in ((file, recording) for file, inside in found for recording in inside):
        name = "-".join((*file.relative_to(path).parts[:-1], recording.name))
        if name in recordings:
            other = recordings[name].source.name
            raise LogError(f"{recording.source}: {other} has the same name; rename one, or import one at a time.")
        recordings[name] = replace(recording, name=name)
    left = [f"{file.name} {str(fault).removeprefix(f'{file}: ').partition('; ')[0].rstrip('.')}"
            for file, fault in empty.items()]  # fmt: skip
    return [*recordings.values()], left


def _in_folder(folder: Path, empty: dict[Path, LogError], depth: int = 0) -> list[tuple[Path, list[Recording]]]:
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
        except LogError as fault:
            if not isinstance(fault, NoRecording) and path.suffix.lower() != ".json":
                raise
            empty[path] = fault
    if not found and depth < DEEPEST_FOLDER:
        for inner in (path for path in entries if path.is_dir() and not (path / FOLDER_DEFAULTS).is_file()):
            found += [(inner, read_lerobot(inner))] if is_lerobot(inner) else _in_folder(inner, empty, depth + 1)
    return found


def _is_recording(path: Path) -> bool:
    """Whether an entry of a folder may be a recording, and not a licence, or JSON that describes a table."""
    if path.is_dir() or path.name.lower() in ("readme.txt", "license.txt"):
        return path.is_dir() and bags.is_bag(path)
    described = path.suffix.lower() == ".json" and any(path.with_suffix(end).is_file() for end in tables.ENDINGS)
    return path.suffix.lower() in KNOWN and not described


def _read_one(path: Path) -> list[Recording]:
    """The recordings of one file, bag or data set, within bounds."""
    ending = path.suffix.lower()
    reader = next((reader for endings, reader in READERS.items() if ending in endings), None)
    if ending in trees.PICKLES:
        raise LogError(f"{path}: holds no named arrays, or can run any code; {trees.save_as(path)}.")
    if path.is_dir():
        reader = read_lerobot if is_lerobot(path) else bags.read_bag
    if reader is None:
        raise LogError(f"{path}: is of no kind that is read; there are {', '.join(KNOWN)}, and LeRobot data sets.")
    try:
        if not path.is_dir():
            regular(path, LARGEST_FILE)
        recordings = reader(path)
    except DocumentError as error:
        raise LogError(f"{error}; export it again.") from None
    if long := next((name for one in recordings for name in (*one.columns, *one.left) if len(name) > LONGEST_CELL), ""):
        raise LogError(f"{path}: column '{long[:40]}...' has a name of {len(long)} letters; give it a shorter one.")
    return recordings


# --- files that are one recording: a file for each joint, or one for the state and one for the command ----------------


def paired(recordings: Sequence[Recording], source: Path) -> list[Recording]:
    """The runs that recordings of a folder are, where each has a file for its state and one for its command; else
    none."""
    stems: dict[str, list[Recording]] = {}
    for one in recordings if source.is_dir() else ():
        stems.setdefault(TELLING.sub("", one.name), []).append(one)
    pairs = [_state_and_command(own) for own in stems.values()]
    return [_beside(*pair, source) for pair in pairs if pair] if all(pairs) else []


def check_runs(recordings: list[Recording], joints: Collection[str], source: Path) -> None:
    """Refuse files that look like a joint each of one recording.

    Args:
        recordings: of one folder, with the same columns.
        joints: that the robot has, empty where nobody names one.
        source: the folder.

    Raises:
        LogError: two or more are called as joints of the robot, or their clocks say that all were made at one time.
    """
    files = {one.source for one in recordings}
    if (
        len(files) < 2
        or len(files) < len(recordings)
        or any(role.count(".") for one in recordings for role in one.roles.values())
    ):
        return
    called = {bare(one.name) for one in recordings} & {*map(bare, joints)}
    clock = find_clock(recordings[0]).name
    times = [one.columns[clock] for one in recordings if clock in one.columns]
    values = {
        one.name: b"".join(one.columns[name].tobytes() for name in one.columns if name != clock) for one in recordings
    }
    if len(called) > 1 or (together(times) and len({*values.values()}) == len(recordings)):
        raise LogError(
            f"{source}: {', '.join(sorted(file.name for file in files)[:3])} look like a file for each joint of one "
            f"recording, and not like runs; join them into one table with columns "
            f"{recordings[0].name}.position, ..., or import each file on its own."
        )


# --- a file for the state and one for the command --------------------------------------------------------------------


def _state_and_command(own: Sequence[Recording]) -> tuple[Recording, Recording] | None:
    """Of two recordings the one that has positions and the one that has what was commanded meanwhile; else None."""
    signals = [{said(name).signal for name in one.columns} for one in own]
    told = [bool(has & {*COMMANDS[:2]}) for has in signals]
    if len(own) != 2 or told[0] == told[1] or ["position" in has for has in signals] != [not one for one in told]:
        return None
    state, command = own if told[1] else own[::-1]
    times = [one.columns.get(find_clock(one).name) for one in (state, command)]
    if times[0] is None or times[1] is None or not overlap([times[0], times[1]]):
        return None
    return state, command


def _beside(state: Recording, command: Recording, source: Path) -> Recording:
    """A state with the command that was in force over most of each sample."""
    at, clock = state.columns[find_clock(state).name], find_clock(command).name
    time = command.columns[clock]
    columns = {f"command.{name}" if name in state.columns else name: in_force(time, values, at)[0]
               for name, values in command.columns.items() if name != clock}  # fmt: skip
    late = in_force(time, time, at)[1]
    there = np.logical_and.reduce([np.isfinite(values) for values in columns.values()])
    kept = {name: values[there] for name, values in (state.columns | columns).items()}
    notes = [*state.notes, *command.notes,
             f"{state.source.name} and {command.source.name} are the state and the command of one run"]  # fmt: skip
    notes += [offset_note(command.source.name, f"{late:.3g}")] * (late > 0.0)
    name = TELLING.sub("", state.name) or source.resolve().name
    return replace(state, name=name, columns=kept, source=source, notes=tuple(dict.fromkeys(notes)),
                   facts=command.facts | state.facts, left=command.left | state.left)  # fmt: skip
