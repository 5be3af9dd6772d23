"""Write a measured run. Nothing that was recorded before is ever overwritten or half replaced."""

from __future__ import annotations

import contextlib
import errno
from pathlib import Path

import pyarrow as pa
from pyarrow import csv as arrow_csv
from pyarrow import parquet

from ...common.atomic import flush, write_text, written
from .sidecar import Sidecar, sidecar_text
from .types import LogError, MeasuredRun

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
