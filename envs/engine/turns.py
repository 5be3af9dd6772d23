"""Turns in space as quaternions (..., 4), w first, as MuJoCo has them; element by element, so that batches equal single
environments to the bit."""

from __future__ import annotations

import numpy as np


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The turn ``b`` and then ``a`` (..., 4)."""
    aw, ax, ay, az = (a[..., k] for k in range(4))
    bw, bx, by, bz = (b[..., k] for k in range(4))
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def inverse(turn: np.ndarray) -> np.ndarray:
    """The turn back (..., 4)."""
    return turn * np.array([1.0, -1.0, -1.0, -1.0])


def applied(turn: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """A vector (..., 3), turned."""
    w, axis = turn[..., :1], turn[..., 1:]
    twice = 2.0 * cross(axis, vector)
    return vector + w * twice + cross(axis, twice)


def of_vector(vector: np.ndarray) -> np.ndarray:
    """The turn (..., 4) about a vector (..., 3) by its length [rad]."""
    angle = np.sqrt(vector[..., 0] ** 2 + vector[..., 1] ** 2 + vector[..., 2] ** 2)[..., None]
    share = 0.5 * np.sinc(angle / (2.0 * np.pi))
    return np.concatenate([np.cos(0.5 * angle), share * vector], axis=-1)


def to_vector(turn: np.ndarray) -> np.ndarray:
    """The vector (..., 3) about which a turn goes the short way, as long as its angle [rad]."""
    turn = np.where(turn[..., :1] < 0.0, -turn, turn)
    size = np.linalg.norm(turn[..., 1:], axis=-1, keepdims=True)
    return turn[..., 1:] * (2.0 * np.arctan2(size, turn[..., :1]) / np.maximum(size, 1e-300))


def between(a: np.ndarray, b: np.ndarray, share: np.ndarray) -> np.ndarray:
    """From one turn (..., 4) towards a near one by a share (..., 1) of the way."""
    along = (a * b).sum(axis=-1, keepdims=True)
    mixed = (1.0 - share) * a + share * np.where(along < 0.0, -b, b)
    return mixed / np.sqrt((mixed**2).sum(axis=-1, keepdims=True))


def projected_gravity(turn: np.ndarray) -> np.ndarray:
    """Direction of gravity (..., 3), of length 1, in the axes of a body that is turned so."""
    w, x, y, z = (turn[..., k] for k in range(4))
    return np.stack([2.0 * (w * y - x * z), -2.0 * (y * z + w * x), 2.0 * (x * x + y * y) - 1.0], axis=-1)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product of vectors (..., 3), faster than NumPy's on small arrays."""
    ax, ay, az = (a[..., k] for k in range(3))
    bx, by, bz = (b[..., k] for k in range(3))
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)
