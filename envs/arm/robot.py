"""The arm: three links on revolute joints, and a rotor of its own in each joint."""

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco
import numpy as np

from ...actuators import DrivenCoordinate
from ..engine.robot import Robot
from ..engine.scene import CAMERA, add_scene, add_sun
from .parameters import NUMBERS, body_of
from .tables import JOINTS

STAND, TIP = "stand", "tool"
LINKS, ROTORS = ("link1", "link2", "link3"), ("rotor1", "rotor2", "rotor3")
TIMESTEP = 0.001  # [s]; convergence in docs/results/arm.md
REACH = 0.9  # [m] rough size, for light and shadows
AXES = ((0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0))  # of the joints at zero angles, from table I
GOAL_RANGE = ((-math.pi, math.pi), (-0.5, 1.5), (-0.5, 2.5))  # [rad] assumed: beyond every place of the trajectory
WORDS = ("ideal", "regression", "net")

_DARK, _METAL, _CLEAR = (0.16, 0.18, 0.22, 1), (0.76, 0.78, 0.81, 1), (0.62, 0.74, 0.84, 1)
_ORANGE, _BLUE, _GREEN = (0.85, 0.45, 0.20, 1), (0.20, 0.42, 0.68, 1), (0.36, 0.62, 0.42, 1)
_CAPSULE, _CYLINDER = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER
_BOX, _SPHERE = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_SPHERE


def build(values: Mapping[str, float]) -> mujoco.MjSpec:
    """The arm. ``qpos`` starts with the three joint angles of table I; axes of all bodies are the ground's at zero.

    Each rotor is a jointless part of the link that it drives, until a chain with a spring makes it turn on its own.
    """
    spec = mujoco.MjSpec()
    spec.modelname = "arm"
    spec.compiler.degree = False
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE  # takes springs on rotors of 1e-8 kg.m2 implicitly
    spec.option.gravity = (0.0, 0.0, -values["gravity"])
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    add_scene(spec, tile=0.1, reach=REACH)
    stand = spec.worldbody.add_body(name=STAND)
    add_sun(stand, REACH)
    height = values["height"]
    origins = ((0.0, 0.0, 0.0), (0.0, 0.0, height), (values["upper_length"], 0.0, height))
    parent, before = stand, (0.0, 0.0, 0.0)
    links = []
    for k, joint in enumerate(JOINTS):
        origin = origins[k]
        link = parent.add_body(name=LINKS[k], pos=tuple(a - b for a, b in zip(origin, before, strict=True)))
        link.add_joint(name=joint, type=mujoco.mjtJoint.mjJNT_HINGE, axis=AXES[k])
        _set_inertia(link, values, LINKS[k], origin)
        _set_inertia(link.add_body(name=ROTORS[k]), values, ROTORS[k], origin)
        links.append(link)
        parent, before = link, origin
    tip = (values["fore_length"], 0.0, 0.0)
    links[2].add_site(name=TIP, pos=tip, size=(0.008, 0.0, 0.0), rgba=(0.9, 0.2, 0.15, 1))
    if values["payload_mass"] > 0.0:
        load = links[2].add_body(name="payload", pos=tip, mass=values["payload_mass"], ipos=(0.0, 0.0, 0.0))
        load.inertia, load.explicitinertial = (1e-4 * values["payload_mass"],) * 3, True
    _draw(stand, links, values)
    for geom in spec.geoms:
        geom.mass, geom.contype, geom.conaffinity = 0.0, 0, 0
    spec.worldbody.add_camera(name=CAMERA, pos=(0.35, -1.9, 1.25), xyaxes=(1.0, 0.16, 0.0, -0.05, 0.4, 1.0), fovy=36.0)
    return spec


def _set_inertia(body: mujoco.MjsBody, values: Mapping[str, float], name: str, origin: tuple[float, ...]) -> None:
    """Mass, centre and inertia of tables VIII and IX, in a body whose frame is at ``origin`` [m]."""
    row = body_of(values, name)
    tensor = row.tensor(values["products"])
    body.mass, body.explicitinertial = row.mass, True
    body.ipos = tuple(np.subtract(row.centre, origin))
    body.fullinertia = (*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2])


def _draw(stand: mujoco.MjsBody, links: list[mujoco.MjsBody], values: Mapping[str, float]) -> None:
    height, upper, fore = values["height"], values["upper_length"], values["fore_length"]
    stand.add_geom(type=_CYLINDER, pos=(0.0, 0.0, 0.012), size=(0.11, 0.012, 0.0), rgba=_DARK)
    stand.add_geom(type=_CYLINDER, pos=(0.0, 0.0, 0.06), size=(0.05, 0.04, 0.0), rgba=_GREEN)
    first, second, third = links
    first.add_geom(type=_BOX, pos=(0.0, 0.0, 0.5 * height), size=(0.028, 0.045, 0.5 * height - 0.1), rgba=_CLEAR)
    for side in (-1.0, 1.0):
        first.add_geom(type=_BOX, pos=(0.0, 0.055 * side, height - 0.03), size=(0.03, 0.006, 0.08), rgba=_CLEAR)
    first.add_geom(type=_CYLINDER, fromto=(0.0, -0.15, height, 0.0, -0.06, height), size=(0.028, 0.0, 0.0), rgba=_GREEN)
    second.add_geom(type=_CYLINDER, fromto=(0.0, -0.06, 0.0, 0.0, 0.06, 0.0), size=(0.035, 0.0, 0.0), rgba=_DARK)
    for side in (-1.0, 1.0):
        bar = (-0.1, 0.03 * side, 0.0, upper, 0.03 * side, 0.0)
        second.add_geom(type=_CAPSULE, fromto=bar, size=(0.009, 0.0, 0.0), rgba=_BLUE)
        weight = (-0.13, 0.04 * side, 0.0, -0.07, 0.04 * side, 0.0)  # the two counterbalances of section 3
        second.add_geom(type=_CYLINDER, fromto=weight, size=(0.035, 0.0, 0.0), rgba=_METAL)
    second.add_geom(type=_CYLINDER, fromto=(upper, 0.0, -0.03, upper, 0.0, 0.06), size=(0.026, 0.0, 0.0), rgba=_GREEN)
    third.add_geom(type=_CYLINDER, fromto=(0.0, 0.0, -0.02, 0.0, 0.0, 0.02), size=(0.03, 0.0, 0.0), rgba=_DARK)
    third.add_geom(type=_CAPSULE, fromto=(0.0, 0.0, 0.0, fore, 0.0, 0.0), size=(0.011, 0.0, 0.0), rgba=_ORANGE)
    third.add_geom(type=_SPHERE, pos=(fore, 0.0, 0.0), size=(0.014, 0.0, 0.0), rgba=_DARK)


def goal_limits(values: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Goals of the joints [rad]."""
    del values
    return dict(zip(JOINTS, GOAL_RANGE, strict=True))


def _words() -> dict[str, dict[str, str]]:
    """Chains by word; ``srlfj`` is what the robot has anyway."""
    words = {word: {name: f"srlfj_{word}{k}" for k, name in enumerate(JOINTS, 1)} for word in WORDS}
    return words | {"srlfj": {name: f"srlfj_{name}" for name in JOINTS}}


ARM = Robot(
    name="arm",
    numbers=NUMBERS,
    coordinates=tuple(
        DrivenCoordinate(name, ((name, 1.0),), motor_body=(STAND, *LINKS)[k], rotor=ROTORS[k])
        for k, name in enumerate(JOINTS)
    ),
    goal_limits=goal_limits,
    chains=_words()["srlfj"],
    build=build,
    words=_words(),
)
