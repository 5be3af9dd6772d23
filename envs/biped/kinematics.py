"""Where the biped's points are, from angles alone: what its computer can know, and what its static balance needs.

Every point of the robot is a sum of vectors, each fixed in one of five segments: torso, left thigh, left shin, right
thigh, right shin. So a point is an array of weights (5, 2), forward and up in each segment where it is upright.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

TURNED = np.array(
    [
        [1.0, 0.0, 0.0, 0.0, 0.0],
        [1.0, 1.0, 1.0, 0.0, 0.0],
        [1.0, 1.0, -1.0, 0.0, 0.0],
        [1.0, 0.0, 0.0, 1.0, 1.0],
        [1.0, 0.0, 0.0, 1.0, -1.0],
    ]
)
"""Absolute angles of the segments from pitch, and leg angle and leg shape of left and right: paper 003, (1)."""


def segments(pitch: np.ndarray | float, link: np.ndarray) -> np.ndarray:
    """Absolute angles of the segments (..., 5) [rad] from the torso's pitch (...) and leg coordinates (..., 4)."""
    pitch = pitch + np.zeros_like(link[..., 0])
    left, right = (pitch + link[..., 0], link[..., 1]), (pitch + link[..., 2], link[..., 3])
    return np.stack([pitch, *(angle + sign * shape for angle, shape in (left, right) for sign in (1.0, -1.0))], axis=-1)


def place(point: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Position from the hip, forward and up (..., 2) [m], of a point (5, 2) at segment angles (..., 5)."""
    sine, cosine = np.sin(angles), np.cos(angles)
    ahead, above = np.zeros_like(angles[..., 0]), np.zeros_like(angles[..., 0])
    for segment, (forward, up) in enumerate(point):  # in one order at any batch size: equal simulations stay equal
        ahead = ahead + (cosine[..., segment] * forward - sine[..., segment] * up)
        above = above + (sine[..., segment] * forward + cosine[..., segment] * up)
    return np.stack([ahead, above], axis=-1)


def centre_of_mass(values: Mapping[str, float]) -> np.ndarray:
    """The centre of mass of the robot without its boom, as a point (5, 2) [m].

    The carriers of the differentials count as masses on the hip's axis.
    """
    own = np.array([[values[f"{link}_forward"], values[f"{link}_centre"]] for link in ("torso", "thigh", "shin")])
    own[1:, 1] *= -1.0  # legs hang down
    torso, thigh, shin = own * np.array([[values[f"{link}_mass"]] for link in ("torso", "thigh", "shin")])
    thigh[1] -= values["shin_mass"] * values["thigh_length"]
    return np.array([torso, thigh, shin, thigh, shin]) / robot_mass(values)


def feet(values: Mapping[str, float]) -> np.ndarray:
    """The centres of the round feet as points (2 sides, 5, 2) [m]; the soles are a radius below."""
    points = np.zeros((2, 5, 2))
    for side in range(2):
        points[side, 1 + 2 * side, 1] = -values["thigh_length"]
        points[side, 2 + 2 * side, 1] = values["foot_radius"] - values["shin_length"]
    return points


def robot_mass(values: Mapping[str, float]) -> float:
    """Mass of the links, without boom [kg]."""
    both = ("thigh", "shin", "spring_carrier", "shin_carrier")
    return values["torso_mass"] + 2.0 * sum(values[f"{link}_mass"] for link in both)
