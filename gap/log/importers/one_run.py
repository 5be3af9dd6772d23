"""Files of one folder that are one recording: a file for each joint, or one for the state and one for the command."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from ..types import COMMANDS, SIGNAL_UNITS, Array, LogError
from .claims import plain
from .clocks import CLOCKS, OVERLAP, clock_units, find_clock, in_force, offset_note, together, units_of_the_day
from .names import said
from .positions import bare
from .recording import Recording

SAME_RATE = 0.98
"""Share of the longest median step from which a clock is as slow as the slowest: the first of these is taken."""
HELD = frozenset(["goal", "goal_velocity", "torque_command", "enabled"])
"""Signals that hold until the next one is sent."""
TELLING = re.compile(
    r"[_\W]*(states?|commands?|cmds?|feedback|measured|goals?|targets?|actions?|sensors?|motors?)[_\W]*", re.I
)
"""Words that tell the state's file of a run from the command's."""


def paired(recordings: Sequence[Recording], source: Path) -> list[Recording]:
    """The runs that recordings of a folder are, where each has a file for its state and one for its command; else
    none."""
    pairs = _states_and_commands(recordings) if source.is_dir() else []
    return [_beside(state, command, source) for state, command in pairs]


def joined(recordings: list[Recording], joints: Collection[str], source: Path) -> list[Recording]:
    """The recordings as they are where each is a run; the one recording that they are where each is one joint of it.

    Args:
        recordings: of one folder, with the same columns.
        joints: that the robot has, empty where nobody names one.
        source: the folder.

    Raises:
        LogError: they look like a joint each of one recording, and their clocks do not say which samples belong
            together, or nobody says that they are called as the joints.
    """
    if len(recordings) < 2 or not source.is_dir():
        return recordings
    if _name_joints(recordings[0]):
        return recordings
    known = {bare(joint): joint for joint in joints}
    names = [known.get(bare(one.name), "") for one in recordings]
    called = [name for name in names if name]
    clock = find_clock(recordings[0]).name
    times = [one.columns[clock] for one in recordings] if clock in recordings[0].columns else []
    if len(called) < 2 and not (len(called) == 0 and together(times) and _differ(recordings, clock)):
        return recordings
    if all(called) and len(set(called)) == len(recordings) and _one_clock(times):
        return [_join(recordings, called, clock, source)]
    files = ", ".join(one.source.name for one in recordings[:3]) + (", ..." if len(recordings) > 3 else "")
    label, signals = called[0] if called else recordings[0].name, [key for key in recordings[0].columns if key != clock]
    name = next((key for key in signals if said(key).signal == "position"), signals[0] if signals else "position")
    why = "" if called else "say robot= with a file whose joints are called so, or "
    raise LogError(
        f"{source}: {files} look like a file for each joint of one recording, and not like runs; "
        f"{why}join them into one table with columns {label}.{name}, ..., or import each file on its own."
    )


# --- a file for the state and one for the command --------------------------------------------------------------------


def _states_and_commands(recordings: Sequence[Recording]) -> list[tuple[Recording, Recording]]:
    """Pairs of recordings of which one has positions and the other what was commanded meanwhile; all of them, or
    none."""
    stems: dict[str, list[Recording]] = {}
    for one in recordings:
        stems.setdefault(TELLING.sub("", one.name), []).append(one)
    pairs = []
    for own in stems.values():
        signals = [{said(name).signal for name in one.columns} for one in own]
        states = [one for one, has in zip(own, signals, strict=True) if "position" in has and not has & {*COMMANDS[:2]}]
        commands = [
            one for one, has in zip(own, signals, strict=True) if has & {*COMMANDS[:2]} and "position" not in has
        ]
        if len(own) != 2 or len(states) != 1 or len(commands) != 1:
            return []
        clocks = [find_clock(one).name for one in (states[0], commands[0])]
        if not all(clock in one.columns for clock, one in zip(clocks, (states[0], commands[0]), strict=True)):
            return []
        first, second = (one.columns[clock] for one, clock in zip((states[0], commands[0]), clocks, strict=True))
        begin, end = max(first[0], second[0]), min(first[-1], second[-1])
        if end - begin <= OVERLAP * max(first[-1] - first[0], second[-1] - second[0]):
            return []
        pairs.append((states[0], commands[0]))
    return pairs


def _beside(state: Recording, command: Recording, source: Path) -> Recording:
    """A state with the command that was in force over most of each sample."""
    time = state.columns[find_clock(state).name]
    clock = find_clock(command).name
    own = {name: values for name, values in command.columns.items() if name != clock}
    columns = {f"command.{name}" if name in state.columns else name: in_force(command.columns[clock], values, time)[0]
               for name, values in own.items()}  # fmt: skip
    late = in_force(command.columns[clock], command.columns[clock], time)[1]
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
    by_format = {role.rpartition(".")[0] for role in recording.roles.values()} | {
        joint for joint, _ in recording.parts.values()
    }
    by_name = {plain(said(name).joint) for name in recording.columns if said(name).signal in SIGNAL_UNITS}
    return bool((by_format | by_name) - {"", "joint"})


def _differ(recordings: Sequence[Recording], clock: str) -> bool:
    """Whether no recording is a copy of another, and none is called as a signal."""
    if any(said(one.name).signal for one in recordings):
        return False
    same: Callable[[Recording, Recording], bool] = lambda one, other: all(  # noqa: E731
        np.array_equal(one.columns[key], other.columns[key], equal_nan=True) for key in one.columns if key != clock
    )
    return not any(same(one, other) for one, other in combinations(recordings, 2))


def _one_clock(times: Sequence[Array]) -> bool:
    """Whether clocks are the same in each sample, or are of the day and go side by side.

    Others may begin at zero in each of several recordings, which no numbers tell from one.
    """
    if not times or not all(clock_units(time) and np.isfinite(time).all() for time in times):
        return False
    return all(np.array_equal(time, times[0]) for time in times) or together(times)


def _join(recordings: Sequence[Recording], joints: Sequence[str], clock: str, source: Path) -> Recording:
    """One recording on the slowest clock while all run: goals held, what was measured on straight lines.

    On a faster clock most samples of a slow file would lie on lines between two that were measured, without noise of
    their own.
    """
    times = [one.columns[clock] for one in recordings]
    periods = [float(np.median(np.diff(time))) for time in times]
    slowest = next(k for k, period in enumerate(periods) if period >= SAME_RATE * max(periods))
    first = recordings[slowest]
    begin, end = max(time[0] for time in times), min(time[-1] for time in times)
    at = times[slowest][(times[slowest] >= begin) & (times[slowest] <= end)]
    columns, parts = {clock: at}, {}
    for recording, joint, time in zip(recordings, joints, times, strict=True):
        for key, values in recording.columns.items():
            if key == clock or said(key).signal == "time":
                continue
            before = np.searchsorted(time, at, side="right") - 1
            stepped = said(key).signal in HELD or len(np.unique(values)) < 3
            columns[f"{joint}.{key}"] = values[before] if stepped else np.interp(at, time, values)
            parts[f"{joint}.{key}"] = joint, key
    facts = {key: value for key, value in first.facts.items() if all(one.facts.get(key) == value for one in recordings)}
    files = ", ".join(one.source.name for one in recordings)
    note = (
        f"{files} are taken for a joint each of one recording and joined on '{clock}' of {first.source.name}"
        f"{_rates(recordings, times, periods)}; where each is a run of its own, import it on its own"
    )
    notes = tuple(dict.fromkeys([*(note for one in recordings for note in one.notes), note]))
    return replace(
        first, name=source.resolve().name, columns=columns, source=source, facts=facts, notes=notes, parts=parts
    )


def _rates(recordings: Sequence[Recording], times: Sequence[Array], periods: Sequence[float]) -> str:
    """That the slowest was joined on, and the rates, where they differ; else empty."""
    if min(periods) >= SAME_RATE * max(periods):
        return ""
    rates = [1.0 / (period * CLOCKS[units_of_the_day(time)[0]]) for time, period in zip(times, periods, strict=True)]
    told = ", ".join(f"{one.source.name} at {rate:.4g} Hz" for one, rate in zip(recordings, rates, strict=True))
    return f", the slowest ({told})"
