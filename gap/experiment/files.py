"""A proposed experiment on disk: goals that ``deploy.py`` runs, and the sidecar for the log that comes of it.

The goals are a CSV with the columns ``time`` [s] and ``<joint>.goal`` [rad], each goal held until the next row. The
sidecar beside it (docs/log-format.md) says what must hang on the shaft while it runs.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..log.sidecar import Sidecar, named_beside, sidecar_text
from ..log.types import LogError
from .proposal import Experiment


def goal_table(experiment: Experiment, joint: str) -> str:
    """The goals as CSV text."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["time", f"{joint}.goal"])
    rows.writerows(zip(np.round(experiment.time, 6), np.round(experiment.goal, 6), strict=True))
    return text.getvalue()


def write_experiment(
    experiment: Experiment,
    joint: str,
    folder: Path,
    actuator: str | list | None,
    prefix: str = "",
    robot: str = "bench",
    frame: Mapping[str, float] | None = None,
    final: Path | None = None,
) -> dict[str, Path]:
    """Write ``next_experiment.csv`` and ``next_experiment.yaml``.

    Args:
        experiment: to write.
        joint: that it moves.
        folder: to write into.
        actuator: chain of the joint as the sidecars name it; None where the robot's file does.
        prefix: of the file names.
        robot: as the sidecars name it.
        frame: ``zero`` and ``direction`` of the joint in the log, whose goals these are, where they are not the
            model's; they go into the sidecar, and who runs the goals on the model's machine turns them.
        final: where the files come to lie, if that is another folder: the sidecar names others as they lie beside it.

    Returns:
        Paths by ``experiment`` and ``experiment_sidecar``.
    """
    goals, sidecar = folder / f"{prefix}next_experiment.csv", folder / f"{prefix}next_experiment.yaml"
    goals.write_text(goal_table(experiment, joint), encoding="utf-8")
    notes: dict[str, Any] = {"notes": f"{experiment.name}: {experiment.sentence}"}
    if frame is not None:
        notes["frames"] = {joint: dict(frame)}
    said = Sidecar(robot, dict(experiment.load), {} if actuator is None else {joint: actuator}, notes)
    sidecar.write_text(sidecar_text(named_beside(said, folder if final is None else final)), encoding="utf-8")
    return {"experiment": goals, "experiment_sidecar": sidecar}


def read_goals(path: Path) -> tuple[str, np.ndarray, np.ndarray]:
    """Read the goals of an experiment.

    Returns:
        Joint, times (n,) [s], goals (n,) [rad].

    Raises:
        LogError: the file is not one.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            header, *rows = [row for row in csv.reader(file) if row]
        if len(header) != 2 or header[0] != "time" or not header[1].endswith(".goal"):
            raise ValueError
        table = np.array(rows, float)
        if table.ndim != 2 or len(table) < 2 or not np.isfinite(table).all() or (np.diff(table[:, 0]) <= 0.0).any():
            raise ValueError
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError:
        raise LogError(
            f"{path}: is no experiment; it needs the columns time and <joint>.goal, with numbers and increasing times."
        ) from None
    return header[1].removesuffix(".goal"), table[:, 0], table[:, 1]
