"""Long logs in bounded memory: streamed in pieces, checked in whole, replayed in representative windows.

A diagnosis needs minutes of motion, not hours. The first pass streams every file once and checks each piece as a log of
its own. Each window of :data:`WINDOW_SECONDS` gets a feature vector: position, speeds of goal and joint, their changes,
temperature. Farthest-point clustering of the vectors picks kinds of motion. Each cluster gives three windows, early,
middle and late: one for each part of the data. The second pass keeps their samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pyarrow import parquet

from ..log.finding import Finding
from ..log.parts import GAP_PERIODS, PARTS, PIECE_LENGTH, SPEED_REACH, WARM_UP
from ..log.progress import Progress
from ..log.reader import iterate_runs, log_files, read_measured
from ..log.table import BATCH_ROWS
from ..log.types import LogError, MeasuredRun, MeasuredSet
from .data_set import check_run, middle_ones

MAX_SET_ROWS = 120_000  # of a data set that are held: ten minutes at 200 Hz
WINDOW_SECONDS = 2.0 * PIECE_LENGTH  # [s]
MIN_WINDOWS = 30  # that the rows must suffice for; windows of fast logs are shorter
MIN_WINDOW_SECONDS = 4.0 * WARM_UP  # [s], but not shorter than this: up to half of it finds a quiet start and warms up
JUDGED_IN_WHOLE = ("motion.none", "goal.still", "excitation.little")  # a long log may rest for a piece


@dataclass(frozen=True, eq=False)
class Survey:
    """What one pass over a file tells.

    Attributes:
        path: of the file.
        rows: samples in it.
        period: median sample period [s].
        starts: first row of each window that may be used (w,).
        features: description of each (w, f).
        findings: of the checks of every piece.
        joints: in the order of their columns.
    """

    path: Path
    rows: int
    period: float
    starts: np.ndarray
    features: np.ndarray
    findings: tuple[Finding, ...]
    joints: tuple[str, ...] = ()


def read_bounded(
    path: str | Path, most_rows: int = MAX_SET_ROWS, progress: Progress = lambda text: None
) -> MeasuredSet:
    """Read a measured log, or every log of a folder, into memory that does not grow with its length.

    Args:
        path: as of :func:`sealegs.gap.log.reader.read_measured`.
        most_rows: of the whole set; more than these are replaced by windows with about that many in all.
        progress: is told what goes on.

    Returns:
        The set; where rows were left out, its runs are windows and its ``findings`` those of the whole log.

    Raises:
        LogError: as :func:`sealegs.gap.log.reader.read_measured`.
    """
    path = Path(path)
    files = log_files(path)
    counts = [count_rows(file) for file in files]
    if sum(counts) <= most_rows:
        return read_measured(path)
    surveys = [survey(file, count, most_rows, progress) for file, count in zip(files, counts, strict=True)]
    for one in surveys:
        if one.joints != surveys[0].joints:
            raise LogError(
                f"{path}: {one.path.name} has the joints {', '.join(one.joints)}, {surveys[0].path.name} has "
                f"{', '.join(surveys[0].joints)}; keep one machine per folder"
            )
    chosen = choose(surveys, most_rows)
    runs: list[MeasuredRun] = []
    for one, picked in zip(surveys, chosen, strict=True):
        progress(f"reading windows of {one.path.name}")
        runs += _windows(one, picked, window_rows(one.period, most_rows))
    if not runs:
        raise LogError(
            f"{path}: no stretch of {WINDOW_SECONDS:g} s is without a gap in its samples; record the log again"
        )
    for run in runs:
        if run.robot != runs[0].robot:
            raise LogError(f"{path}: holds logs of {runs[0].robot!r} and {run.robot!r}; keep one machine per folder")
    findings = [
        replace(finding, run=one.path.stem) for one in surveys for finding, _ in middle_ones(list(one.findings))
    ]
    total, held = sum(one.rows for one in surveys), sum(len(run.time) for run in runs)
    seconds = sum(run.duration for run in runs)
    sentence = (
        f"The logs have {total:,} samples. All of them were checked; {len(runs)} windows with {held:,} samples "
        f"({seconds:.0f} s), chosen so that every kind of motion is among them, were replayed."
    )
    findings.append(Finding("log.excerpt", "note", None, None, sentence, value=held / total))
    return MeasuredSet(tuple(runs), path.stem if path.is_file() else path.resolve().name, tuple(findings))


def count_rows(path: Path) -> int:
    """Samples in a file, from its footer or its line breaks (an upper bound: empty lines count)."""
    try:
        if path.suffix == ".parquet":
            return parquet.read_metadata(path).num_rows
        lines = 0
        with path.open("rb") as file:
            while block := file.read(1 << 22):
                lines += block.count(b"\n")
        return lines
    except Exception:  # reading it properly says what is wrong with it
        return 0


def window_rows(period: float, most_rows: int) -> int:
    """Samples of one window; a set has three at least, whatever their rows."""
    return max(
        min(round(WINDOW_SECONDS / period), max(most_rows // MIN_WINDOWS, round(MIN_WINDOW_SECONDS / period))), 50
    )


# --- first pass ----------------------------------------------------------------------------------------------------


def survey(path: Path, rows: int, most_rows: int, progress: Progress = lambda text: None) -> Survey:
    """Check and describe a file, a piece at a time.

    Raises:
        LogError: as :func:`sealegs.gap.log.reader.iterate_runs`, or time runs backwards between pieces.
    """
    findings: list[Finding] = []
    features: list[np.ndarray] = []
    starts: list[int] = []
    size, first, period, last = 0, 0, 0.0, -np.inf
    carried: MeasuredRun | None = None
    joints: tuple[str, ...] = ()
    for piece in iterate_runs(path, BATCH_ROWS):
        progress(f"checking {path.name}: {100 * first / max(rows, 1):.0f} %")
        if piece.time[0] <= last:
            raise LogError(
                f"{path}: column 'time' runs backwards in row {first + 1} ({last:.9g} s, then {piece.time[0]:.9g} s); "
                "every sample needs a later time than the one before"
            )
        last = float(piece.time[-1])
        if not size:
            joints = tuple(piece.joints)
            period = piece.period
            size = window_rows(period, most_rows)
        new = [finding for finding in check_run(piece) if finding.code not in JUDGED_IN_WHOLE]
        findings = _reduced(findings, new)
        # windows go on over the end of a piece
        begin = first - (len(carried.time) if carried is not None else 0)
        joined = piece if carried is None else _joined(carried, piece)
        used = 0
        while used + size <= len(joined.time):
            part = joined.part(used, used + size)
            if float(np.diff(part.time).max()) <= GAP_PERIODS * period:
                starts.append(begin + used)
                features.append(describe(part))
            used += size
        carried = joined.part(used, len(joined.time)) if used < len(joined.time) else None
        first += len(piece.time)
    table = np.stack(features) if features else np.empty((0, 1))
    return Survey(path, first, period, np.array(starts, int), table, tuple(findings), joints)


def _reduced(findings: list[Finding], new: list[Finding]) -> list[Finding]:
    """At most a few findings of each kind, the first ones: a fault in every piece must not fill the memory."""
    kept = list(findings)
    for finding in new:
        same = [f for f in kept if f.fault == finding.fault]
        if len(same) < 20:
            kept.append(finding)
    return kept


def describe(run: MeasuredRun) -> np.ndarray:
    """What kind of motion a window has: per joint position, amplitude, speeds of joint and goal, change of speed, duty
    at its end, rest, temperature (f,). Sizes are logarithms, so that small and slow motion is a kind of its own.
    """
    step = max(round(SPEED_REACH / run.period), 1)
    time = run.time[::step]
    numbers = []
    for log in run.joints.values():
        position = log.position[::step]
        speed = np.diff(position) / np.diff(time)
        goal_speed = np.zeros(1) if log.goal is None else np.diff(log.goal[::step]) / np.diff(time)
        duty = np.zeros(1) if log.duty is None else np.nan_to_num(np.abs(log.duty))
        warm = 0.0 if log.temperature is None else float(np.nan_to_num(np.nanmean(log.temperature[-step:])))
        numbers += [
            float(np.mean(position)),
            np.log10(np.std(position) + 1e-3),
            np.log10(np.sqrt(np.mean(speed**2)) + 1e-2),
            np.log10(np.abs(speed).max() + 1e-1),
            np.log10(np.sqrt(np.mean(goal_speed**2)) + 1e-2),
            np.log10(np.abs(goal_speed).max() + 1e-1),
            np.log10(np.sqrt(np.mean(np.diff(speed) ** 2)) / SPEED_REACH + 1.0),
            2.0 * float(np.quantile(duty, 0.98)),
            float(np.mean(np.abs(speed) < 0.05)),
            warm / 20.0,
        ]
    return np.array(numbers)


# --- choice --------------------------------------------------------------------------------------------------------


def choose(surveys: Sequence[Survey], most_rows: int) -> list[list[tuple[int, int]]]:
    """Windows of each file, as places in ``starts``, each with the part of the data that it is for."""
    table = np.concatenate([one.features for one in surveys if len(one.starts)] or [np.empty((0, 1))])
    owner = np.concatenate([np.full(len(one.starts), k) for k, one in enumerate(surveys)]).astype(int)
    place = np.concatenate([np.arange(len(one.starts)) for one in surveys]).astype(int)
    sizes = [window_rows(one.period, most_rows) for one in surveys]
    room = max(most_rows // max(sizes), 3)
    picked: list[list[tuple[int, int]]] = [[] for _ in surveys]
    for k, part in spread(table, room):
        picked[owner[k]].append((int(place[k]), part))
    return picked


def spread(features: np.ndarray, count: int) -> list[tuple[int, int]]:
    """``count`` rows of a table (w, f), such that no row is far from all chosen ones, each with a part of the data:
    of every three that are alike, one for each part.
    """
    total = len(features)
    if total <= count:
        return [(k, k % len(PARTS)) for k in range(total)]
    scaled = features / np.maximum(np.std(features, axis=0), 0.15)
    liveliest = int(np.argmax(scaled.sum(axis=1)))
    centres, distance = [liveliest], np.linalg.norm(scaled - scaled[liveliest], axis=1)
    nearest = np.zeros(total, int)
    while len(centres) < max(count // 3, 1) and distance.max() > 1e-9:
        farthest = int(distance.argmax())
        away = np.linalg.norm(scaled - scaled[farthest], axis=1)
        nearest = np.where(away < distance, len(centres), nearest)
        distance = np.minimum(distance, away)
        centres.append(farthest)
    chosen: list[tuple[int, int]] = []
    for k in range(len(centres)):
        members = np.flatnonzero(nearest == k)
        at = np.unique(np.round(np.array([1 / 6, 1 / 2, 5 / 6]) * (len(members) - 1)).astype(int))
        chosen += [(int(members[j]), (k + turn) % len(PARTS)) for turn, j in enumerate(at)]
    rest = np.setdiff1d(np.arange(total), [k for k, _ in chosen])
    missing = min(count - len(chosen), len(rest))
    if missing > 0:  # small clusters leave room: more of the log, evenly
        further = np.linspace(0, len(rest) - 1, missing).astype(int)
        chosen += [(int(rest[j]), turn % len(PARTS)) for turn, j in enumerate(further)]
    return chosen


# --- second pass ---------------------------------------------------------------------------------------------------


def _windows(one: Survey, picked: Sequence[tuple[int, int]], size: int) -> list[MeasuredRun]:
    """The samples of the chosen windows, in the order in which they were chosen."""
    wanted = sorted((int(one.starts[k]), k) for k, _ in picked)
    parts = dict(picked)
    found: dict[int, MeasuredRun] = {}
    first, held = 0, None
    for piece in iterate_runs(one.path, BATCH_ROWS):
        joined = piece if held is None else _joined(held, piece)
        begin = first - (0 if held is None else len(held.time))
        end = first + len(piece.time)
        while wanted and wanted[0][0] + size <= end:
            start, k = wanted.pop(0)
            run = joined.part(start - begin, start - begin + size)
            found[k] = replace(
                run,
                name=f"{one.path.stem}[{start}:{start + size}]",
                time=run.time.copy(),
                joints={name: log.each(np.copy) for name, log in run.joints.items()},
                meta={**run.meta, "excerpt": parts[k]},
            )
        keep = max(wanted[0][0] - begin, 0) if wanted else len(joined.time)
        held = joined.part(keep, len(joined.time)) if keep < len(joined.time) else None
        first = end
        if not wanted:
            break
    return [found[k] for k, _ in picked if k in found]


def _joined(a: MeasuredRun, b: MeasuredRun) -> MeasuredRun:
    joints = {
        name: replace(
            log,
            **{s: np.concatenate([getattr(a.joints[name], s), values]) for s, values in log.signals().items()},
        )
        for name, log in b.joints.items()
    }
    base, host = (
        {name: np.concatenate([before[name], values]) for name, values in table.items()}
        for before, table in ((a.base, b.base), (a.host, b.host))
    )
    return replace(b, time=np.concatenate([a.time, b.time]), joints=joints, base=base, host=host)
