"""Kinematics of a pantograph leg: paper 001, equations (9) and (10), and what follows from them for the foot.

The leg lies in a vertical plane through the axis that it turns about. Point A moves up and down by ``q_v``, D to and
fro by ``q_h``; AB and BD join them, AC is AB drawn longer by ``ratio``, CF is parallel to BD and longer by the same
ratio. So A, D and the foot F stay on one line, and F copies D as seen from A, times the ratio:

    x_F = ratio q_h,   z_F = -(ratio - 1) q_v
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from .parameters import LEGS

Array = np.ndarray | float


class Joints(NamedTuple):
    """Coordinates of a leg: rotation [rad], vertical and horizontal screw [m]."""

    rotation: Array
    vertical: Array
    horizontal: Array


def leg_angle(leg: int) -> float:
    """Direction of a leg about the body [rad]; leg 0 points forward.

    The paper's Fig. 4 is not at hand: this follows from its legs being equally distributed, all its horizontal joints
    moving in a forward gait, and the load on leg 0 growing as the robot advances.
    """
    return 2.0 * np.pi * leg / LEGS


def link_angles(values: Mapping[str, float], vertical: Array, horizontal: Array) -> tuple[Array, Array]:
    """Rise ``p_0`` of AB over the horizontal, and angle ``p_1`` between AB and BD at B [rad]: equations (9), (10)."""
    c, length = values["ab_length"], values["bd_length"]
    square = np.square(vertical) + np.square(horizontal)
    apart = np.sqrt(square)
    first = np.arccos((square + c**2 - length**2) / (2.0 * c * apart)) - np.arcsin(vertical / apart)
    second = np.arccos((c**2 + length**2 - square) / (2.0 * length * c))
    return first, second


def foot_from_joints(values: Mapping[str, float], joints: Joints) -> tuple[Array, Array, Array]:
    """Centre of the foot in the frame of the leg's axis, x outward along the undeflected leg, z up from D [m].

    A leg turns by ``-rotation`` about the upward axis: equation (11).
    """
    reach, ratio = values["ratio"] * np.asarray(joints.horizontal), values["ratio"]
    return (
        reach * np.cos(joints.rotation),
        -reach * np.sin(joints.rotation),
        -(ratio - 1.0) * np.asarray(joints.vertical),
    )


def joints_from_foot(values: Mapping[str, float], x: Array, y: Array, z: Array) -> Joints:
    """The coordinates that put the foot's centre at (x, y, z), as :func:`foot_from_joints` names it."""
    ratio = values["ratio"]
    return Joints(-np.arctan2(y, x), np.negative(z) / (ratio - 1.0), np.hypot(x, y) / ratio)


def stance(values: Mapping[str, float]) -> Joints:
    """Coordinates of a leg in the middle of its work space."""
    reach, height = values["stance_radius"] - values["leg_radius"], values["stance_height"] - values["foot_radius"]
    return joints_from_foot(values, reach, 0.0, -height)


def foot_load(values: Mapping[str, float]) -> float:
    """Load on the foot per contact force at the vertical screw, which the weight turns back."""
    return -1.0 / (values["ratio"] - 1.0)
