"""The bounded linear step of every fit, and linear equations that data may leave undetermined."""

from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear

NARROWEST = 1e-9  # the solver needs some room between bounds
LONGEST = 10.0  # step of a parameter in one iteration, in units of its scale
FLAT = 1e-12  # share of the largest curvature below which a direction has none


def solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """The solution (p,) of symmetric equations (p, p); the shortest one where data leave directions undetermined.

    A number that changes nothing that was logged, or two that change the same, make a matrix singular.
    """
    try:
        found = np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        found = np.full(np.shape(right), np.nan)
    return found if np.isfinite(found).all() else np.linalg.lstsq(np.nan_to_num(matrix), np.nan_to_num(right))[0]


def root_of(matrix: np.ndarray) -> np.ndarray:
    """Upper triangle ``R`` (p, p) with ``R.T @ R`` the symmetric matrix; flat directions are given a little."""
    ridge = FLAT * max(float(np.trace(matrix)), 1e-300)
    for _ in range(12):
        try:
            return np.linalg.cholesky(matrix).T
        except np.linalg.LinAlgError:
            matrix, ridge = matrix + ridge * np.eye(len(matrix)), 10.0 * ridge
    size, axes = np.linalg.eigh(matrix)
    return np.linalg.qr(np.sqrt(np.maximum(size, FLAT * max(size[-1], 1e-300)))[:, None] * axes.T)[1]


def bounded_step(curvature: np.ndarray, slope: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The step (p,) within bounds that minimises ``slope @ x + x @ curvature @ x / 2``.

    The free step is taken where it is within the bounds; only else is the bounded problem solved.

    Args:
        curvature: symmetric and positive definite (p, p).
        slope: (p,).
        low, high: bounds of the step (p,), on either side of zero.
    """
    free = -solved(curvature, slope)
    if ((free >= low) & (free <= high)).all():
        return free
    size, axes = np.linalg.eigh(curvature)
    root = np.sqrt(np.maximum(size, max(1e-15 * size[-1], 1e-300)))
    return nearest_within(root[:, None] * axes.T, -(axes.T @ slope) / root, low, high)


def damped_step(
    at: np.ndarray, slope: np.ndarray, curvature: np.ndarray, damping: float | np.ndarray, low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Where a damped Gauss-Newton step from a point (p,) ends, within the bounds; one damping, or one for each (p,)."""
    diagonal = np.diag(curvature)
    damped = curvature + np.diag(damping * diagonal + 1e-9 * diagonal.max() + 1e-12)
    return at + bounded_step(damped, slope, np.maximum(low - at, -LONGEST), np.minimum(high - at, LONGEST))


def may_turn(at: np.ndarray, slope: np.ndarray, low: np.ndarray, high: np.ndarray) -> bool:
    """Whether a cost falls from a point (p,) along any number that is not held there by a bound."""
    return not (((at <= low + 1e-9) & (slope > 0.0)) | ((at >= high - 1e-9) & (slope < 0.0))).all()


def nearest_within(matrix: np.ndarray, wanted: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The ``x`` (p,) within bounds that brings ``matrix @ x`` (m,) nearest to ``wanted`` (m,)."""
    bounds = (np.minimum(low, -NARROWEST), np.maximum(high, NARROWEST))
    return np.clip(lsq_linear(matrix, wanted, bounds, method="bvls").x, low, high)
