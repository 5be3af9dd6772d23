"""Drives of a legged machine for tests of its identification: motor, pulleys, leg, cable, each integrated on its own.

Nothing here is shared with the code under test; steps are a fifth of a sample, by the midpoint rule, on plain floats.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

FINE = 5  # steps per sample

Acceleration = Callable[[list[float], list[float], float], list[float]]
"""Of positions, speeds and the command."""


def log(command: np.ndarray, acceleration: Acceleration, start: list[float], period: float = 1e-3) -> np.ndarray:
    """Positions (n, k) at each sample, from rest at ``start`` (k), the command held between samples.

    Args:
        command: (n,).
        acceleration: of the k positions.
        start: positions.
        period: of the samples [s].
    """
    step, count = period / FINE, range(len(start))
    place, speed = list(start), [0.0] * len(start)
    rows = []
    for torque in command.tolist():
        rows.append(place)
        for _ in range(FINE):
            push = acceleration(place, speed, torque)
            half_speed = [speed[k] + 0.5 * step * push[k] for k in count]
            half_place = [place[k] + 0.5 * step * speed[k] for k in count]
            push = acceleration(half_place, half_speed, torque)
            place = [place[k] + step * half_speed[k] for k in count]
            speed = [speed[k] + step * push[k] for k in count]
    return np.array(rows)


def encoder(angle: np.ndarray, ticks: int, rng: np.random.Generator) -> np.ndarray:
    """What an encoder with a third of a step of noise says."""
    step = 2.0 * np.pi / ticks
    return step * np.round(angle / step + rng.normal(0.0, 0.33, np.shape(angle)))


def pulleys(constant: float, inertia: float, friction: float, bias: float) -> Acceleration:
    """A motor with pulleys: its constant [N.m commanded per N.m], and its own inertia and friction."""

    def acceleration(place: list[float], speed: list[float], torque: float) -> list[float]:
        return [((torque + bias) / constant - friction * speed[0]) / inertia]

    return acceleration


def bending_leg(motor: dict[str, float], links: dict[str, tuple[float, float, float]], ratio: float) -> Acceleration:
    """A leg whose knee bends under its motor: thigh at q, shin at -q, by the paths of its centres of mass.

    Args:
        motor: constant, inertia, friction, bias.
        links: mass [kg], distance of the centre of mass from the upper joint [m], inertia about it [kg.m2] of thigh and
            shin; the thigh is 0.5 m long.
        ratio: motor turns per q; the position is that of the motor.
    """
    (m1, c1, i1), (m2, c2, i2) = links["thigh"], links["shin"]
    turning = i1 + i2 + motor["inertia"] * ratio**2

    def acceleration(place: list[float], speed: list[float], torque: float) -> list[float]:
        sine, cosine, w = math.sin(place[0] / ratio), math.cos(place[0] / ratio), speed[0] / ratio
        # the shin's centre is at ((0.5 - c2) sin q, -(0.5 + c2) cos q): an ellipse
        across, along = 0.5 - c2, 0.5 + c2
        inertia = turning + m1 * c1**2 + m2 * ((across * cosine) ** 2 + (along * sine) ** 2)
        slope = m2 * (along**2 - across**2) * 2.0 * sine * cosine
        push = ((torque + motor["bias"]) / motor["constant"]) * ratio - motor["friction"] * ratio**2 * w
        push -= 9.81 * (m1 * c1 + m2 * along) * sine
        return [(push - 0.5 * slope * w * w) / inertia * ratio]

    return acceleration


def stretching_cable(motor: dict[str, float], cable: tuple[float, float], load: tuple[float, float]) -> Acceleration:
    """A motor that pulls a load over a cable; positions are of motor and load, both at the motor.

    Args:
        motor: constant, inertia, friction, bias.
        cable: stiffness [N.m/rad] and damping [N.m.s/rad].
        load: inertia [kg.m2] and the torque that holds it back per sine of its angle [N.m].
    """

    def acceleration(place: list[float], speed: list[float], torque: float) -> list[float]:
        pull = cable[0] * (place[0] - place[1]) + cable[1] * (speed[0] - speed[1])
        own = (torque + motor["bias"]) / motor["constant"] - motor["friction"] * speed[0] - pull
        return [own / motor["inertia"], (pull - load[1] * math.sin(place[1])) / load[0]]

    return acceleration
