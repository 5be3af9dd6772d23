"""The biped's four drives as printed, and the chains that follow from them.

Numbers are printed at the motors; a chain acts on a leg coordinate, leg angle or leg shape. So torques are multiplied
by the gear ratio, and inertias, stiffnesses and frictions by its square. The sign of the leg angle's printed ratio,
-23.53, only says which way the motor is mounted and is left out.

Two tables reached us damaged. Table IV prints the motor constants 0.995, 1.332, 1.087, 1.069 in the order mLS left, mLA
left, mLS right, mLA right. Its own text contradicts this: those of the leg angles are "nearly identical", those of the
leg shapes differ. So does table III, whose inertias are 1.2 to 1.4 times as large for mLS right as for mLS left. The
second and the third number are taken as exchanged. In table VI, three of four numbers are left for the cables; the
fourth, mLA right, is assumed to be as mLA left.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...actuators import Chain, load_chain

ANGLE, SHAPE = "leg_angle", "leg_shape"
RATIO = {ANGLE: 23.53, SHAPE: 31.42}
"""Motor turns per turn of the leg coordinate: paper 003, (6)."""
SPRING_RATIO = 5.18  # turns of the pulley Bspring per turn of the leg shape: paper 003, (6)
SPRING_PULLEY = 1.8686e-3  # [kg.m2] of Bspring, table VIII
SPRING_DAMPING = 1.5  # [N.m.s/rad] at the pulley, K_dB of table VI


@dataclass(frozen=True)
class Drive:
    """One motor with its transmission, at the motor.

    Attributes:
        kind: ANGLE or SHAPE.
        rotor_inertia: as the manufacturer gives it [kg.m2], table VIII.
        lumped_inertia: identified with more and more pulleys, times the motor constant [kg.m2], table III.
        lumped_friction: likewise [N.m.s/rad], table III.
        inertia_factor: alpha, true by given rotor inertia, table IV.
        motor_constant: K_T, commanded by delivered torque, table IV.
        bias: of the amplifier, in commanded torque [N.m], table IV.
        leg_friction: with the legs on [N.m.s/rad], table V.
        leg_bias: likewise [N.m], table V.
        cable_stiffness: K_C [N.m/rad], table VI.
        cable_damping: K_dC [N.m.s/rad], table VI.
        spring_stiffness: K_B at the pulley [N.m/rad], Fig. 19; 0 for a leg angle, which has none.
    """

    kind: str
    rotor_inertia: float
    lumped_inertia: tuple[float, float, float]
    lumped_friction: tuple[float, float, float]
    inertia_factor: float
    motor_constant: float
    bias: float
    leg_friction: float
    leg_bias: float
    cable_stiffness: float
    cable_damping: float
    spring_stiffness: float = 0.0

    @property
    def ratio(self) -> float:
        """Motor turns per turn of the leg coordinate."""
        return RATIO[self.kind]


DRIVES = {
    "left_leg_angle": Drive(
        ANGLE,
        rotor_inertia=4.4928e-4,
        lumped_inertia=(5.514e-4, 7.223e-4, 7.436e-4),
        lumped_friction=(2.332e-3, 4.365e-3, 3.858e-3),
        inertia_factor=0.741,
        motor_constant=1.087,
        bias=-0.04652,
        leg_friction=4.316e-3,
        leg_bias=2.597e-2,
        cable_stiffness=3.5,
        cable_damping=0.0889,
    ),
    "left_leg_shape": Drive(
        SHAPE,
        rotor_inertia=9.0144e-4,
        lumped_inertia=(8.819e-4, 1.099e-3, 1.112e-3),
        lumped_friction=(5.655e-3, 6.518e-3, 7.142e-3),
        inertia_factor=0.934,
        motor_constant=0.995,
        bias=-0.1076,
        leg_friction=9.844e-3,
        leg_bias=-8.417e-3,
        cable_stiffness=2.9565,
        cable_damping=0.0402,
        spring_stiffness=115.1,
    ),
    "right_leg_angle": Drive(
        ANGLE,
        rotor_inertia=4.4928e-4,
        lumped_inertia=(5.217e-4, 6.900e-4, 7.328e-4),
        lumped_friction=(1.718e-3, 4.048e-3, 4.703e-3),
        inertia_factor=0.763,
        motor_constant=1.069,
        bias=-0.001672,
        leg_friction=4.615e-3,
        leg_bias=-2.461e-3,
        cable_stiffness=3.5,
        cable_damping=0.0889,
    ),
    "right_leg_shape": Drive(
        SHAPE,
        rotor_inertia=9.0144e-4,
        lumped_inertia=(1.104e-3, 1.360e-3, 1.431e-3),
        lumped_friction=(6.545e-3, 9.811e-3, 9.879e-3),
        inertia_factor=0.930,
        motor_constant=1.332,
        bias=0.02995,
        leg_friction=9.027e-3,
        leg_bias=-1.446e-2,
        cable_stiffness=3.8094,
        cable_damping=0.3556,
        spring_stiffness=111.7,
    ),
}
"""Tables III to VI and VIII of paper 003. Table III prints 1.112e-04 for mLS left, i = 3; the power is a misprint."""

PULLEYS = {  # of the three combinations of Fig. 9 and 10
    kind: tuple(
        sum(
            drive.lumped_inertia[step] / drive.motor_constant - drive.inertia_factor * drive.rotor_inertia
            for drive in DRIVES.values()
            if drive.kind == kind
        )
        / 2.0
        for step in range(3)
    )
    for kind in (ANGLE, SHAPE)
}
"""Inertia of pulleys and cables at the motor [kg.m2]: equation (10) solved for it, mean of both sides, whose pulleys
are the same. The paper took it from CAD, with radii that it does not print."""

ENCODER = 2048  # steps per turn of a motor, assumed
TORQUE_LIMIT = {ANGLE: 8.0, SHAPE: 16.0}  # [N.m] of the motors, assumed: walking needs 2 and 8 (section IV-C)
STIFFNESS = {ANGLE: 850.0, SHAPE: 7100.0}  # [N.m/rad] at the leg, assumed: gains of the hopping controller
DAMPING = {ANGLE: 60.0, SHAPE: 250.0}  # [N.m.s/rad] at the leg, likewise


def transmission(name: str) -> list[dict[str, Any]]:
    """The stages from the amplifier on, the same whoever commands the torque; at the leg coordinate."""
    drive = DRIVES[name]
    ratio = drive.ratio
    stages: list[dict[str, Any]] = [
        {"offset": {"value": drive.leg_bias * ratio}},
        {"scale": {"factor": 1.0 / drive.motor_constant}},
        {"friction": {"viscous": drive.leg_friction * ratio**2}},
    ]
    if drive.spring_stiffness:
        square = SPRING_RATIO**2
        stages.append(
            {
                "spring": {
                    "stiffness": drive.spring_stiffness * square,
                    "damping": SPRING_DAMPING * square,
                    "inertia": SPRING_PULLEY * square,
                    "unilateral": 1,
                }
            }
        )
    cable = {"stiffness": drive.cable_stiffness * ratio**2, "damping": drive.cable_damping * ratio**2}
    return [*stages, {"compliance": cable}, {"encoder": {"ticks": ENCODER * ratio}}]


def armature(name: str) -> float:
    """Inertia of rotor, pulleys and cables at the leg coordinate [kg.m2]."""
    drive = DRIVES[name]
    return (drive.inertia_factor * drive.rotor_inertia + PULLEYS[drive.kind][2]) * drive.ratio**2


def torque_chain(name: str) -> Chain:
    """The drive under torque commands at the leg coordinate [N.m], as the paper's controller gives them."""
    return load_chain([{"torque_command": {"armature": armature(name)}}, *transmission(name)])


def position_chain(name: str) -> Chain:
    """The drive with a position loop on the motor's encoder, for learning."""
    kind = DRIVES[name].kind
    loop = {
        "stiffness": STIFFNESS[kind],
        "damping": DAMPING[kind],
        "torque_limit": TORQUE_LIMIT[kind] * RATIO[kind],
        "armature": armature(name),
    }
    return load_chain([{"ideal": loop}, *transmission(name)])
