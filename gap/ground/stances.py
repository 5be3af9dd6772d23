"""Pieces of a legged log to replay: each starts in flight, where the state is well known, and runs through a stance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...actuators.gravity import GRAVITY
from ..checks.signal import derivatives
from ..log.parts import SPEED_REACH
from ..log.types import MeasuredRun
from .leg_model import LegModel
from .pieces import PIECE_SECONDS, UNKNOWN_SPEED, Piece, polynomial, sample_error, thinned

COLUMNS = ("base.z", "base.x", "hip.link_position", "knee.link_position")
"""What is judged, the height of the hip first."""
UNITS = ("m", "m", "rad", "rad")
FLIGHT_SECONDS = 2.0 * SPEED_REACH  # [s] from the start of a piece to its touchdown: its state is read in flight
LINK_FIT = 0.013  # [s] to both sides of the start, from which the state of a joint is fitted: it moves fast
MIN_FLIGHT_SECONDS = 0.08  # [s] shortest flight after which a stance counts
FREE_FALL = 0.6  # of gravity: downward acceleration of the centre of mass from which the leg counts as flying
UNJUDGED_SECONDS = LINK_FIT  # [s] of a piece that is not judged: the start state was fitted to it
MODEL_ERRORS = (1.5e-4, 2e-4, 1e-3, 1e-3)
"""What two right models of hard contact differ by over a stance, in the judged columns [m, m, rad, rad]: assumed, from
replays of an independent leg on rigid ground. Errors this small say nothing about the ground."""
MAX_STANCES = 48  # stances of a data set; more cost time and teach little


def columns(run: MeasuredRun) -> np.ndarray:
    """The judged columns of a run (n, 4), NaN where one was not logged."""
    missing = np.full(len(run.time), np.nan)
    links = [run.joints[name].link_position for name in ("hip", "knee")]
    links = [
        run.joints[name].position if link is None else link for name, link in zip(("hip", "knee"), links, strict=True)
    ]
    return np.stack([run.base.get("z", missing), run.base.get("x", missing), *links], axis=1)


def column_noise(runs: Sequence[MeasuredRun]) -> np.ndarray:
    """Rms error of a sample of each judged column (4,), NaN where it was not logged."""
    rows = []
    for run in runs:
        values = columns(run)
        rows.append([sample_error(run.time, values[:, c]) for c in range(len(COLUMNS))])
    return np.median(np.array(rows), axis=0)


def touchdowns(run: MeasuredRun, leg: LegModel) -> np.ndarray:
    """Times at which a flight ends [s], from the acceleration of the centre of mass."""
    values = columns(run)
    height = values[:, 0] + leg.mass_centre(values[:, 2], values[:, 3])
    good = np.isfinite(height)
    _, _, acceleration = derivatives(run.time, np.interp(run.time, run.time[good], height[good]))
    flying = np.concatenate([[False], acceleration < -FREE_FALL * GRAVITY, [False]]).astype(int)
    edges = np.diff(flying)
    up, down = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    long = run.time[down] - run.time[up] > MIN_FLIGHT_SECONDS
    return run.time[down[long]]


def find_stances(runs: Sequence[MeasuredRun], leg: LegModel, noise: np.ndarray) -> list[Piece]:
    """The stances of all runs, thinned evenly to :data:`MAX_STANCES`."""
    found = []
    for k, run in enumerate(runs):
        values = columns(run)
        for touchdown in touchdowns(run, leg):
            start = int(np.searchsorted(run.time, touchdown - FLIGHT_SECONDS))
            stop = int(np.searchsorted(run.time, run.time[start] + PIECE_SECONDS))
            if start < 1 or stop >= len(run.time):
                continue
            if (stance := _stance(run, leg, values, k, start, stop, noise)) is not None:
                found.append(stance)
    return thinned(found, MAX_STANCES)


def _stance(
    run: MeasuredRun, leg: LegModel, values: np.ndarray, k: int, start: int, stop: int, noise: np.ndarray
) -> Piece | None:
    """A piece with its start state: links from parabolas, the base from a centre of mass that falls freely."""
    state, spread = np.zeros(8), np.zeros(8)
    time = run.time - run.time[start]
    for c in (2, 3):
        near = np.flatnonzero((np.abs(time) <= LINK_FIT) & np.isfinite(values[:, c]))
        if len(near) < 5:
            return None
        state[[c, c + 4]], spread[[c, c + 4]] = polynomial(time[near], values[near, c], 2, noise[c])
    over = np.stack([leg.mass_centre(values[:, 2], values[:, 3]), leg.mass_centre_ahead(values[:, 2], values[:, 3])])
    if not np.isfinite(over[:, start]).all():
        return None
    slope = np.stack([leg.mass_centre_ahead(*state[2:4], split=True), -leg.mass_centre(*state[2:4], split=True)])
    for c, fall in ((0, -0.5 * GRAVITY * time**2), (1, 0.0 * time)):
        near = np.flatnonzero((np.abs(time) <= SPEED_REACH) & np.isfinite(values[:, c] + over[c]))
        if len(near) < 5:
            if c == 0:
                return None
            spread[c + 4] = UNKNOWN_SPEED  # where x is does not matter on a ground that is alike everywhere
            continue
        centre = values[near, c] + over[c, near] - fall[near]
        (height, rise), (own, moving) = polynomial(time[near], centre, 1, noise[c])
        state[c], state[c + 4] = height - over[c, start], rise - float(slope[c] @ state[6:8])
        spread[c], spread[c + 4] = own, float(np.hypot(moving, np.linalg.norm(slope[c] * spread[6:8])))
    return Piece(k, start, stop, state, spread)
