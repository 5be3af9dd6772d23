"""Both coordinates of a leg at once: the validation of paper 003, V-C, whose biases make a simulation follow, (20).

Friction and everything else come from the stages before, where one coordinate moved alone. So this stage fits two
numbers, and what is left shows how well the model holds where both coordinates act on each other (Fig. 16).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numba
import numpy as np
from scipy.optimize import least_squares

from ...actuators.gravity import GRAVITY
from .identification import IdentificationError, Record


@dataclass(frozen=True)
class LegLoad:
    """Both segments of a leg about a hip that is held, from drawings.

    Attributes:
        thigh: inertia about the hip, with the shin's mass at the knee [kg.m2].
        shin: inertia about the knee, with what turns with it [kg.m2].
        coupling: of thigh and shin, times the cosine of the angle between them [kg.m2].
        carrier: inertia that turns with twice the leg shape [kg.m2].
        thigh_moment, shin_moment: along and across the segment (2,) [kg.m].
    """

    thigh: float
    shin: float
    coupling: float
    carrier: float
    thigh_moment: tuple[float, float]
    shin_moment: tuple[float, float]


@dataclass(frozen=True)
class Together:
    """What both coordinates at once show.

    Attributes:
        bias: of leg angle and leg shape, in commanded torque (2,) [N.m].
        residual: of leg angle and leg shape, rms (2,) [rad at the leg].
        spread: of the measured angles about their means (2,) [rad at the leg].
        unadjusted: the residual with the biases of the motors without legs (2,) [rad at the leg].
    """

    bias: tuple[float, float]
    residual: tuple[float, float]
    spread: tuple[float, float]
    unadjusted: tuple[float, float]


def both_segments(values: Mapping[str, float]) -> LegLoad:
    """A leg from the robot's numbers (table VII)."""
    length, mass = values["thigh_length"], values["shin_mass"]
    return LegLoad(
        values["thigh_inertia"] + mass * length**2,
        values["shin_inertia"] + values["shin_carrier_inertia"],
        mass * length * values["shin_centre"],
        values["spring_carrier_inertia"],
        (
            values["thigh_mass"] * values["thigh_centre"] + mass * length,
            values["thigh_mass"] * values["thigh_forward"],
        ),
        (mass * values["shin_centre"], mass * values["shin_forward"]),
    )


def fit_both(
    records: Sequence[Record],
    load: LegLoad,
    ratios: Sequence[float],
    constants: Sequence[float],
    inertias: Sequence[float],
    frictions: Sequence[float],
    biases: Sequence[float],
) -> Together:
    """Biases that make a simulation of leg angle and leg shape follow their records best: (20).

    Args:
        records: of the motors of leg angle and leg shape, of one run that starts at rest.
        load: both segments, from drawings.
        ratios: motor turns per turn of each coordinate.
        constants: motor constants, from :func:`~sealegs.papers.biped.identification.fit_motor`.
        inertias: of rotor and pulleys at each motor [kg.m2].
        frictions: from :func:`~sealegs.papers.biped.identification.fit_leg` [N.m.s/rad].
        biases: of table IV, which the result tells the worth of [N.m]; the search begins without any.

    Raises:
        IdentificationError: the records are not of one run.
    """
    angle, shape = records
    if len(angle.time) != len(shape.time) or np.ptp(angle.time - shape.time) > 1e-9:
        raise IdentificationError("leg angle and leg shape must be recorded at the same times, in one run.")
    turns, period = np.asarray(ratios, float), angle.period
    measured = np.stack([angle.position, shape.position], axis=1) / turns
    numbers = np.array([load.thigh, load.shin, load.coupling, load.carrier, *load.thigh_moment, *load.shin_moment])
    armature = np.asarray(inertias, float) * turns**2
    drag = np.asarray(frictions, float) * turns**2
    commands = np.stack([angle.command, shape.command], axis=1)

    def angles(unknown: np.ndarray) -> np.ndarray:
        torque = (commands + unknown) * turns / np.asarray(constants, float)
        return _simulate_both(torque, period, numbers, armature, drag, measured[0])

    def residuals(unknown: np.ndarray) -> np.ndarray:
        return (angles(unknown) - measured).ravel()

    fit = least_squares(residuals, np.zeros(2), x_scale=1e-2, diff_step=1e-3, loss="soft_l1", f_scale=0.02)
    after, first = angles(fit.x) - measured, angles(np.asarray(biases, float)) - measured
    rms = [tuple(np.sqrt(np.mean(np.square(error), axis=0)).tolist()) for error in (after, first)]
    return Together(tuple(fit.x.tolist()), rms[0], tuple(measured.std(axis=0).tolist()), rms[1])


@numba.njit(cache=True)
def _rates(state, torque, numbers, armature, drag):  # type: ignore[no-untyped-def]
    """Rates of leg angle, leg shape and their speeds; thigh at angle + shape, shin at angle - shape."""
    thigh, shin, coupling, carrier, along_thigh, across_thigh, along_shin, across_shin = numbers
    angle, shape, w_angle, w_shape = state
    up, down = angle + shape, angle - shape
    c, s = np.cos(2.0 * shape), np.sin(2.0 * shape)
    a = thigh + shin + 2.0 * coupling * c + armature[0]
    b = thigh - shin
    d = thigh + shin - 2.0 * coupling * c + 4.0 * carrier + armature[1]
    pull_up = -GRAVITY * (along_thigh * np.sin(up) + across_thigh * np.cos(up))
    pull_down = -GRAVITY * (along_shin * np.sin(down) + across_shin * np.cos(down))
    # Christoffel terms of a(shape), constant b and d(shape)
    first = torque[0] - drag[0] * w_angle + pull_up + pull_down + 4.0 * coupling * s * w_angle * w_shape
    second = torque[1] - drag[1] * w_shape + pull_up - pull_down
    second -= 2.0 * coupling * s * (w_angle * w_angle + w_shape * w_shape)
    determinant = a * d - b * b
    return np.array([w_angle, w_shape, (d * first - b * second) / determinant, (a * second - b * first) / determinant])


@numba.njit(cache=True)
def _simulate_both(torque, period, numbers, armature, drag, start):  # type: ignore[no-untyped-def]
    """Leg angle and leg shape (n, 2) from rest, by Runge-Kutta, each torque held for a period."""
    places = np.empty((len(torque), 2))
    state = np.zeros(4)
    state[:2] = start
    for k in range(len(torque)):
        places[k] = state[:2]
        one = _rates(state, torque[k], numbers, armature, drag)
        two = _rates(state + 0.5 * period * one, torque[k], numbers, armature, drag)
        three = _rates(state + 0.5 * period * two, torque[k], numbers, armature, drag)
        four = _rates(state + period * three, torque[k], numbers, armature, drag)
        state += period * (one + 2.0 * two + 2.0 * three + four) / 6.0
    return places
