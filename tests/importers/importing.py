"""Recordings that tests of the import share: a motion, tables of it, and what is proposed for them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from sealegs.gap.log.importers import Proposed, Recording, propose_for
from sealegs.gap.log.importers.claims import claims_of
from sealegs.gap.log.importers.dialects import dialects
from sealegs.gap.log.importers.names import Claim

TIME = np.arange(0.0, 10.0, 0.01)
ANGLE = 0.6 * np.sin(2.0 * TIME) + 0.2 * np.sin(5.1 * TIME)
LATE = 0.6 * np.sin(2.0 * (TIME - 0.04)) + 0.2 * np.sin(5.1 * (TIME - 0.04))
DEG = 180.0 / np.pi
RAD = {"goal_rad": ANGLE, "pos_rad": LATE}


def table(folder: Path, columns: dict[str, np.ndarray], name: str = "run.csv") -> Path:
    """Columns as a CSV file."""
    path = folder / name
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.9g", encoding="utf-8")
    return path


def proposed(folder: Path, columns: dict[str, np.ndarray], unit: str | None = None, timed: bool = True) -> Proposed:
    """What is proposed for columns, at 100 Hz where they have no time and need one."""
    clock = {"time": TIME} if timed and not any("time" in name.lower() for name in columns) else {}
    return propose_for(table(folder, clock | columns), folder / "out", unit)


def asked(found: Proposed) -> dict[str, str]:
    """The question about each column of the log that is in question."""
    return {name: question.ask for question in found.mapping.questions for name in question.about}


def spoken(names: Iterable[str]) -> dict[str, Claim]:
    """What is said of the columns of a header, read together."""
    recording = Recording("run", {name: np.zeros(3) for name in names}, Path("run.csv"), "table")
    return claims_of(recording, dialects())
