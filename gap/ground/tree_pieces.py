"""Pieces of a walking robot's log to replay: where its base was, and how it started in each."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...envs.engine.base import BaseLayout
from ..checks.signal import derivatives
from ..log.parts import SPEED_REACH
from ..log.types import MeasuredRun
from .pieces import PIECE_SECONDS, UNKNOWN_SPEED, Piece, polynomial, sample_error, thinned
from .problem import Judged

ALONG = ("x", "y", "yaw")  # of the ground: where on it a robot is does not matter
FIT_SAMPLES = 3.5  # to both sides of a start, at least, from which its state is fitted
UNJUDGED_SECONDS = 0.04  # [s] of a piece that is not judged: its contacts settle
START_CHOICE = 0.1
"""[s] within which a piece starts where the base moves most evenly; the first begins as much into its run."""
MAX_PIECES = 36  # pieces of a data set; more cost time and teach little
MODEL_ERRORS = {"m": 5e-4, "rad": 2e-3}
"""What two right models of contact differ by over a piece [m, rad]: assumed, some ticks of the joints at the feet."""
LAW_ERROR = 0.2  # relative, of friction: assumed, an independent walker of soft ground showed 13 and 18 %
START_SPREADS = {"m": 5e-4, "rad": 1e-3}
"""How much less well a start is known than its parabola says [m, rad]: assumed; feet bear on the ground with it."""


@dataclass(frozen=True, eq=False)
class BaseColumns:
    """How the base of a robot was logged.

    Attributes:
        layout: its quantities.
        names: of them, in the order of a state.
        units: m or rad, of each.
        logged: whether each was, in all runs.
    """

    layout: BaseLayout
    names: tuple[str, ...]
    units: tuple[str, ...]
    logged: np.ndarray

    @property
    def directions(self) -> tuple[str, ...]:
        """What each is: ``trunk.roll`` a roll, and so ``torso_pitch`` of a base of slides and hinges a pitch."""
        return tuple(re.split(r"[._]", name)[-1] for name in self.names)

    @staticmethod
    def of(layout: BaseLayout, runs: Sequence[MeasuredRun]) -> BaseColumns:
        """Of some runs."""
        names = layout.names
        logged = [all(_column(run, name) is not None for run in runs) for name in names]
        return BaseColumns(layout, names, tuple(layout.units[name] for name in names), np.array(logged))

    def missing(self) -> list[str]:
        """Columns that a replay cannot do without: what says how the base stands on the ground."""
        rows = zip(self.names, self.directions, self.logged, strict=True)
        return [f"base.{name}" for name, direction, logged in rows if not (logged or direction in ALONG)]

    def judged(self, runs: Sequence[MeasuredRun]) -> Judged:
        """What is compared, with the noise of each column."""
        rows = [[sample_error(run.time, column) for column in self.values(run).T] for run in runs]
        errors = np.array([MODEL_ERRORS[unit] for unit in self.units])
        names = tuple(f"base.{name}" for name in self.names)
        return Judged(names, self.units, errors, np.median(np.array(rows), axis=0), UNJUDGED_SECONDS, LAW_ERROR)

    def values(self, run: MeasuredRun) -> np.ndarray:
        """The columns of a run (n, k), NaN where one was not logged; angles go on beyond a turn."""
        missing = np.full(len(run.time), np.nan)
        found = [_column(run, name) if said else missing for name, said in zip(self.names, self.logged, strict=True)]
        columns = [missing if column is None else column for column in found]
        return np.stack(
            [_whole(c) if unit == "rad" else c for c, unit in zip(columns, self.units, strict=True)], axis=1
        )


def find_pieces(runs: Sequence[MeasuredRun], columns: BaseColumns, judged: Judged) -> list[Piece]:
    """Pieces one behind the other, thinned evenly to :data:`MAX_PIECES`."""
    found = []
    for k, run in enumerate(runs):
        values = columns.values(run)
        rough = _roughness(run, columns, values, judged)
        for begin in np.arange(
            run.time[0] + START_CHOICE, run.time[-1] - PIECE_SECONDS - START_CHOICE, PIECE_SECONDS + START_CHOICE
        ):
            first, last = np.searchsorted(run.time, (begin, begin + START_CHOICE))
            start = int(first + np.argmin(rough[first : max(last, first + 1)]))
            stop = int(np.searchsorted(run.time, run.time[start] + PIECE_SECONDS))
            if (piece := _piece(run, columns, values, k, start, stop, judged)) is not None:
                found.append(piece)
    return thinned(found, MAX_PIECES)


def _roughness(run: MeasuredRun, columns: BaseColumns, values: np.ndarray, judged: Judged) -> np.ndarray:
    """How much each sample's neighbourhood speeds up (n,), in parts of the noise: an impact gives a poor start."""
    total = np.zeros(len(run.time))
    for c in np.flatnonzero(columns.logged):
        good = np.isfinite(values[:, c])
        _, _, change = derivatives(run.time, np.interp(run.time, run.time[good], values[good, c]), 2.0 * SPEED_REACH)
        total += (change / judged.noise[c]) ** 2
    return total


def _piece(
    run: MeasuredRun, columns: BaseColumns, values: np.ndarray, k: int, start: int, stop: int, judged: Judged
) -> Piece | None:
    """A piece with its start state: parabolas through what was logged; what was not is at zero, its speed unknown."""
    size = len(columns.names)
    state, spread = np.zeros(2 * size), np.zeros(2 * size)
    time = run.time - run.time[start]
    half = max(SPEED_REACH, FIT_SAMPLES * float(np.median(np.diff(run.time))))
    for c in range(size):
        if not columns.logged[c]:
            spread[size + c] = UNKNOWN_SPEED
            continue
        near = np.flatnonzero((np.abs(time) <= half) & np.isfinite(values[:, c]))
        if len(near) < 5:
            return None
        state[[c, c + size]], own = polynomial(time[near], values[near, c], 2, float(judged.noise[c]))
        spread[[c, c + size]] = np.hypot(own, [START_SPREADS[columns.units[c]], START_SPREADS[columns.units[c]] / half])
    return Piece(k, start, stop, state, spread)


def _column(run: MeasuredRun, name: str) -> np.ndarray | None:
    """A quantity of the base as it was logged: by its joint's name, or of a free joint without it."""
    joint, _, key = name.rpartition(".")
    for word in (name, key if joint else name):
        if word in run.base and np.isfinite(run.base[word]).sum() > 5:
            return np.asarray(run.base[word], float)
    return None


def _whole(angle: np.ndarray) -> np.ndarray:
    """An angle (n,) [rad] without jumps of a turn."""
    good = np.isfinite(angle)
    out = angle.copy()
    out[good] = np.unwrap(angle[good])
    return out
