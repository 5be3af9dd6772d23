"""Where the tool is: standard Denavit-Hartenberg parameters of table I (paper 002), and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

TWIST = (np.pi / 2.0, -np.pi / 2.0, 0.0)  # alpha of table I [rad]


@dataclass(frozen=True)
class Lengths:
    """Lengths of table I.

    Attributes:
        height: r_1, of joint 2 over the ground [m].
        upper: a_2 [m].
        fore: a_3 [m].
    """

    height: float = 0.577
    upper: float = 0.29
    fore: float = 0.29


PRINTED = Lengths()


def transform(alpha: float, a: float, theta: float, r: float) -> np.ndarray:
    """One standard Denavit-Hartenberg step Rz(theta) Tz(r) Tx(a) Rx(alpha), (4, 4)."""
    c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0.0, sa, ca, r], [0.0, 0.0, 0.0, 1.0]])


def chain(joints: np.ndarray, lengths: Lengths = PRINTED) -> np.ndarray:
    """Pose of the tool by the product of the three steps of table I, (4, 4), at joint angles (3,) [rad]."""
    pose = np.eye(4)
    for alpha, a, theta, r in zip(
        TWIST, (0.0, lengths.upper, lengths.fore), joints, (lengths.height, 0.0, 0.0), strict=True
    ):
        pose = pose @ transform(alpha, a, float(theta), r)
    return pose


def tool(joints: np.ndarray, lengths: Lengths = PRINTED) -> np.ndarray:
    """Position of the tool (..., 3) [m] at joint angles (..., 3) [rad]: the product of :func:`chain` written out."""
    first, second, third = (joints[..., k] for k in range(3))
    reach, aside = lengths.upper + lengths.fore * np.cos(third), lengths.fore * np.sin(third)
    ahead = reach * np.cos(second)
    return np.stack(
        [
            ahead * np.cos(first) - aside * np.sin(first),
            ahead * np.sin(first) + aside * np.cos(first),
            lengths.height + reach * np.sin(second),
        ],
        axis=-1,
    )


def joints(place: np.ndarray, lengths: Lengths = PRINTED) -> np.ndarray:
    """Joint angles (..., 3) [rad] that bring the tool to ``place`` (..., 3) [m], with joint 3 bent to positive angles.

    A place out of reach is answered with the nearest one on the way to it.
    """
    x, y, z = (place[..., k] for k in range(3))
    up = z - lengths.height
    square = x**2 + y**2 + up**2
    a, b = lengths.upper, lengths.fore
    third = np.arccos(np.clip((square - a**2 - b**2) / (2.0 * a * b), -1.0, 1.0))
    reach, aside = a + b * np.cos(third), b * np.sin(third)
    second = np.arcsin(np.clip(up / np.maximum(reach, 1e-12), -1.0, 1.0))
    first = np.arctan2(y, x) - np.arctan2(aside, reach * np.cos(second))
    return np.stack([np.arctan2(np.sin(first), np.cos(first)), second, third], axis=-1)


def jacobian(joints: np.ndarray, lengths: Lengths = PRINTED) -> np.ndarray:
    """Speed of the tool per joint speed (..., 3, 3) [m]."""
    first, second, third = (joints[..., k] for k in range(3))
    c1, s1, c2, s2 = np.cos(first), np.sin(first), np.cos(second), np.sin(second)
    reach, aside = lengths.upper + lengths.fore * np.cos(third), lengths.fore * np.sin(third)
    inward, along = -lengths.fore * np.sin(third), lengths.fore * np.cos(third)  # their changes with joint 3
    columns = (
        (-reach * c2 * s1 - aside * c1, reach * c2 * c1 - aside * s1, np.zeros_like(first)),
        (-reach * s2 * c1, -reach * s2 * s1, reach * c2),
        (inward * c2 * c1 - along * s1, inward * c2 * s1 + along * c1, inward * s2),
    )
    return np.stack([np.stack(column, axis=-1) for column in columns], axis=-1)
