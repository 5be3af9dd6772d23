"""The leg on a stand: three joints in a row, the first upright, built from the numbers of paper 000."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from ...actuators import Chain, DrivenCoordinate, load_chain_set
from ...common.errors import SealegsError
from ..engine.robot import Robot
from ..engine.scene import CAMERA, FLOOR, add_scene, add_sun
from .inertia import Body, realizable, rotors
from .parameters import LIMITS, LINKS, NUMBERS

JOINTS = tuple(LIMITS)
FOOT = "foot"
TIMESTEP = 0.001  # [s] two in a period of the digital controllers
REACH = 0.6  # [m] rough size, for light and shadows
WORDS = {
    "silo4": "silo4",
    "silo4_pd": "silo4_pd",
    "ideal": "silo4_ideal",
    "regression": "silo4_regression",
    "net": "silo4_net",
}

_DARK, _METAL, _BLUE, _RUBBER = (
    (0.16, 0.18, 0.22, 1),
    (0.76, 0.78, 0.81, 1),
    (0.20, 0.42, 0.68, 1),
    (0.13, 0.13, 0.14, 1),
)
_ORANGE = (0.85, 0.52, 0.22, 1)
_CAPSULE, _CYLINDER = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER
_BOX, _SPHERE = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_SPHERE
_UPRIGHT = (float(np.sqrt(0.5)), float(np.sqrt(0.5)), 0.0, 0.0)  # x stays, y up: the frame behind table VI's first row


def build(values: Mapping[str, float]) -> mujoco.MjSpec:
    """The leg on its stand; ``qpos`` holds the joint angles of table VI."""
    spec = mujoco.MjSpec()
    spec.modelname = "leg"
    spec.compiler.degree = False
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    add_scene(spec, tile=0.1, reach=REACH)
    height = values["base_height"]
    stand = spec.worldbody.add_body(name="stand", pos=(0.0, 0.0, height))
    add_sun(stand, REACH)
    stand.add_geom(type=_BOX, size=(0.05, 0.09, 0.008), pos=(-0.06, 0.0, 0.15), rgba=_DARK)
    stand.add_geom(
        type=_BOX, size=(0.012, 0.012, 0.5 * (height + 0.15)), pos=(-0.1, 0.0, 0.5 * (0.15 - height)), rgba=_DARK
    )
    mount_leg(stand, values, "", (0.0, 0.0, 0.0), 0.0)
    for geom in spec.geoms:  # on the stand, the foot swings free
        geom.contype, geom.conaffinity, geom.mass = 0, 0, 0.0
    spec.worldbody.add_camera(
        name=CAMERA,
        pos=(0.15, -1.25, height + 0.12),
        xyaxes=(1.0, 0.0, 0.0, 0.0, 0.17, 1.0),
        fovy=40.0,
    )
    return spec


def mount_leg(
    parent: mujoco.MjsBody, values: Mapping[str, float], prefix: str, place: tuple[float, float, float], heading: float
) -> None:
    """Hang a leg on a body.

    Args:
        parent: that carries its first joint.
        values: numbers of the leg.
        prefix: of the names of its joints, bodies and foot.
        place: of the first joint [m].
        heading: direction in which the leg points at zero angles, about the vertical [rad].
    """
    bodies, left_over = realizable(values)
    armature = rotors(values) + left_over
    turn = np.array([np.cos(0.5 * heading), 0.0, 0.0, np.sin(0.5 * heading)])
    quat = np.zeros(4)
    mujoco.mju_mulQuat(quat, turn, np.array(_UPRIGHT))
    at: tuple[float, float, float] = place
    body = parent
    for link, joint in zip(LINKS, JOINTS, strict=True):
        body = body.add_body(name=f"{prefix}link_{link}", pos=at)
        if link == 1:
            body.quat = tuple(quat)
        axis = (0.0, 1.0, 0.0) if link == 1 else (0.0, 0.0, 1.0)
        body.add_joint(
            name=prefix + joint, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis, armature=float(armature[link - 1])
        )
        _set_inertia(body, bodies[link])
        at = (values[f"link{link}_length"], 0.0, 0.0)
        _draw(body, link, at[0])
    body.add_geom(name=prefix + FOOT, type=_SPHERE, pos=at, size=(values["foot_radius"], 0.0, 0.0), rgba=_RUBBER)


def _set_inertia(body: mujoco.MjsBody, link: Body) -> None:
    tensor = link.tensor()
    body.mass, body.ipos, body.explicitinertial = link.mass, tuple(link.centre), True
    body.fullinertia = (*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2])


def _draw(body: mujoco.MjsBody, link: int, length: float) -> None:
    end = (length, 0.0, 0.0)
    if link == 1:  # motor of the first joint over the joint, that of the second in front of it
        body.add_geom(type=_CYLINDER, fromto=(0.0, -0.02, 0.0, 0.0, 0.14, 0.0), size=(0.021, 0.0, 0.0), rgba=_DARK)
        body.add_geom(type=_CAPSULE, fromto=(0.0, 0.0, 0.0, *end), size=(0.016, 0.0, 0.0), rgba=_METAL)
        return
    body.add_geom(type=_CYLINDER, fromto=(0.0, 0.0, -0.026, 0.0, 0.0, 0.026), size=(0.022, 0.0, 0.0), rgba=_DARK)
    if link == 2:
        body.add_geom(type=_CAPSULE, fromto=(0.0, 0.0, 0.0, *end), size=(0.017, 0.0, 0.0), rgba=_METAL)
        body.add_geom(type=_CYLINDER, fromto=(0.06, 0.022, 0.0, 0.18, 0.022, 0.0), size=(0.015, 0.0, 0.0), rgba=_ORANGE)
        return
    body.add_geom(type=_CAPSULE, fromto=(0.0, 0.0, 0.0, *end), size=(0.010, 0.0, 0.0), rgba=_BLUE)


def goal_limits(values: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Lowest and highest goal of each joint [rad]."""
    del values
    return dict(LIMITS)


def chains_of(file: str) -> dict[str, Chain]:
    """The chains of a file of ``configs/actuator`` by joint.

    Raises:
        SealegsError: the file lacks one.
    """
    found = load_chain_set(file) or {}
    if set(found) != {f"*{joint}" for joint in JOINTS}:
        raise SealegsError(f"the actuator '{file}' needs the keys {', '.join(f'*{joint}' for joint in JOINTS)}.")
    return {joint: found[f"*{joint}"] for joint in JOINTS}


LEG = Robot(
    name="leg",
    numbers=NUMBERS,
    coordinates=tuple(DrivenCoordinate.of_joint(joint) for joint in JOINTS),
    goal_limits=goal_limits,
    chains=dict.fromkeys(JOINTS, "silo4"),
    build=build,
    words={word: chains_of(file) for word, file in WORDS.items()},
)

__all__ = ["FLOOR", "FOOT", "JOINTS", "LEG", "build", "chains_of", "goal_limits", "mount_leg"]
