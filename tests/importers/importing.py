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


TICK = 2.0 * np.pi / 4096


def motion(seconds: float = 20.0, rate: float = 200.0, lag: float = 0.05, seed: int = 0) -> dict[str, np.ndarray]:
    """A goal and a joint that follows it late [s, rad, rad/s], read by an encoder of 4096 ticks."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 1.0 / rate)
    rates, phases, sizes = np.array([1.3, 3.1, 7.0]), rng.uniform(0, 6, 3), np.array([0.6, 0.3, 0.08])

    def angle(t: np.ndarray) -> np.ndarray:
        return (sizes * np.sin(rates * t[:, None] + phases)).sum(1)

    def speed(t: np.ndarray) -> np.ndarray:
        return (sizes * rates * np.cos(rates * t[:, None] + phases)).sum(1)

    position = 0.9 * angle(time - lag)
    return {
        "time": time,
        "goal": angle(time),
        "position": np.round(position / TICK) * TICK,
        "smooth": position,
        "velocity": 0.9 * speed(time - lag) + rng.normal(0.0, 0.01, len(time)),
    }


def table(folder: Path, columns: dict[str, np.ndarray], name: str = "run.csv") -> Path:
    """Columns as a CSV file."""
    path = folder / name
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.12g", encoding="utf-8")
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
