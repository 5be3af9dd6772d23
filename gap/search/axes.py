"""How residuals change with parameters, where data hardly tell what several of them are together.

Differences of one parameter at a time ripple: a joint slips a step earlier, a stop is met a step later. Along a valley,
where a weaker motor does what more friction does, large changes of each cancel, and what is left of them is ripple,
which looks like curvature: a resistance seemed known to 2 % that was open by 6. So the axes of the curvature are
followed by themselves, as far as the data let each go, until they are as flat as they look.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .bounded import FLAT

Errors = Callable[[np.ndarray], np.ndarray]
"""Weighted residuals (v, m) at points (v, p)."""
UNLIKELY = 3.84  # rise of the cost, in squared noise floors: the 95 % quantile of chi square with one degree of freedom
ROUNDS = 8
SETTLED = 0.8  # of the rise that was foreseen along an axis, from which it is as flat as it looks
ROOM = 0.3  # of an axis within the bounds, both ways together, from which it is followed
ASTRAY = 100.0  # times the rise that was foreseen, from which a replay went elsewhere


def along_axes(
    errors: Errors, at: np.ndarray, bounds: tuple[np.ndarray, np.ndarray], jacobian: np.ndarray, weight: np.ndarray
) -> np.ndarray:
    """A Jacobian (p, m) whose weak directions were each followed by itself.

    Args:
        errors: of points.
        at: the point (p,).
        bounds: low and high (p,), (p,).
        jacobian: by differences of one parameter at a time (p, m).
        weight: robust weight of each sample (m,).
    """
    for _ in range(ROUNDS):
        size, axes = np.linalg.eigh((jacobian * weight) @ jacobian.T)
        if not size[-1] > 0.0:
            return jacobian
        steps = (axes * np.sqrt(UNLIKELY / np.maximum(size, FLAT * size[-1]))).T
        ahead, back = (np.array([_room(way * step, at, bounds) for step in steps]) for way in (1.0, -1.0))
        sides = errors(at + np.concatenate([ahead[:, None] * steps, -back[:, None] * steps]))
        foreseen = steps @ jacobian
        seen = (sides[: len(at)] - sides[len(at) :]) / np.maximum(ahead + back, FLAT)[:, None]
        rise = (seen**2 * weight).sum(axis=1)
        followed = (ahead + back > ROOM) & (rise < ASTRAY * UNLIKELY)
        jacobian = np.linalg.solve(steps, np.where(followed[:, None], seen, foreseen))
        if not (rise[followed] < SETTLED * UNLIKELY).any():
            break
    return jacobian


def _room(step: np.ndarray, at: np.ndarray, bounds: tuple[np.ndarray, np.ndarray]) -> float:
    """Share of a step (p,) that stays within bounds, at most 1."""
    room = np.where(step > 0.0, bounds[1] - at, at - bounds[0])
    moves = np.abs(step) > FLAT
    return float(np.clip(np.min(room[moves] / np.abs(step[moves]), initial=1.0), 0.0, 1.0))
