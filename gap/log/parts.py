"""Cross-validation folds: pieces of runs to fit on (A, B), and a held-out test part that measures the gain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .types import Array, LogError, MeasuredRun

WARM_UP = 1.5  # [s] replayed but not judged, so that what came before is forgotten; a quiet start is sought as long
STATE_SAMPLES = 2.5  # periods either side of a sample, at least, over which its speed is read
AWAY_COST = 0.5  # [1/s] of the range of a motion, by which a speed must be read better to be read at an end of a search
SPEED_REACH = 0.03  # [s] either side of a sample over which its speed is read, and twice that
QUIET_REACH = 0.05  # [s] either side of a sample over which its motion is judged
# of a run that is not judged at its start, where what came before is unknown: commands under way, on which side of a
# play the link lies
START_SHARE, LEAST_START, MOST_START = 0.04, 0.1, 1.0  # share of it, and [s] between which that lies
SWING_SHARE = 0.125  # of a run that is not judged at its start where the link hangs on a spring, whose state is unknown
FEWEST_PIECES = 4  # a run is cut into at least, where there are too few runs to hold whole ones out
PIECE_LENGTH = 6.0  # [s] that a piece takes at most, about: what changes along a run, as in a chirp, is in every part
LEAST_FREE = 0.5  # [s] that is judged at least between two stretches in which something touches what a joint moves
GAP_PERIODS = 3.5  # between two samples, from which some lack
LONG_RUN = 60.0  # [s] from which runs are cut however many there are: each part needs what only one of them shows
PARTS = FIT_A, FIT_B, TEST = range(3)
ENOUGH_RUNS = 2 * len(PARTS)  # to hold whole ones out


@dataclass(frozen=True, eq=False)
class Unit:
    """A piece of a run that is replayed on its own.

    Attributes:
        run: index of its run.
        part: FIT_A or FIT_B (each chooses what the other fitted), or TEST, which no fit and no choice sees.
        start, stop: samples of the run, warm-up included.
        judged: first sample, counted from ``start``, whose error counts.
        state: position [rad] and speed [rad/s] at ``start``.
    """

    run: int
    part: int
    start: int
    stop: int
    judged: int
    state: tuple[float, float]


def cut(runs: Sequence[MeasuredRun], joint: str, test_group: str | None = None) -> list[Unit]:
    """Cut runs into units and deal them out.

    Whole runs (or groups of runs, where the sidecars name them and there are at least three) are dealt out if there
    are enough; else, and of a long run without a group, pieces, shifted from run to run so that each part gets every
    excitation. A single run beside the test group is cut into pieces as well. Stretches in which something that no
    model has touches what the joint moves are in no unit.

    Args:
        runs: of one machine.
        joint: that is judged.
        test_group: group of runs to keep for the test.

    Raises:
        LogError: the test group does not exist, or nothing is left to fit on.
    """
    return [free for unit in _dealt(runs, joint, test_group) for free in _untouched(runs, joint, unit)]


def _untouched(runs: Sequence[MeasuredRun], joint: str, unit: Unit) -> list[Unit]:
    """A unit without the stretches in which something touches what the joint moves."""
    log, time = runs[unit.run].joints[joint], runs[unit.run].time
    if log.touched is None or not log.touched[unit.start : unit.stop].any():
        return [unit]
    free = log.touched[unit.start : unit.stop] < 0.5
    found = []
    for a, b in stretches(free):
        found += within(unit, unit.start + a, unit.start + b, time, log.position, WARM_UP)
    return found


def within(unit: Unit, start: int, stop: int, time: np.ndarray, position: np.ndarray, unjudged: float) -> list[Unit]:
    """A part of a unit, from where it was measured; none where too little of it is left to judge.

    Args:
        unit: of a run.
        start, stop: samples of the run.
        time, position: of the run (n,) [s], [rad].
        unjudged: time at its start that is replayed only [s], if it is not the start of the unit.
    """
    judged, state = unit.start + unit.judged, unit.state
    if start > unit.start:
        judged = max(judged, int(np.searchsorted(time, time[start] + unjudged)))
        state = state_at(time, position, start)
    if judged >= stop or time[stop - 1] - time[judged] < LEAST_FREE:
        return []
    return [replace(unit, start=start, stop=stop, judged=max(judged - start, 1), state=state)]


def _dealt(runs: Sequence[MeasuredRun], joint: str, test_group: str | None) -> list[Unit]:
    """The same with what is touched."""
    groups = _groups(runs)
    names = sorted(set(groups), key=groups.index)
    if test_group is not None:
        held_out(runs, test_group)
        rest = [name for name in names if name != test_group]
        if len(rest) > 1:
            parts = {name: k % 2 for k, name in enumerate(rest)}
            return [
                _unit(runs, k, joint, TEST if g == test_group else parts[g], 0.0, 1.0) for k, g in enumerate(groups)
            ]
        order = {k: n for n, k in enumerate(k for k, g in enumerate(groups) if g != test_group)}
        units: list[Unit] = []
        for k in range(len(runs)):
            if [k] == [*order]:  # the only one that is left: both parts need pieces of it
                units += _pieces(runs, k, joint, FEWEST_PIECES, 2)
            else:
                units.append(_unit(runs, k, joint, order[k] % 2 if k in order else TEST, 0.0, 1.0))
        return units
    windows = all("excerpt" in run.meta for run in runs)
    if len(runs) >= (3 if windows else ENOUGH_RUNS):
        if 3 <= len(names) < len(runs):
            return [_unit(runs, k, joint, names.index(g) % 3, 0.0, 1.0) for k, g in enumerate(groups)]
        if windows:  # of long logs were dealt out as they were chosen
            return [_unit(runs, k, joint, int(run.meta["excerpt"]), 0.0, 1.0) for k, run in enumerate(runs)]
    least = max(FEWEST_PIECES, -(-ENOUGH_RUNS // len(runs)))
    dealt: list[Unit] = []
    for k, run in enumerate(runs):
        if len(runs) >= ENOUGH_RUNS and run.time[-1] - run.time[0] < LONG_RUN:
            dealt.append(_unit(runs, k, joint, (k + k // 3) % 3, 0.0, 1.0))
        else:
            dealt += _pieces(runs, k, joint, least, 3, k)
    return dealt


def held_out(runs: Sequence[MeasuredRun], group: str | None) -> frozenset[int]:
    """Indices of the runs of a group that is kept for the test; none without a group.

    Raises:
        LogError: the group does not exist, or nothing is left to fit on.
    """
    if group is None:
        return frozenset()
    groups = _groups(runs)
    if group not in groups:
        raise LogError(f"there is no group '{group}' to test on; the logs have {', '.join(dict.fromkeys(groups))}.")
    if set(groups) == {group}:
        raise LogError(f"all runs are in the group '{group}'; nothing is left to fit on.")
    return frozenset(k for k, name in enumerate(groups) if name == group)


def _groups(runs: Sequence[MeasuredRun]) -> list[str]:
    return [str(run.meta.get("group", run.name)) for run in runs]


def _pieces(runs: Sequence[MeasuredRun], k: int, joint: str, least: int, parts: int, shift: int = 0) -> Iterator[Unit]:
    """A run in so many pieces at least, dealt to the first so many parts in turn from part ``shift`` on."""
    length = float(runs[k].time[-1] - runs[k].time[0])
    count = max(least, round(length / PIECE_LENGTH))
    if parts == 3 and length >= LONG_RUN:
        shift = _first(runs[k], joint, count)
    for piece in range(count):
        yield _unit(runs, k, joint, (piece + shift) % parts, piece / count, (piece + 1) / count)


def _first(run: MeasuredRun, joint: str, count: int) -> int:
    """Part of the first piece of a long run that puts the piece of the fastest commands into FIT_B, the one before it
    into FIT_A: what a sweep reaches at its end alone, its fits must both see.
    """
    log = run.joints[joint]
    command = next((item for item in (log.goal, log.goal_velocity) if item is not None), log.position)
    known = np.isfinite(command)
    way = np.abs(np.diff(command[known], prepend=command[known][0]))
    ends = np.linspace(run.time[0], run.time[-1], count + 1)
    fastest = int(np.histogram(run.time[known], ends, weights=way)[0].argmax())
    return (FIT_B - fastest) % 3


def _unit(runs: Sequence[MeasuredRun], k: int, joint: str, part: int, begin: float, end: float) -> Unit:
    time = runs[k].time
    span = time[-1] - time[0]
    first, last = time[0] + begin * span, time[0] + end * span
    start = _quiet(time, runs[k].joints[joint].position, first - 2.0 * WARM_UP, first - WARM_UP) if begin > 0.0 else 0
    swing = min(max(START_SHARE * span, LEAST_START), MOST_START)
    if runs[k].joints[joint].link_position is not None:
        swing = min(SWING_SHARE * span, WARM_UP)
    judged = int(np.searchsorted(time, first if begin > 0.0 else first + swing))
    if begin == 0.0 and "excerpt" in runs[k].meta:  # a window of a long log: something came before it
        start = _quiet(time, runs[k].joints[joint].position, first, first + WARM_UP)
        judged = int(np.searchsorted(time, time[start] + WARM_UP))
    stop = int(np.searchsorted(time, last, side="right")) if end < 1.0 else len(time)
    return Unit(k, part, start, stop, max(judged - start, 1), state_at(time, runs[k].joints[joint].position, start))


def _quiet(time: np.ndarray, position: np.ndarray, earliest: float, latest: float) -> int:
    """Sample between two times at which the joint moves least: there both sides of a play or spring likely rest."""
    a, b = np.searchsorted(time, [earliest, latest])
    samples = np.arange(a, max(b, a + 1))
    reach = max(round(QUIET_REACH / float(np.median(np.diff(time)))), 1)
    before, after = np.maximum(samples - reach, 0), np.minimum(samples + reach, len(time) - 1)
    return int(samples[np.argmin(np.abs(position[after] - position[before]))])


def steady(time: np.ndarray, position: np.ndarray, command: np.ndarray, earliest: float, latest: float) -> int:
    """Sample in the middle of two times, or another between them at which a speed is read far better: the motion bends
    less there, and no command that may still be under way has jumped.

    Args:
        time, position: of a run (n,).
        command: of it, of any unit (n,).
        earliest, latest: between which [s].
    """
    a, b = np.searchsorted(time, [earliest, latest])
    samples = np.arange(a, max(b, a + 1))
    reach = max(round(SPEED_REACH / float(np.median(np.diff(time)))), 1)

    def slope(reach: int) -> np.ndarray:
        before, after = np.maximum(samples - reach, 0), np.minimum(samples + reach, len(time) - 1)
        return (position[after] - position[before]) / (time[after] - time[before])

    span = float(np.nanmax(command) - np.nanmin(command)) if np.isfinite(command).any() else 0.0
    jumps = np.nan_to_num(np.abs(np.diff(command, prepend=command[:1]))) * np.ptp(position) / max(span, 1e-12)
    recent = np.array([jumps[max(k - 2 * reach, 0) : k + 1].max() for k in samples]) / (2.0 * SPEED_REACH)
    middle, half = 0.5 * (earliest + latest), 0.5 * (latest - earliest)
    away = AWAY_COST * np.ptp(position) * np.abs(time[samples] - middle) / half
    return int(samples[np.argmin(np.abs(slope(reach) - slope(2 * reach)) + recent + away)])


def state_at(time: np.ndarray, position: np.ndarray, sample: int, width: float = SPEED_REACH) -> tuple[float, float]:
    """Position [rad] and speed [rad/s] at a sample, from a parabola through the positions around it."""
    width = max(width, STATE_SAMPLES * float(np.median(np.diff(time[max(sample - 5, 0) : sample + 6]))))
    near = np.flatnonzero(np.abs(time - time[sample]) <= width)
    if len(near) < 4 or np.ptp(position[near]) == 0.0:
        return float(position[sample]), 0.0
    fit = np.polynomial.polynomial.polyfit(time[near] - time[sample], position[near], 2 if len(near) > 4 else 1)
    return float(fit[0]), float(fit[1])


# --- stretches of samples in which something holds -------------------------------------------------------------------


def stretches(holds: np.ndarray) -> list[tuple[int, int]]:
    """First sample and end of each stretch in which all of ``holds`` (n,) is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


