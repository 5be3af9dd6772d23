"""Measured logs: read, each file with the sidecar that says what was recorded, written, and made of arrays."""

from __future__ import annotations

import contextlib
import dataclasses
import errno
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
import pyarrow as pa
from pyarrow import csv as arrow_csv
from pyarrow import parquet

from ...common.atomic import flush, write_text, written
from ...common.errors import SealegsError, nearest
from ...envs.described.robot_file import is_robot_file
from .sidecar import Sidecar, checked_sidecar, files_named, read_sidecar, sidecar_text
from .table import ENDINGS, ONLY_JOINT, check_columns, group_of, read_batches, with_joint
from .types import OTHER, REQUIRED_EVERYWHERE, Array, JointLog, LogError, MeasuredRun, MeasuredSet

MINIMUM_SAMPLES = 2
SLOWEST_PERIOD = 0.5
"""A median sample period above this [s] is taken for a clock in another unit: no servo motion shows at 2 Hz."""
FASTEST_PERIOD = 1e-6
MIXED_RATE_RATIO = 8.0
"""Quarters of one run whose median periods differ by more than this were not recorded at one rate."""


def read_measured(path: str | Path) -> MeasuredSet:
    """Read a measured log, or every log of a folder, as one data set.

    Args:
        path: a ``.csv`` or ``.parquet`` file with its sidecar, or a folder of them.

    Raises:
        LogError: one sentence naming file, column and row of what is wrong.
    """
    path = Path(path)
    files = log_files(path)
    runs = tuple(_read_run(file) for file in files)
    for run in runs:
        if run.robot != runs[0].robot:
            raise LogError(
                f"{path}: {files[0].name} is a log of robot {runs[0].robot!r}, {run.name} one of {run.robot!r}; "
                "keep one machine per folder"
            )
    return MeasuredSet(runs, path.stem if path.is_file() else path.resolve().name)


def log_files(path: Path) -> list[Path]:
    """The files of a measured log: itself, or those in a folder.

    Raises:
        LogError: there is none, or two share a sidecar.
    """
    files = [path]
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if file.suffix in ENDINGS and not file.name.startswith("."))
        if not files:
            below = sorted({str(file.parent) for end in ENDINGS for file in path.glob(f"[!.]*/*{end}")})
            more = f", or all {len(below)} as a fleet with fleet=true" if len(below) > 1 else ""
            hint = f"; give the folder in it that does, such as {below[0]}{more}" if below else ""
            raise LogError(f"{path}: holds no measured log (no file ending in {' or '.join(ENDINGS)}){hint}")
    elif not path.is_file():
        raise LogError(
            f"{path}: no such file or folder; give a measured log or a folder of them, as sealegs deploy and sealegs "
            "import write them"
        )
    elif is_robot_file(path):
        raise LogError(
            f"{path}: describes a robot or a log and holds no measurements; give the measured log (its name ends in "
            f"{' or '.join(ENDINGS)}), or a folder of them"
        )
    stems: dict[str, Path] = {}
    for file in files:
        if file.stem in stems:
            raise LogError(f"{file}: {stems[file.stem].name} has the same name and sidecar; keep one of the two")
        stems[file.stem] = file
    return files


def files_named_by(path: Path) -> tuple[Path, ...]:
    """The files of robots and of chains that the sidecars of a log name, as far as sidecars and files can be read."""
    found: dict[Path, None] = {}
    with suppress(SealegsError):  # reading the log says it
        for file in log_files(path):
            with suppress(SealegsError):
                found |= dict.fromkeys(files_named(read_sidecar(file)))
    return tuple(found)


