"""The everyday machines as their makers publish them: bodies, nominal servos, and what a sidecar believes. Assumed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .physics import Links, Servos

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Body:
    """One link, of a rod's inertia about its centre.

    Attributes:
        joint: that carries it.
        place: of the joint in the link before [m].
        axis: of it.
        mass: [kg].
        centre: of it [m].
        radii: of gyration about the axes of the link [m].
    """

    joint: str
    place: Vector
    axis: Vector
    mass: float
    centre: Vector
    radii: Vector


@dataclass(frozen=True)
class Machine:
    """A machine.

    Attributes:
        bodies: one behind the other.
        tip: name of what is fixed to the last link: a foot, a hand, a camera.
        tip_mass, tip_place: of it, as a small ball [kg, m].
        reach: of the goals of each joint either side of the middle [rad].
        middle: of its motion [rad].
    """

    bodies: tuple[Body, ...]
    tip: str
    tip_mass: float
    tip_place: Vector
    reach: tuple[float, ...]
    middle: tuple[float, ...]

    @property
    def joints(self) -> list[str]:
        """Names of the joints."""
        return [body.joint for body in self.bodies]


X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
TIP_RADIUS = 0.012  # [m] of gyration of what is at the tip

MACHINES = {
    "bench": Machine(
        (Body("servo", (0.0, 0.0, 0.5), Y, 0.03, (0.0, 0.0, -0.075), (0.0433, 0.0433, 1e-3)),),
        "weight", 0.3, (0.0, 0.0, -0.15), (0.9,), (0.0,),
    ),
    "pan_tilt": Machine(
        (
            Body("pan", (0.0, 0.0, 0.1), Z, 0.11, (0.01, 0.0, 0.03), (0.02, 0.02, 0.015)),
            Body("tilt", (0.02, 0.0, 0.05), Y, 0.08, (0.03, 0.0, 0.02), (0.015, 0.022, 0.022)),
        ),
        "camera", 0.12, (0.07, 0.0, 0.03), (1.0, 0.6), (0.0, 0.1),
    ),
    "leg": Machine(
        (
            Body("hip_roll", (0.0, 0.0, 0.4), X, 0.09, (0.02, 0.0, -0.01), (0.015, 0.02, 0.02)),
            Body("hip_pitch", (0.03, 0.0, -0.03), Y, 0.12, (0.0, 0.005, -0.06), (0.035, 0.035, 0.012)),
            Body("knee", (0.0, 0.01, -0.12), Y, 0.07, (0.0, 0.0, -0.05), (0.033, 0.033, 0.008)),
        ),
        "foot", 0.06, (0.01, 0.0, -0.12), (0.5, 0.8, 0.8), (0.0, 0.2, -0.4),
    ),
    "gripper": Machine(
        (
            Body("wrist", (0.0, 0.0, 0.2), X, 0.09, (0.03, 0.0, 0.0), (0.02, 0.02, 0.02)),
            Body("jaw", (0.06, 0.015, 0.0), Z, 0.025, (0.03, 0.0, 0.0), (0.004, 0.018, 0.018)),
        ),
        "pad", 0.01, (0.06, 0.0, 0.0), (1.0, 0.5), (0.0, 0.4),
    ),
    "arm": Machine(
        (
            Body("base", (0.0, 0.0, 0.06), Z, 0.1, (0.0, 0.0, 0.03), (0.022, 0.022, 0.02)),
            Body("shoulder", (0.0, 0.0, 0.05), Y, 0.11, (0.0, 0.0, 0.06), (0.036, 0.036, 0.014)),
            Body("elbow", (0.0, 0.0, 0.115), Y, 0.1, (0.06, 0.0, 0.0), (0.014, 0.036, 0.036)),
            Body("wrist_pitch", (0.125, 0.0, 0.0), Y, 0.07, (0.03, 0.0, 0.0), (0.015, 0.02, 0.02)),
            Body("wrist_roll", (0.06, 0.0, 0.0), X, 0.06, (0.015, 0.0, 0.0), (0.016, 0.014, 0.014)),
            Body("jaw", (0.03, 0.015, 0.0), Z, 0.02, (0.02, 0.0, 0.0), (0.004, 0.014, 0.014)),
        ),
        "tool", 0.02, (0.045, 0.0, 0.0), (0.9, 0.5, 0.6, 0.7, 0.9, 0.4), (0.0, 0.1, 0.2, 0.3, 0.0, 0.4),
    ),
}  # fmt: skip

BENCH = {"mass": 0.3, "length": 0.15, "arm_mass": 0.03}
"""What the sidecar of the bench believes."""
SERVO = {
    "gain": 5.3, "duty_limit": 0.97, "motor_constant": 1.2, "resistance": 2.7, "armature": 0.026, "coulomb": 0.052,
    "viscous": 0.059,
}  # fmt: skip
"""Of every joint: an STS3215 at 7.4 V, rounded from what is published of it."""
VOLTS, LATENCY = 7.4, 0.005
UNCERTAIN = ("motor_constant", "resistance", "armature", "coulomb", "viscous")
"""Numbers of a servo that are as wrong as a data sheet."""


def nominal_chain() -> list[dict[str, dict[str, float]]]:
    """What the sidecar believes of every joint."""
    return [
        {"delay": {"seconds": LATENCY}},
        {"position_p": {"gain": SERVO["gain"]}},
        {"duty_limit": {"limit": SERVO["duty_limit"]}},
        {"supply": {"volts": VOLTS, "resistance": 0.0}},
        {"dc_motor": {key: SERVO[key] for key in ("motor_constant", "resistance", "armature")}},
        {"friction": {key: SERVO[key] for key in ("coulomb", "viscous")}},
        {"encoder": {"ticks": 4096}},
    ]


def links_of(machine: Machine, masses: np.ndarray, tip_mass: float) -> Links:
    """The links with these masses (n,) and what is fixed to the last of them, which counts as a part of it."""
    centres = np.array([body.centre for body in machine.bodies], float)
    inertias = np.array(
        [np.diag(_moments(body.radii, mass)) for body, mass in zip(machine.bodies, masses, strict=True)]
    )
    whole = masses.copy()
    place = np.array(machine.tip_place)
    whole[-1] += tip_mass
    centre = (masses[-1] * centres[-1] + tip_mass * place) / whole[-1]
    inertias[-1] += tip_mass * TIP_RADIUS**2 * np.eye(3)
    for mass, at in ((masses[-1], centres[-1]), (tip_mass, place)):
        away = at - centre
        inertias[-1] += mass * (away @ away * np.eye(3) - np.outer(away, away))
    centres[-1] = centre
    return Links(
        np.array([body.place for body in machine.bodies]),
        np.array([body.axis for body in machine.bodies]),
        whole, centres, inertias,
    )  # fmt: skip


def _moments(radii: Vector, mass: float) -> np.ndarray:
    return mass * np.array(radii) ** 2


def servos_of(count: int) -> Servos:
    """Nominal servos of so many joints."""

    def each(value: float) -> np.ndarray:
        return np.full(count, value)

    return Servos(
        **{key: each(value) for key, value in SERVO.items()},
        stribeck=each(0.0), stribeck_velocity=each(0.15), load=each(0.0), play=each(0.0), loss=each(0.0),
        goal_offset=each(0.0), stop=each(np.inf), output_side=each(0.0), cable=each(0.0), trip=each(np.inf),
        volts=VOLTS, latency=LATENCY, source=0.0,
    )  # fmt: skip


def mjcf(machine: Machine) -> str:
    """The model file that the maker publishes: bodies and joints, without friction, armature or drives."""
    lines, ends = [], ""
    for body in machine.bodies:
        place, axis, centre = (" ".join(f"{x:g}" for x in value) for value in (body.place, body.axis, body.centre))
        moments = " ".join(f"{x:.9g}" for x in _moments(body.radii, body.mass))
        lines += [
            f'<body name="{body.joint}_link" pos="{place}">',
            f'<joint name="{body.joint}" type="hinge" axis="{axis}"/>',
            f'<inertial pos="{centre}" mass="{body.mass:.9g}" diaginertia="{moments}"/>',
        ]
        ends += "</body>"
    place, moment = " ".join(f"{x:g}" for x in machine.tip_place), machine.tip_mass * TIP_RADIUS**2
    lines += [
        f'<body name="{machine.tip}" pos="{place}"><inertial pos="0 0 0" mass="{machine.tip_mass:.9g}" '
        f'diaginertia="{moment:.9g} {moment:.9g} {moment:.9g}"/><site name="tip"/></body>'
    ]
    return '<mujoco><compiler angle="radian"/><worldbody>' + "".join(lines) + ends + "</worldbody></mujoco>"
