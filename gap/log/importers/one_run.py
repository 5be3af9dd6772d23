"""Files of one folder that are one recording: a file for each joint, or one for the state and one for the command."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from ..types import COMMANDS, SIGNAL_UNITS, LogError
from .claims import plain
from .clocks import find_clock, in_force, offset_note, overlap, together
from .names import said
from .positions import bare
from .recording import Recording

TELLING = re.compile(
    r"[_\W]*(states?|commands?|cmds?|feedback|measured|goals?|targets?|actions?|sensors?|motors?)[_\W]*", re.I
)
"""Words that tell the state's file of a run from the command's."""


def paired(recordings: Sequence[Recording], source: Path) -> list[Recording]:
    """The runs that recordings of a folder are, where each has a file for its state and one for its command; else
    none."""
    stems: dict[str, list[Recording]] = {}
    for one in recordings if source.is_dir() else ():
        stems.setdefault(TELLING.sub("", one.name), []).append(one)
    pairs = [_state_and_command(own) for own in stems.values()]
    return [_beside(*pair, source) for pair in pairs if pair] if all(pairs) else []


def check_runs(recordings: list[Recording], joints: Collection[str], source: Path) -> None:
    """Refuse recordings that look like a joint each of one recording.

    Args:
        recordings: of one folder, with the same columns.
        joints: that the robot has, empty where nobody names one.
        source: the folder.

    Raises:
        LogError: two or more are called as joints of the robot, or their clocks say that all were made at one time.
    """
    if len(recordings) < 2 or not source.is_dir() or _name_joints(recordings[0]):
        return
    known = {bare(joint): joint for joint in joints}
    called = [known[bare(one.name)] for one in recordings if bare(one.name) in known]
    clock = find_clock(recordings[0]).name
    times = [one.columns[clock] for one in recordings if clock in one.columns]
    if len(called) > 1 or (not called and together(times) and _differ(recordings, clock)):
        files = ", ".join(one.source.name for one in recordings[:3]) + (", ..." if len(recordings) > 3 else "")
        raise LogError(
            f"{source}: {files} look like a file for each joint of one recording, and not like runs; join them into "
            f"one table with columns {called[0] if called else recordings[0].name}.position, ..., or import each file "
            "on its own."
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


# --- a file for each joint -------------------------------------------------------------------------------------------


def _name_joints(recording: Recording) -> bool:
    """Whether columns say which joint they are of."""
    by_format = {role.rpartition(".")[0] for role in recording.roles.values()}
    by_format |= {joint for joint, _ in recording.parts.values()}
    by_name = {plain(said(name).joint) for name in recording.columns if said(name).signal in SIGNAL_UNITS}
    return bool((by_format | by_name) - {"", "joint"})


def _differ(recordings: Sequence[Recording], clock: str) -> bool:
    """Whether no recording is a copy of another, and none is called as a signal."""
    return not any(said(one.name).signal for one in recordings) and not any(
        all(np.array_equal(one.columns[key], other.columns[key], equal_nan=True) for key in one.columns if key != clock)
        for one, other in combinations(recordings, 2)
    )
