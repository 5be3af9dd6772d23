"""Write a measured run. Nothing that was recorded before is ever overwritten or half replaced."""

from __future__ import annotations

import errno
import os
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import IO

import pyarrow as pa
from pyarrow import csv as arrow_csv
from pyarrow import parquet

from .sidecar import Sidecar, sidecar_text
from .types import LogError, MeasuredRun

FORMATS = ("csv", "parquet")


def write_run(run: MeasuredRun, folder: str | Path, format: str = "csv") -> Path:
    """Write ``run`` as ``<folder>/<run.name>.<format>`` and its sidecar ``<run.name>.yaml``.

    Both files appear whole or not at all: they are written under temporary names, flushed to the disk, and only then
    linked to names that must be free.

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
    text = sidecar_text(Sidecar(run.robot, run.robot_params, run.actuators, run.meta)).encode()
    table = pa.table({name: pa.array(values, pa.float64(), from_pandas=True) for name, values in run.columns().items()})
    write_table = arrow_csv.write_csv if format == "csv" else parquet.write_table

    staged: list[Path] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        taken = [folder / f"{run.name}{end}" for end in (".csv", ".parquet", ".yaml", ".yml")]
        _refuse_taken(next((path for path in taken if path.exists()), None))
        staged_data = _stage(folder, staged, lambda file: write_table(table, file))
        staged_sidecar = _stage(folder, staged, lambda file: file.write(text))
        _publish(staged_sidecar, sidecar)
        try:
            _publish(staged_data, data)
        except BaseException:
            sidecar.unlink(missing_ok=True)
            raise
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        reason = "the disk is full; free some space and write it again" if full else error.strerror or error
        raise LogError(f"{data}: cannot be written: {reason}") from None
    finally:
        for path in staged:
            path.unlink(missing_ok=True)
    return data


def _stage(folder: Path, staged: list[Path], write: Callable[[IO[bytes]], object]) -> Path:
    path = folder / f".{uuid.uuid4().hex}.part"
    staged.append(path)
    with open(path, "xb") as file:
        write(file)
        file.flush()
        os.fsync(file.fileno())  # a full disk may show only when the data reaches it
    return path


def _publish(staged: Path, target: Path) -> None:
    # A hard link refuses an existing target in one atomic step, which rename does not.
    try:
        os.link(staged, target)
    except FileExistsError:
        _refuse_taken(target)
    except OSError as error:
        if error.errno not in (errno.EPERM, errno.ENOTSUP, errno.ENOSYS, errno.EMLINK):
            raise
        _refuse_taken(target if target.exists() else None)
        os.rename(staged, target)  # file system without hard links


def _refuse_taken(path: Path | None) -> None:
    if path is not None:
        raise LogError(f"{path}: exists already and a recording is never overwritten; choose another name or folder")