# --- samples that a recording lacks ----------------------------------------------------------------------------------
# What was commanded meanwhile is not known. A goal pulls a joint back to where it would have been. A torque does not:
# what acted meanwhile stays in the speed for good, so that a joint that follows torques begins anew behind a gap.


def gaps(time: Array) -> np.ndarray:
    """Last samples before the gaps of a clock (n,) [s]."""
    steps = np.diff(time)
    return np.flatnonzero(steps > GAP_PERIODS * np.median(steps))


def lost(time: Array, command: Array) -> np.ndarray:
    """Last samples before gaps (n,) in which the command changed."""
    missing = gaps(time)
    return missing[command[missing] != command[missing + 1]]


def known_commands(time: Array, command: Array, forgotten: float = WARM_UP) -> np.ndarray:
    """Samples (n,) whose motion follows from commands that were logged.

    A replay holds the last command across a gap. Where the next one differs, what came between is unknown, and its
    motion is forgotten some time after; where gaps follow each other faster, half of what lies between them still
    counts.

    Args:
        time: of the samples (n,) [s].
        command: goal [rad] or torque [N.m] (n,).
        forgotten: time until then [s].
    """
    known = np.ones(len(time), bool)
    ends = lost(time, command)
    for k, end in zip(ends, [*time[ends[1:]], time[-1]], strict=False):
        first = time[k + 1]
        known[(time >= time[k] - SPEED_REACH) & (time < first + min(forgotten, 0.5 * (end - first)))] = False
    return known


def between_gaps(runs: Sequence[MeasuredRun], joint: str, units: Sequence[Unit]) -> list[Unit]:
    """Pieces of a joint that follows torques, cut where a recording lacks some; what is too short to judge is left out.

    They begin where no reading of the neighbours' accelerations reaches across the gap.

    Args:
        runs: of one machine.
        joint: that is judged.
        units: of :func:`cut`.
    """
    found: list[Unit] = []
    for unit in units:
        time, log = runs[unit.run].time, runs[unit.run].joints[joint]
        command = log.torque_command
        ends = np.zeros(0, int) if command is None else lost(time, command)
        ends = ends[(ends >= unit.start) & (ends < unit.stop - 1)]
        if not len(ends):
            found.append(unit)
            continue
        begins = np.searchsorted(time, time[ends + 1] + SPEED_REACH)
        for start, stop in zip([unit.start, *begins], [*(ends + 1), unit.stop], strict=True):
            found += within(unit, int(start), int(stop), time, log.position, LEAST_START)
    return found