def iterate_runs(path: str | Path, rows: int = 1 << 18) -> Iterator[MeasuredRun]:
    """Read one log file in consecutive pieces of ``rows`` samples, in memory bounded by ``rows``.

    Each piece is a `MeasuredRun` named ``<name>[<first row>]``; the last one may be shorter, and a last single
    sample is joined to the piece before it.

    Raises:
        LogError: as `read_measured`, when the piece with the fault is reached.
    """
    path = Path(path)
    if rows < MINIMUM_SAMPLES:
        raise LogError(f"a piece of a log has at least {MINIMUM_SAMPLES} samples, not {rows}")
    sidecar = read_sidecar(path)
    first = 0
    parts: list[dict[str, Array]] = []
    held = 0
    for batch in read_batches(path, only_joint(sidecar), driven_joints(sidecar)):
        parts.append(batch)
        held += len(batch["time"])
        while held >= rows + MINIMUM_SAMPLES:
            table = _joined(parts)
            piece = {name: values[:rows] for name, values in table.items()}
            parts, held = [{name: values[rows:] for name, values in table.items()}], held - rows
            yield build_run(f"{path.stem}[{first}]", piece, sidecar, path, first)
            first += rows
    if held:
        yield build_run(f"{path.stem}[{first}]", _joined(parts), sidecar, path, first)


def _read_run(path: Path) -> MeasuredRun:
    sidecar = read_sidecar(path)
    return build_run(
        path.stem, _joined(list(read_batches(path, only_joint(sidecar), driven_joints(sidecar)))), sidecar, path, 0
    )


def only_joint(sidecar: Sidecar) -> str:
    """Joint of columns that name none: the one that the sidecar gives an actuator."""
    return next(iter(sidecar.actuators)) if len(sidecar.actuators) == 1 else ONLY_JOINT


def driven_joints(sidecar: Sidecar) -> Collection[str] | None:
    """Joints that need a command: of a robot's file those with an actuator, others may be passive; else all."""
    return sidecar.actuators if is_robot_file(sidecar.robot) else None


def _joined(parts: list[dict[str, Array]]) -> dict[str, Array]:
    if len(parts) == 1:
        return parts[0]
    return {name: np.concatenate([part[name] for part in parts]) for name in (parts[0] if parts else ())}


def build_run(name: str, table: dict[str, Array], sidecar: Sidecar, path: Path, first_row: int) -> MeasuredRun:
    """A run from its columns, checked.

    Raises:
        LogError: a column is unknown, missing or holds values that it may not; the message names ``path``.
    """
    if len(table.get("time", ())) < MINIMUM_SAMPLES:
        count = len(table.get("time", ()))
        raise LogError(f"{path}: has {count or 'no'} sample{'s' if count != 1 else ''}; a run needs at least two")
    check_columns(list(table), path, driven_joints(sidecar))
    _check_values(table, path, first_row)
    signals: dict[str, dict[str, Array]] = {}
    other: dict[str, dict[str, Array]] = {group: {} for group in OTHER}
    for column, values in table.items():
        joint, signal = group_of(column)
        if joint in OTHER:
            other[joint][signal] = values
        elif joint:
            signals.setdefault(joint, {})[signal] = values
    for joint in sidecar.actuators:
        if joint not in signals:
            raise LogError(
                f"{path}: the sidecar gives an actuator for joint '{joint}', which the log does not have"
                f"{nearest(joint, signals)}; its joints are {', '.join(signals) or 'none'}"
            )
    for joint, recorded in signals.items():
        if joint not in sidecar.actuators and "goal" in recorded and not is_robot_file(sidecar.robot):
            raise LogError(
                f"{path}: joint '{joint}' has no entry under actuators in the sidecar"
                f"{nearest(joint, sidecar.actuators)}; name the chain that drives it"
            )
    joints = {
        joint: JointLog(goal=recorded.pop("goal", None), position=recorded.pop("position"), **recorded)
        for joint, recorded in signals.items()
    }
    return MeasuredRun(
        name, time=table["time"], joints=joints, base=other["base"], robot=sidecar.robot,
        robot_params=dict(sidecar.robot_params), actuators=dict(sidecar.actuators), source=path,
        meta=dict(sidecar.meta), host=other["host"],
    )  # fmt: skip


def _check_values(table: dict[str, Array], path: Path, first_row: int) -> None:
    for column, values in table.items():
        signal = column.rpartition(".")[2]
        needed = signal in REQUIRED_EVERYWHERE or column == "time"
        bad = ~np.isfinite(values) if needed and column.partition(".")[0] not in OTHER else np.isinf(values)
        if bad.any():
            row = first_row + int(np.argmax(bad)) + 1
            value = "has no value (NaN)" if np.isnan(values[row - first_row - 1]) else "is infinite"
            raise LogError(
                f"{path}: column '{column}' {value} in row {row}; remove the {bad.sum()} row{'s' * int(bad.sum() > 1)} "
                "concerned or record again"
            )
    _check_clock(table["time"], path, first_row)


