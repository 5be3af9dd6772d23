"""The bounded linear step of every fit."""

from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear

NARROWEST = 1e-9  # the solver needs some room between bounds


def bounded_step(curvature: np.ndarray, slope: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The step (p,) within bounds that minimises ``slope @ x + x @ curvature @ x / 2``.

    The free step is taken where it is within the bounds; only else is the bounded problem solved.

    Args:
        curvature: symmetric and positive definite (p, p).
        slope: (p,).
        low, high: bounds of the step (p,), on either side of zero.
    """
    free = -np.linalg.solve(curvature, slope)
    if ((free >= low) & (free <= high)).all():
        return free
    size, axes = np.linalg.eigh(curvature)
    root = np.sqrt(np.maximum(size, 1e-15 * size[-1]))
    return nearest_within(root[:, None] * axes.T, -(axes.T @ slope) / root, low, high)


def nearest_within(matrix: np.ndarray, wanted: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The ``x`` (p,) within bounds that brings ``matrix @ x`` (m,) nearest to ``wanted`` (m,)."""
    bounds = (np.minimum(low, -NARROWEST), np.maximum(high, NARROWEST))
    return np.clip(lsq_linear(matrix, wanted, bounds, method="bvls").x, low, high)
