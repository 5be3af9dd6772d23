"""What the tables of the biped's paper say about each other, by arithmetic and by one model of each kind."""

from __future__ import annotations

import math

import numpy as np

from ...envs.biped.drive import ANGLE, DRIVES, SHAPE, SPRING_RATIO, Drive, torque_chain
from ...envs.biped.parameters import LEFT, RIGHT, SIDES
from ...envs.biped.robot import BIPED, coordinate
from ..published import Mark, Otherwise, Row, half_digit
from . import choices
from .controller import HoppingController, Phase
from .hopping import HoppingExperiment, rigid_cables

INPUTS: Mark = "follows from the inputs"
WALKING = {ANGLE: 2.0, SHAPE: 8.0}
"""Torques of walking that IV-C compares biases with [N.m]."""
LINKS = ("spring_carrier", "shin_carrier", "thigh", "shin")
TABLE_IV = {"left_leg_angle": 1.332, "right_leg_shape": 1.087}
"""Motor constants that are exchanged here, as table IV has them."""


def pulley_inertia(name: str, combination: int, constant: float | None = None) -> float:
    """Pulleys and cables of one motor at the motor [kg.m2]: (10) solved for it, with tables III, IV and VIII.

    Args:
        name: of the drive.
        combination: of its pulleys, 0 to 2.
        constant: of the motor, if it is another.
    """
    drive = DRIVES[name]
    return drive.lumped_inertia[combination] / (constant or drive.motor_constant) - (
        drive.inertia_factor * drive.rotor_inertia
    )


