"""Where the foot is: equations (27), (31) to (34) of paper 000, and back. ``z`` is up, from the first joint."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np


def lengths(values: Mapping[str, float]) -> tuple[float, float, float]:
    """``a_1`` to ``a_3`` of table VI [m]."""
    return values["link1_length"], values["link2_length"], values["link3_length"]


def lengthening(values: Mapping[str, float], q: np.ndarray) -> np.ndarray:
    """Horizontal lengthening of the leg, equation (27) [m], from angles (..., 3) [rad]."""
    _, a2, a3 = lengths(values)
    return a3 * np.cos(q[..., 1] + q[..., 2]) + a2 * np.cos(q[..., 1])


def foot(values: Mapping[str, float], q: np.ndarray) -> np.ndarray:
    """Position of the foot (..., 3) [m] from angles (..., 3) [rad]."""
    a1, a2, a3 = lengths(values)
    reach = a1 + lengthening(values, q)
    up = a2 * np.sin(q[..., 1]) + a3 * np.sin(q[..., 1] + q[..., 2])
    return np.stack([reach * np.cos(q[..., 0]), reach * np.sin(q[..., 0]), up], axis=-1)


def angles(values: Mapping[str, float], position: np.ndarray) -> np.ndarray:
    """Joint angles (..., 3) [rad] of a foot position (..., 3) [m], knee up; nan out of reach."""
    a1, a2, a3 = lengths(values)
    x, y, z = position[..., 0], position[..., 1], position[..., 2]
    out = np.hypot(x, y) - a1
    cosine = (out**2 + z**2 - a2**2 - a3**2) / (2.0 * a2 * a3)
    with np.errstate(invalid="ignore"):
        knee = -np.arccos(cosine)
    hip = np.arctan2(z, out) - np.arctan2(a3 * np.sin(knee), a2 + a3 * np.cos(knee))
    return np.stack([np.arctan2(y, x), hip, knee], axis=-1)


def jacobian(values: Mapping[str, float], q: np.ndarray) -> np.ndarray:
    """Equation (34): foot velocity by joint speed (..., 3, 3) [m]."""
    a1, a2, a3 = lengths(values)
    s1, c1 = np.sin(q[..., 0]), np.cos(q[..., 0])
    s2, c2 = np.sin(q[..., 1]), np.cos(q[..., 1])
    s23, c23 = np.sin(q[..., 1] + q[..., 2]), np.cos(q[..., 1] + q[..., 2])
    reach, drop = a3 * c23 + a2 * c2 + a1, a3 * s23 + a2 * s2
    rows = [
        [-s1 * reach, -c1 * drop, -a3 * c1 * s23],
        [c1 * reach, -s1 * drop, -a3 * s1 * s23],
        [np.zeros_like(s1), a3 * c23 + a2 * c2, a3 * c23],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
