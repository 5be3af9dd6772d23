"""Write a measured run. Nothing that was recorded before is ever overwritten or half replaced."""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import csv as arrow_csv
from pyarrow import parquet

from ...common.atomic import flush, write_text, written
from ...common.documents import DocumentError, parse_yaml, read_yaml
from .sidecar import Sidecar, sidecar_text
from .types import Array, LogError, MeasuredRun

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
        content = None if own is None else parse_yaml(own)
        if there := in_the_way(run, folder, content):
            raise _taken(there)
        with contextlib.ExitStack() as undone:
            with written(data) as fresh:
                write_table(table, fresh)
                flush(fresh)
                if not sidecar.exists():
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


def in_the_way(run: MeasuredRun, folder: Path, own: Mapping[str, Any] | None) -> Path | None:
    """A file that a run would be written over or beside; None: its name is free.

    The sidecar that an import left behind alone, as it was killed before it wrote the table, is in nobody's way.
    """
    there = _files(folder, run.name)
    if own is not None and there == [folder / f"{run.name}.yaml"] and _holds(_said(there[0]), own):
        return None
    return there[0] if there else None


def _files(folder: Path, name: str) -> list[Path]:
    files = [folder / f"{name}{end}" for end in (".csv", ".parquet", ".yaml", ".yml")]
    return [path for path in files if path.exists()]


def _said(sidecar: Path) -> Any:
    """What a sidecar says; None where it cannot be read."""
    try:
        return read_yaml(sidecar)
    except DocumentError:
        return None


def is_written(run: MeasuredRun, folder: Path, own: Mapping[str, Any]) -> Path | None:
    """The table of a log that was imported from the same file with the same numbers and machine; None: there is none.

    Args:
        run: as it would be written.
        folder: to write to.
        own: content of its own sidecar; what a person wrote beside it, there, does not count.
    """
    there = _files(folder, run.name)
    tables = [path for path in there if path.suffix in (".csv", ".parquet")]
    sidecar = folder / f"{run.name}.yaml"
    if len(tables) != 1 or sidecar not in there or not _holds(_said(sidecar), own):
        return None
    try:
        table = arrow_csv.read_csv(tables[0]) if tables[0].suffix == ".csv" else parquet.read_table(tables[0])
    except (OSError, ValueError):  # those of Arrow are values
        return None
    columns = run.columns()
    same = table.column_names == list(columns) and all(
        np.array_equal(_numbers(table[name]), values, equal_nan=True) for name, values in columns.items()
    )
    return tables[0] if same else None


def _numbers(cells: pa.ChunkedArray) -> Array:
    """Cells of a table as numbers; none where they are something else."""
    try:
        return np.asarray(cells.cast(pa.float64()).to_numpy(), np.float64)
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
        return np.zeros(0)


def _holds(said: Any, own: Any, key: str = "") -> bool:
    """Whether all that a sidecar would say stands in the one that is there; of paths, whether the file is the same."""
    if isinstance(own, Mapping):
        return isinstance(said, Mapping) and all(name in said and _holds(said[name], own[name], name) for name in own)
    if key == FROM:
        return Path(str(said)).resolve() == Path(str(own)).resolve()
    return said == own


def _taken(path: Path) -> LogError:
    return LogError(f"{path}: exists already and a recording is never overwritten; choose another name or folder")