def input_rows() -> list[Row]:
    """Arithmetic of tables III, IV, V, VII and VIII."""
    worst = min(DRIVES, key=lambda name: pulley_inertia(name, 0))
    least = pulley_inertia(worst, 0)
    in_order = min(pulley_inertia(name, 0, TABLE_IV.get(name)) for name in DRIVES)
    sides = ", ".join(f"{1e4 * pulley_inertia(coordinate(side, SHAPE), 0):.2f}" for side in SIDES)
    values = BIPED.parameters()
    mass = values["torso_mass"] + 2.0 * sum(values[f"{link}_mass"] for link in LINKS)
    grows = [friction_with_leg(drive, drive.motor_constant) for drive in DRIVES.values()]
    as_it_stands = [friction_with_leg(DRIVES[name], constant) for name, constant in TABLE_IV.items()]
    alike, different = (
        DRIVES[coordinate(RIGHT, kind)].motor_constant / DRIVES[coordinate(LEFT, kind)].motor_constant
        for kind in (ANGLE, SHAPE)
    )
    free, rigid = (HoppingExperiment(chains=chains).model.nv for chains in (torque_chain, rigid_cables))
    less = HoppingController(phase=Phase.FLIGHT)
    for boom in (0.0, math.radians(-1.0) + less.gait.travel):
        less.phase = Phase.FLIGHT
        less.torques(0.0, 0.0, np.zeros(2), np.zeros(2), np.array([True, True]), 1.0, boom)
    leans = math.degrees(less.lean - less.gait.torso)
    alpha = {kind: [DRIVES[coordinate(side, kind)].inertia_factor for side in SIDES] for kind in (ANGLE, SHAPE)}
    apart = max(abs(pair[1] / pair[0] - 1.0) for pair in alpha.values())
    biases = {name: abs(drive.bias) / WALKING[drive.kind] for name, drive in DRIVES.items()}
    largest = max(biases, key=lambda name: biases[name])
    springs = [DRIVES[coordinate(side, SHAPE)].spring_stiffness for side in SIDES]
    return [
        Row(
            "mass without the boom", "I", 60.0, mass, INPUTS, "kg", half_digit(60.0, 0), judged="half a digit",
            rests=(), note="the sum of table VII",
        ),
        Row(
            "height of the hip, legs straight", "I", 1.0, values["thigh_length"] + values["shin_length"], INPUTS, "m",
            half_digit(0.5, 2), judged="half a digit of 50 cm", rests=(),
        ),
        Row(
            "degrees of freedom of the dynamic model", "abstract, (28)", 11.0, float(rigid), INPUTS, "", 0.0,
            judged="as many", rests=(), note=f"{free} with cables that stretch, which is the length of (28)",
        ),
        Row(
            "the torso leans back if the boom turned less than wanted, (44)", "appendix C", "back",
            f"{abs(leans):.0f} deg {'back' if leans < 0.0 else 'forward'} for a degree less", INPUTS,
            agrees=leans < 0.0, judged="back or not", rests=(),
        ),
        Row(
            "inertia of every combination of pulleys by (10)", "tables III, IV, VIII", "positive",
            f"{worst.replace('_', ' ')}, i = 1: {1e4 * least:.3f}e-4 kg.m2", "predicted", agrees=least > 0.0,
            judged="positive or not", rests=("order_of_table_IV",),
            sensitivity=(
                Otherwise("motor constants in the order of table IV", f"{1e4 * in_order:.3f}e-4 kg.m2 at least"),
            ),
            note=f"leg shape, i = 1, left and right: {sides}e-4 kg.m2, of equal pulleys; the model takes the mean, "
            "which hides that the right one is below zero",
        ),
        Row(
            "rotor inertia factors alpha, left and right", "IV-C, table IV", "very close",
            ", ".join(f"{kind.replace('_', ' ')} {pair[0]} and {pair[1]}" for kind, pair in alpha.items()), INPUTS,
            agrees=apart < 0.05, judged="assumed: a twentieth", rests=(), note=f"at most {apart:.1%} apart",
        ),
        Row(
            "biases beside torques of walking, 2 and 8 N.m", "IV-C, table IV", "very small",
            f"{largest.replace('_', ' ')}: {biases[largest]:.1%}", INPUTS, agrees=biases[largest] < 0.05,
            judged="assumed: a twentieth", rests=(), note="the largest of four",
        ),
        Row(
            "factor of (23), half of the ratio in (6)", "(23)", 2.590617, 0.5 * SPRING_RATIO, INPUTS, "",
            half_digit(SPRING_RATIO, 2), judged="half a digit of the ratio", rests=(),
        ),
        Row(
            "the springs' constants, right over left", "VII-A, Fig. 19", "consistent", f"{springs[1] / springs[0]:.3f}",
            INPUTS, agrees=abs(springs[1] / springs[0] - 1.0) < 0.05, judged="assumed: a twentieth", rests=(),
            note="the torques at no deflection are not consistent: 2.214 and 5.377 N.m",
        ),
        Row(
            choices.ALIKE, "IV-C, table IV", "alike, different", f"{alike:.3f}, {different:.3f}", "fitted",
            agrees=abs(alike - 1.0) < 0.1 < abs(different - 1.0), judged="assumed: within a tenth is alike",
            rests=("order_of_table_IV",),
        ),
        Row(
            "friction with the legs on over that without, the least of four", "V-C, table V", "larger",
            f"{min(grows):.3f}", "predicted", agrees=min(grows) > 1.0, judged="larger or not",
            rests=("order_of_table_IV",),
            sensitivity=(Otherwise("motor constants in the order of table IV", f"{min(as_it_stands):.3f}"),),
        ),
        Row(
            "friction with the legs on over that without, the most of four", "V-C, table V", "not greatly different",
            f"{max(grows):.3f}", "predicted", agrees=max(grows) < 1.5, judged="assumed: by less than half",
            rests=("order_of_table_IV",),
            sensitivity=(Otherwise("motor constants in the order of table IV", f"{max(as_it_stands):.3f}"),),
        ),
    ]  # fmt: skip


def friction_with_leg(drive: Drive, constant: float) -> float:
    """Friction of table V over that of all pulleys in table III, brought to the motor by a motor constant."""
    return drive.leg_friction / (drive.lumped_friction[2] / constant)
