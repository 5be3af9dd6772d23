"""The series elastic hopper: a base that translates in the plane, two links, both motors in the base."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from ...actuators import DrivenCoordinate
from ..engine.numbers import Effect
from ..engine.robot import Robot
from ..engine.scene import CAMERA, FLOOR, add_scene, add_sun
from .parameters import GOAL_RANGE, NUMBERS

BASE, UPPER, LOWER, FOOT = "base", "upper", "lower", "foot"
HIP, KNEE = "hip", "knee"
TIMESTEP = 0.001  # [s], as in the paper (IV-D); convergence in benchmarks/results/hopper_open_parameters.md
REACH = 0.35  # [m] rough size, for light and shadows
AXIS = (0.0, -1.0, 0.0)  # counter-clockwise for a viewer who has x to the right (Fig. 5)

_DARK, _METAL, _GREEN, _BEIGE = (
    (0.16, 0.18, 0.22, 1),
    (0.76, 0.78, 0.81, 1),
    (0.36, 0.62, 0.42, 1),
    (0.87, 0.76, 0.58, 1),
)
_RUBBER, _BLUE = (0.13, 0.13, 0.14, 1), (0.20, 0.42, 0.68, 1)
_CAPSULE, _CYLINDER = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER


def leg_length(values: Mapping[str, float], hip: np.ndarray | float, knee: np.ndarray | float) -> np.ndarray:
    """Vertical distance from the hip to the sole [m] at angles of both links against the vertical [rad]."""
    return values["upper_length"] * np.cos(hip) + values["lower_length"] * np.cos(knee) + values["foot_radius"]


def build(values: Mapping[str, float]) -> mujoco.MjSpec:
    """The hopper. ``qpos`` starts with x and the height of the hip; at zero angles the links hang down straight.

    The rotors' mass is part of the base, which they ride in and turn against without moving their centres; their
    inertia is the armature of the chain. So the total is the printed one with every chain.
    """
    spec = mujoco.MjSpec()
    spec.modelname = "hopper"
    spec.compiler.degree = False
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # one plane and eight parts: testing all pairs takes 3 % less of a step than looking for those that are near
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
    floor = add_scene(spec, friction=values["floor_friction"], tile=0.1, reach=REACH)
    floor.priority = 1  # its friction and its softness count, whatever meets it
    floor.solref = (values["contact_time"], 1.0)
    height = float(leg_length(values, values["hip_rest"], values["knee_rest"]))
    base = spec.worldbody.add_body(name=BASE, pos=(0.0, 0.0, height))
    base_mass = values["total_mass"] - values["upper_mass"] - values["lower_mass"]
    slide = mujoco.mjtJoint.mjJNT_SLIDE
    base.add_joint(name="base_x", type=slide, axis=(1.0, 0.0, 0.0))
    base.add_joint(name="base_z", type=slide, axis=(0.0, 0.0, 1.0), ref=height)
    base.mass, base.ipos, base.explicitinertial = base_mass, (0.0, 0.0, 0.0), True  # without ipos, XML lacks all three
    base.inertia = (base_mass * 1e-3,) * 3  # without effect: the base does not rotate
    add_sun(base, REACH)
    _draw_base(base)
    upper = _link(
        base,
        UPPER,
        HIP,
        offset=0.0,
        mass=values["upper_mass"],
        length=values["upper_length"],
        centre=values["upper_centre"],
        colour=_METAL,
    )
    lower = _link(
        upper,
        LOWER,
        KNEE,
        offset=values["upper_length"],
        mass=values["lower_mass"],
        length=values["lower_length"],
        centre=values["lower_centre"],
        colour=_BLUE,
    )
    lower.add_geom(
        name=FOOT,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        pos=(0.0, 0.0, -values["lower_length"]),
        size=(values["foot_radius"], 0.0, 0.0),
        rgba=_RUBBER,
    )
    for geom in spec.geoms:  # the parts meet the floor, not each other
        if geom.name != FLOOR:
            geom.contype, geom.mass = 0, 0.0
    spec.worldbody.add_camera(
        name=CAMERA,
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACK,
        pos=(0.0, -0.9, height + 0.04),
        xyaxes=(1.0, 0.0, 0.0, 0.0, 0.2, 1.0),
        fovy=30.0,
    )
    return spec


def _link(
    parent: mujoco.MjsBody,
    name: str,
    joint: str,
    offset: float,
    mass: float,
    length: float,
    centre: float,
    colour: tuple,
) -> mujoco.MjsBody:
    """A rod that hangs from ``offset`` below its parent's origin; its centre of mass is at ``centre`` x length."""
    across, along = mass * length**2 / 12.0, mass * 1e-5
    body = parent.add_body(
        name=name,
        pos=(0.0, 0.0, -offset),
        mass=mass,
        ipos=(0.0, 0.0, -centre * length),
        inertia=(across, across, along),
        explicitinertial=True,
    )
    body.add_joint(name=joint, type=mujoco.mjtJoint.mjJNT_HINGE, axis=AXIS)
    body.add_geom(type=_CAPSULE, fromto=(0.0, 0.0, 0.0, 0.0, 0.0, -length), size=(0.006, 0.0, 0.0), rgba=colour)
    pin = (0.0, -0.011, 0.0, 0.0, 0.011, 0.0)
    body.add_geom(type=_CYLINDER, fromto=pin, size=(0.0085, 0.0, 0.0), rgba=_DARK, conaffinity=0)
    return body


def _draw_base(base: mujoco.MjsBody) -> None:
    base.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=(0.042, 0.022, 0.017), pos=(0.0, 0.0, 0.022), rgba=_DARK)
    for x, z, colour in ((0.0, 0.0, _GREEN), (0.026, 0.022, _BEIGE)):  # hip and knee motor, coloured as in Fig. 5
        ends = (x, -0.030, z, x, 0.030, z)
        base.add_geom(type=_CYLINDER, fromto=ends, size=(0.0115, 0.0, 0.0), rgba=colour, conaffinity=0)


def goal_limits(values: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Goals reach equally far to both sides of the rest angles [rad]."""
    rest = {HIP: values["hip_rest"], KNEE: values["knee_rest"]}
    return {name: (angle - GOAL_RANGE, angle + GOAL_RANGE) for name, angle in rest.items()}


HOPPER = Robot(
    name="hopper",
    numbers=NUMBERS,
    coordinates=(
        DrivenCoordinate(HIP, ((HIP, 1.0),), motor_body=BASE),
        DrivenCoordinate(
            KNEE, ((HIP, 1.0), (KNEE, 1.0)), motor_body=BASE
        ),  # by a belt, so measured against the vertical
    ),
    goal_limits=goal_limits,
    chains={HIP: "sv1270tg", KNEE: "sv1270tg"},
    build=build,
    effects={  # ground that slopes or gives way has no number: the floor is level and as hard as its contact
        "contact.friction": Effect("floor_friction", "set"),
        "contact.time": Effect("contact_time", "set"),
    },
)
