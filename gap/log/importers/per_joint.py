"""Files of one folder that are a joint each of one recording: joined where their clock is one, else refused."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from ..types import SIGNAL_UNITS, Array, LogError
from .clocks import find_clock
from .column import plain, without_doubt
from .evidence import CLOCKS, clock_units
from .in_table import said_together
from .names import SHORT, said
from .recording import Recording
from .spelling import bare

SINCE_1970 = (1e9, 4e9)
"""Seconds of 2001 to 2096, as a clock of the day counts them; it tells recordings of one time from others."""
DAYS_OF_1970 = 25569.0
"""1970-01-01 as a spreadsheet counts days."""
OVERLAP = 0.5
"""Share of the longest recording for which all run, of joints that were recorded together."""
SAME_RATE = 0.98
"""Share of the longest median step from which a clock is as slow as the slowest: the first of these is taken."""
HELD = frozenset(["goal", "goal_velocity", "torque_command", "enabled"])
"""Signals that hold until the next one is sent."""


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
    if len(recordings) < 2 or not source.is_dir() or _name_joints(recordings[0]):
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


def _name_joints(recording: Recording) -> bool:
    """Whether columns say which joint they are of."""
    by_format = {role.rpartition(".")[0] for role in recording.roles.values()}
    by_name = {plain(said(name).joint) for name in recording.columns if said(name).signal in SIGNAL_UNITS}
    return bool((by_format | by_name) - {"", "joint"})


def together(times: Sequence[Array]) -> bool:
    """Whether clocks of the day say that all recordings were made at one time."""
    return len(times) > 1 and all(map(_units_of_the_day, times)) and _overlap(times)


def _units_of_the_day(time: Array) -> list[str]:
    """Units in which a clock is of the day; none where it may begin at any time."""
    since = {unit: CLOCKS[unit] * (time[0] - (DAYS_OF_1970 if unit == "d" else 0.0)) for unit in clock_units(time)}
    return [unit for unit, seconds in since.items() if SINCE_1970[0] < seconds < SINCE_1970[1]]


def _overlap(times: Sequence[Array]) -> bool:
    begin, end = max(time[0] for time in times), min(time[-1] for time in times)
    return bool(end - begin > OVERLAP * max(time[-1] - time[0] for time in times))


def _differ(recordings: Sequence[Recording], clock: str) -> bool:
    """Whether no recording is a copy of another, and none is called as a signal."""
    if any(said(one.name).signal for one in recordings):
        return False
    alike = [
        all(np.array_equal(one.columns[key], other.columns[key], equal_nan=True) for key in one.columns if key != clock)
        for one, other in combinations(recordings, 2)
    ]
    return not any(alike)


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
    columns, units, roles = {clock: at}, {}, {}
    for recording, joint, time in zip(recordings, joints, times, strict=True):
        spoken_of = said_together(recording.columns)
        for key, values in recording.columns.items():
            spoken, name = spoken_of[key], f"{joint}.{key}"
            if key == clock or spoken.signal == "time":
                continue
            role = recording.roles.get(key, "").rpartition(".")[2] or spoken.signal
            before = np.searchsorted(time, at, side="right") - 1
            columns[name] = (
                values[before] if role in HELD or len(np.unique(values)) < 3 else np.interp(at, time, values)
            )
            if role in SIGNAL_UNITS and not SHORT.fullmatch(spoken.how.lower()):  # of qd the numbers tell
                roles[name] = f"{joint}.{role}"
            if unit := recording.units.get(key, "") or without_doubt(spoken.unit):
                units[name] = unit
    facts = {key: value for key, value in first.facts.items() if all(one.facts.get(key) == value for one in recordings)}
    files = ", ".join(one.source.name for one in recordings)
    note = (
        f"{files} are taken for a joint each of one recording and joined on '{clock}' of {first.source.name}"
        f"{_rates(recordings, times, periods)}; where each is a run of its own, import it on its own"
    )
    notes = tuple(dict.fromkeys([*(note for one in recordings for note in one.notes), note]))
    return replace(
        first,
        name=source.resolve().name,
        columns=columns,
        source=source,
        facts=facts,
        roles=roles,
        notes=notes,
        units=units,
    )


def _rates(recordings: Sequence[Recording], times: Sequence[Array], periods: Sequence[float]) -> str:
    """That the slowest was joined on, and the rates, where they differ; else empty."""
    if min(periods) >= SAME_RATE * max(periods):
        return ""
    rates = [1.0 / (period * CLOCKS[_units_of_the_day(time)[0]]) for time, period in zip(times, periods, strict=True)]
    told = ", ".join(f"{one.source.name} at {rate:.4g} Hz" for one, rate in zip(recordings, rates, strict=True))
    return f", the slowest ({told})"
