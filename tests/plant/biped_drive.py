"""Drives of a legged machine for tests of its identification: motor, pulleys, leg, cable, each integrated on its own.

Nothing here is shared with the code under test; steps are a tenth of a sample, by the midpoint rule.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

FINE = 10  # steps per sample


def log(
    command: np.ndarray,
    acceleration: Callable[[np.ndarray, np.ndarray, float], np.ndarray],
    start: np.ndarray,
    period: float = 1e-3,
) -> np.ndarray:
    """Positions (n, k) at each sample, from rest at ``start`` (k,), the command held between samples.

    Args:
        command: (n,).
        acceleration: of positions, speeds and the command, (k,).
        start: positions.
        period: of the samples [s].
    """
    step = period / FINE
    place, speed = np.array(start, float), np.zeros(len(start))
    rows = np.empty((len(command), len(start)))
    for k, torque in enumerate(command):
        rows[k] = place
        for _ in range(FINE):
            half_speed = speed + 0.5 * step * acceleration(place, speed, torque)
            half_place = place + 0.5 * step * speed
            place = place + step * half_speed
            speed = speed + step * acceleration(half_place, half_speed, torque)
    return rows


def encoder(angle: np.ndarray, ticks: int, rng: np.random.Generator) -> np.ndarray:
    """What an encoder with a third of a step of noise says."""
    step = 2.0 * np.pi / ticks
    return step * np.round(angle / step + rng.normal(0.0, 0.33, np.shape(angle)))


def pulleys(constant: float, inertia: float, friction: float, bias: float) -> Callable:
    """A motor with pulleys: its constant [N.m commanded per N.m], and its own inertia and friction."""

    def acceleration(place: np.ndarray, speed: np.ndarray, torque: float) -> np.ndarray:
        return ((torque + bias) / constant - friction * speed) / inertia

    return acceleration


def bending_leg(motor: dict[str, float], links: dict[str, tuple[float, float, float]], ratio: float) -> Callable:
    """A leg whose knee bends under its motor: thigh at q, shin at -q, from positions of the centres of mass.

    Args:
        motor: constant, inertia, friction, bias.
        links: mass [kg], distance of the centre of mass from the upper joint [m], inertia about it [kg.m2] of thigh and
            shin; the thigh is 0.5 m long.
        ratio: motor turns per q; the position is that of the motor.
    """
    (m1, c1, i1), (m2, c2, i2) = links["thigh"], links["shin"]

    def centres(q: float) -> np.ndarray:
        knee = np.array([0.5 * np.sin(q), -0.5 * np.cos(q)])
        return np.array([c1 * np.sin(q), -c1 * np.cos(q), *(knee + c2 * np.array([-np.sin(q), -np.cos(q)]))])

    weights, small = np.array([m1, m1, m2, m2]), 1e-5

    def inertia(q: float) -> float:
        slope = (centres(q + small) - centres(q - small)) / (2.0 * small)
        return float(weights @ slope**2) + i1 + i2 + motor["inertia"] * ratio**2

    def acceleration(place: np.ndarray, speed: np.ndarray, torque: float) -> np.ndarray:
        q, w = float(place[0]) / ratio, float(speed[0]) / ratio
        heights = (centres(q + small) - centres(q - small))[[1, 3]] / (2.0 * small)
        push = (torque + motor["bias"]) / motor["constant"] * ratio - motor["friction"] * ratio**2 * w
        push -= 9.81 * (m1 * heights[0] + m2 * heights[1])
        slope = (inertia(q + 1e-3) - inertia(q - 1e-3)) / 2e-3
        return np.array([(push - 0.5 * slope * w * w) / inertia(q) * ratio])

    return acceleration


def stretching_cable(motor: dict[str, float], cable: tuple[float, float], load: tuple[float, float]) -> Callable:
    """A motor that pulls a load over a cable; positions are of motor and load, both at the motor.

    Args:
        motor: constant, inertia, friction, bias.
        cable: stiffness [N.m/rad] and damping [N.m.s/rad].
        load: inertia [kg.m2] and the torque that holds it back per sine of its angle [N.m].
    """

    def acceleration(place: np.ndarray, speed: np.ndarray, torque: float) -> np.ndarray:
        pull = cable[0] * (place[0] - place[1]) + cable[1] * (speed[0] - speed[1])
        own = (torque + motor["bias"]) / motor["constant"] - motor["friction"] * speed[0] - pull
        return np.array([own / motor["inertia"], (pull - load[1] * np.sin(place[1])) / load[0]])

    return acceleration