def _check_clock(time: Array, path: Path, first_row: int) -> None:
    steps = np.diff(time)
    if (steps <= 0).any():
        at = int(np.argmax(steps <= 0))
        row, what = first_row + at + 2, "repeats" if steps[at] == 0 else "runs backwards"
        raise LogError(
            f"{path}: column 'time' {what} in row {row} ({time[at]:.9g} s, then {time[at + 1]:.9g} s); "
            "every sample needs a later time than the one before"
        )
    period = float(np.median(steps))
    if not FASTEST_PERIOD <= period <= SLOWEST_PERIOD:
        raise LogError(
            f"{path}: column 'time' advances by {period:g} per sample, which is no sample period in seconds; "
            "convert it to seconds"
        )
    quarters = [float(np.median(part)) for part in np.array_split(steps, 4)] if len(steps) >= 40 else [period]
    if max(quarters) > MIXED_RATE_RATIO * min(quarters):
        raise LogError(
            f"{path}: is sampled at {1 / max(quarters):.4g} Hz in one part and {1 / min(quarters):.4g} Hz in another; "
            "split it into one file per rate"
        )


# --- write a measured run. Nothing that was recorded before is ever overwritten or half replaced ---------------------

FORMATS = ("csv", "parquet")
FROM = "imported_from"
"""Entry of a sidecar's meta with the file that an import read."""


def write_run(run: MeasuredRun, folder: str | Path, format: str = "csv", own: str | None = None) -> Path:
    """Write ``run`` as ``<folder>/<run.name>.<format>`` and its sidecar ``<run.name>.yaml``.

    Both files appear whole or not at all: they are written under temporary names, flushed to the disk, and only then
    linked to names that must be free.

    Args:
        run: to be written.
        folder: to write to.
        format: of the table, ``csv`` or ``parquet``.
        own: text of the run's own sidecar, where the folder's ``log.yaml`` says the rest; None: all of it.

    Returns:
        The path of the data file.

    Raises:
        LogError: unknown format, a run of that name exists, or the disk refuses (full, read only); the temporary
            files are then removed and earlier files are as they were.
    """
    if format not in FORMATS:
        raise LogError(f"a log is written as {' or '.join(FORMATS)}, not {format!r}")
    if not run.name or run.name != Path(run.name).name or run.name.startswith("."):
        raise LogError(f"a run cannot be called {run.name!r}; use a name that is a plain file name")
    folder = Path(folder)
    data, sidecar = folder / f"{run.name}.{format}", folder / f"{run.name}.yaml"
    whole = sidecar_text(Sidecar(run.robot, run.robot_params, run.actuators, run.meta))
    text = whole if own is None else own
    table = pa.table({name: pa.array(values, pa.float64(), from_pandas=True) for name, values in run.columns().items()})
    write_table = arrow_csv.write_csv if format == "csv" else parquet.write_table

    try:
        folder.mkdir(parents=True, exist_ok=True)
        ends = (".csv", ".parquet", ".yaml", ".yml")
        if there := next((path for end in ends if (path := folder / f"{run.name}{end}").exists()), None):
            raise _taken(there)
        with contextlib.ExitStack() as undone:
            with written(data) as fresh:
                write_table(table, fresh)
                flush(fresh)
                write_text(sidecar, text)  # before the data, which without it would be of another robot
                undone.callback(sidecar.unlink)
            undone.pop_all()
    except FileExistsError as error:
        raise _taken(Path(error.filename2 or error.filename)) from None
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        reason = "the disk is full; free some space and write it again" if full else error.strerror or error
        raise LogError(f"{data}: cannot be written: {reason}") from None
    return data


def _taken(path: Path) -> LogError:
    return LogError(f"{path}: exists already and a recording is never overwritten; choose another name or folder")


