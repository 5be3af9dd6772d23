"""How residuals change with parameters, where data hardly tell what several of them are together.

Differences of one parameter at a time ripple: a joint slips a step earlier, a stop is met a step later. Along a valley,
where a weaker motor does what more friction does, large changes of each cancel, and what is left of them is ripple,
which looks like curvature: a resistance seemed known to 0.7 % that was open by 10. So an axis of which the changes of
single parameters would be seen many times over is followed by itself, until it is as flat as it looks. One along which
nothing cancels stays as it was seen, as that of a delay does, which goes from sample to sample.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .bounded import FLAT

Errors = Callable[[np.ndarray], np.ndarray]
"""Weighted residuals (v, m) at points (v, p)."""
UNLIKELY = 3.84  # rise of the cost, in squared noise floors: the 95 % quantile of chi square with one degree of freedom
FOLLOWED = 4.0 * UNLIKELY  # rise to which an axis is followed: twice as far as an interval reaches
ROUNDS = 8
SETTLED = 0.8  # of the rise that was foreseen along an axis, or less of its inverse: it is as flat as it looks
CANCELS = 10.0  # times over that the cost would rise by the changes of single parameters along an axis that is followed
ROOM = 0.3  # of an axis within the bounds, both ways together, from which it is followed


def along_axes(
    errors: Errors,
    at: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    jacobian: np.ndarray,
    weight: np.ndarray,
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
            break
        steps = (axes * np.sqrt(FOLLOWED / np.maximum(size, FLAT * size[-1]))).T
        ahead, back = (np.array([_room(way * step, at, bounds) for step in steps])[:, None] for way in (1.0, -1.0))
        cancelled = steps**2 @ (jacobian**2 @ weight) / FOLLOWED
        followed = (ahead + back > ROOM)[:, 0] & (cancelled > CANCELS)
        if not followed.any():
            break
        sides = errors(at + np.concatenate([(ahead * steps)[followed], (-back * steps)[followed]]))
        changes = steps @ jacobian
        changes[followed] = (sides[: followed.sum()] - sides[followed.sum() :]) / (ahead + back)[followed]
        jacobian = np.linalg.solve(steps, changes)
        rise = (changes[followed] ** 2 * weight).sum(axis=1) / FOLLOWED
        if ((rise > SETTLED) & (rise * SETTLED < 1.0)).all():
            break
    return jacobian


def _room(step: np.ndarray, at: np.ndarray, bounds: tuple[np.ndarray, np.ndarray]) -> float:
    """Share of a step (p,) that stays within bounds, at most 1."""
    room = np.where(step > 0.0, bounds[1] - at, at - bounds[0])
    moves = np.abs(step) > FLAT
    return float(np.clip(np.min(room[moves] / np.abs(step[moves]), initial=1.0), 0.0, 1.0))
