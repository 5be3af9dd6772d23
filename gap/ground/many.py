"""Pieces of a log on many grounds: every pair of them is simulated, and read at the piece's own samples."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from .stances import Stance

ENGINE_STEP = 1e-3  # [s] of the engine: halving it moves a stance by less than right models of contact differ
MOST_SIMULATIONS = 512  # side by side
WITHOUT_END = 1e6
"""Inertia [kg.m2] or mass [kg] of what follows its measured motion, whatever acts on it, and place [rad or m] of a stop
that nothing reaches."""
Model = TypeVar("Model")


def on_many_grounds(
    run: Callable[[Sequence[Model], np.ndarray, np.ndarray, np.ndarray], np.ndarray],
    models: Sequence[Model],
    pieces: Sequence[Stance],
    rows: Sequence[int],
    states: np.ndarray | None,
    time: Sequence[np.ndarray],
    step: float,
) -> list[np.ndarray]:
    """Replay pieces on every ground.

    Args:
        run: simulates pairs of a ground and a piece, both by number (n,), from states (n, k): what is judged at each
            step of the engine (steps + 1, n, c).
        models: grounds (v).
        pieces: all of the log.
        rows: numbers of those to replay (s).
        states: start of each piece, one per ground (v, s, k); default: as measured.
        time: of the samples of each piece since its start [s].
        step: of the engine [s].

    Returns:
        Per piece the judged columns at its samples (v, samples, c).
    """
    count = len(rows)
    if states is None:
        states = np.array([pieces[row].state for row in rows])
    size = states.shape[-1]
    states = np.broadcast_to(states, (len(models), count, size)).reshape(-1, size)
    ground, piece = np.repeat(np.arange(len(models)), count), np.tile(np.asarray(rows), len(models))
    parts = [slice(first, first + MOST_SIMULATIONS) for first in range(0, len(ground), MOST_SIMULATIONS)]
    recorded = np.concatenate([run(models, ground[part], piece[part], states[part]) for part in parts], axis=1)
    out = []
    for k, row in enumerate(rows):
        at = time[row] / step
        low = np.minimum(at.astype(int), len(recorded) - 2)
        share = (at - low)[:, None, None]
        path = recorded[:, k::count]
        out.append(((1.0 - share) * path[low] + share * path[low + 1]).transpose(1, 0, 2))
    return out