# --- measured logs from memory: columns as arrays or a table, and what a sidecar would say as a dict -----------------


@runtime_checkable
class Table(Protocol):
    """A data frame: named columns, as of pandas or Polars."""

    @property
    def columns(self) -> Any:  # pandas declares a descriptor, which no checker takes for an iterable
        """Names of the columns."""
        ...

    def __getitem__(self, key: Any, /) -> Any:
        """A column by its name."""
        ...


Columns = Mapping[str, Any] | Table
"""Columns of one run by name, as in docs/log-format.md: ``time``, ``<joint>.goal``, ``<joint>.position``, ..."""
InMemory = MeasuredSet | MeasuredRun | Columns | Sequence[MeasuredRun | Columns]


def measured_set(
    runs: InMemory, sidecar: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None = None, name: str = "log"
) -> MeasuredSet:
    """Runs in memory as one data set.

    Args:
        runs: one run or several, measured runs or columns.
        sidecar: of all runs, or one for each; measured runs have their own.
        name: of the set.

    Raises:
        LogError: one sentence on what is wrong, with run and column.
    """
    if isinstance(runs, MeasuredSet):
        return runs
    several: list[MeasuredRun | Columns] = list(runs) if isinstance(runs, Sequence) else [runs]
    if not several:
        raise LogError("there is no run in the log; give one run or more.")
    sidecars = [None] * len(several) if sidecar is None else sidecar
    if isinstance(sidecars, str) or not isinstance(sidecars, Mapping | Sequence):
        raise LogError(
            f"sidecar={sidecar!r} is no sidecar; give a dict such as {{'robot': 'bench', 'robot_params': {{...}}, "
            "'actuators': {'<joint>': '<chain>'}}, or one for each run."
        )
    if isinstance(sidecars, Mapping):
        sidecars = [sidecars] * len(several)
    if len(sidecars) != len(several):
        raise LogError(
            f"there are {len(several)} runs and {len(sidecars)} sidecars; give one for all, or one for each."
        )
    built = [_run(run, side, f"run{k}") for k, (run, side) in enumerate(zip(several, sidecars, strict=True), 1)]
    for run in built:
        if run.robot != built[0].robot:
            raise LogError(
                f"{built[0].name} is a run of robot {built[0].robot!r}, {run.name} one of {run.robot!r}; diagnose one "
                "machine at a time."
            )
    return MeasuredSet(tuple(built), name)


def _run(run: MeasuredRun | Columns, sidecar: Mapping[str, Any] | None, name: str) -> MeasuredRun:
    if isinstance(run, MeasuredRun):
        return run
    columns = run.keys() if isinstance(run, Mapping) else run.columns if isinstance(run, Table) else None
    if columns is None:
        raise LogError(
            f"{name} is {type(run).__name__}; a log is a path, a measured run, a data frame, or a dict of columns."
        )
    if sidecar is None:
        raise LogError(
            f"{name} has no sidecar; give sidecar={{'robot': 'bench', 'robot_params': {{...}}, 'actuators': "
            "{'<joint>': '<chain>'}}."
        )
    checked: Sidecar = checked_sidecar(sidecar, f"the sidecar of {name}")
    table = {str(column): _column(run[column], str(column), name) for column in columns}
    lengths = {column: len(values) for column, values in table.items()}
    if len(set(lengths.values())) > 1:
        short, long = min(lengths, key=lengths.__getitem__), max(lengths, key=lengths.__getitem__)
        raise LogError(
            f"{name}: column '{short}' has {lengths[short]} samples and '{long}' has {lengths[long]}; columns of a run "
            "are equally long."
        )
    table = dict(zip(with_joint(list(table), only_joint(checked)), table.values(), strict=True))
    check_columns(list(table), Path(name), driven_joints(checked))
    return dataclasses.replace(build_run(name, table, checked, Path(name), 0), source=None)


def _column(values: Any, column: str, name: str) -> Array:
    try:
        array = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        raise LogError(f"{name}: column '{column}' holds values that are no numbers; convert or remove them.") from None
    if array.ndim != 1:
        raise LogError(f"{name}: column '{column}' has the shape {array.shape}; a column is one number per sample.")
    return array
