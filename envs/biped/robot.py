"""The biped: a torso on a boom, two legs of thigh and shin, driven by leg angle and leg shape."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco

from ...actuators import DrivenCoordinate
from ...actuators.gravity import GRAVITY
from ..engine.robot import Robot
from ..engine.scene import CAMERA, FLOOR, add_scene, add_sun
from .drive import ANGLE, SHAPE
from .parameters import NUMBERS, SIDES

BOOM, TORSO = "boom", "torso"
REACH = 1.5  # [m] rough size, for light and shadows
AXIS = (0.0, -1.0, 0.0)  # counter-clockwise for a viewer who has x to the right (Fig. 2)
SOFT = 1e-3  # [N/m]
WIDTH = 0.09  # [m] of each leg from the middle, only seen
GOAL_RANGE = {ANGLE: (-0.6, 0.6), SHAPE: (0.0, 0.6)}  # [rad] assumed: the work space that hopping and walking need
KNEE_RANGE = (-2.4, -0.02)  # [rad] assumed: the knee's stops

_DARK, _METAL = (0.16, 0.18, 0.22, 1), (0.76, 0.78, 0.81, 1)
_COLOURS = {"left": (0.20, 0.42, 0.68, 1), "right": (0.85, 0.45, 0.20, 1)}
_RUBBER = (0.13, 0.13, 0.14, 1)
_CAPSULE, _CYLINDER = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER


def hip(side: str) -> str:
    """Joint between torso and thigh; zero where the thigh hangs down an upright torso."""
    return f"{side}_hip"


def knee(side: str) -> str:
    """Joint between thigh and shin; zero where the leg is straight, negative where it bends."""
    return f"{side}_knee"


def foot(side: str) -> str:
    """Geom at the end of the leg."""
    return f"{side}_foot"


def coordinate(side: str, kind: str) -> str:
    """Name of a driven coordinate."""
    return f"{side}_{kind}"


def build(values: Mapping[str, float]) -> mujoco.MjSpec:
    """The biped. ``qpos`` starts with forward position and height of the hip, and the pitch of the torso.

    The boom is its effect on the hip: an inertial mass of I/L2 and a weight of m g r/L. The carriers of the
    differentials turn about the hip: their mass rides there, the shin carrier's inertia turns with the shin, the spring
    carrier's with twice the leg shape. Rotors and pulleys are the armatures of the chains.
    """
    spec = mujoco.MjSpec()
    spec.modelname = "biped"
    spec.compiler.degree = False
    spec.option.timestep = values["timestep"]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
    floor = add_scene(spec, friction=values["floor_friction"], tile=0.25, reach=REACH)
    floor.priority = 1  # its friction and its softness count, whatever meets it
    floor.solref = (values["contact_time"], values["contact_damping"])
    floor.solimp = (values["contact_low"], values["contact_high"], values["contact_width"], 0.5, 2.0)
    height = values["thigh_length"] + values["shin_length"]  # at zero angles the legs are straight
    boom = spec.worldbody.add_body(name=BOOM, pos=(0.0, 0.0, height))
    slide = mujoco.mjtJoint.mjJNT_SLIDE
    boom.add_joint(name="hip_x", type=slide, axis=(1.0, 0.0, 0.0))
    upward = boom.add_joint(name="hip_z", type=slide, axis=(0.0, 0.0, 1.0), ref=height)
    felt = values["boom_inertia"] / values["boom_length"] ** 2
    weight = values["boom_mass"] * values["boom_centre"] / values["boom_length"]
    boom.mass, boom.ipos, boom.explicitinertial = felt, (0.0, 0.0, 0.0), True
    boom.inertia = (1e-3,) * 3  # without effect: the boom's end does not pitch
    heavier = GRAVITY * (weight - felt)  # a spring so long that it pulls with one force
    upward.stiffness, upward.springref = [SOFT, 0.0, 0.0], height - heavier / SOFT
    add_sun(boom, REACH)
    boom.add_geom(type=_CAPSULE, fromto=(0.0, 0.12, 0.0, 0.0, 1.2, 0.0), size=(0.02, 0.0, 0.0), rgba=_METAL)
    torso = boom.add_body(name=TORSO)
    torso.add_joint(name="torso_pitch", type=mujoco.mjtJoint.mjJNT_HINGE, axis=AXIS)
    carriers = 2.0 * (values["spring_carrier_mass"] + values["shin_carrier_mass"])
    mass = values["torso_mass"] + carriers
    share = values["torso_mass"] / mass
    about_hip = values["torso_inertia"] + 2.0 * values["spring_carrier_inertia"]
    _set_inertia(torso, mass, (share * values["torso_forward"], share * values["torso_centre"]), about_hip)
    _draw_torso(torso)
    for side, offset in zip(SIDES, (WIDTH, -WIDTH), strict=True):
        _leg(torso, side, offset, values)
    for geom in spec.geoms:  # feet meet the floor, nothing else meets anything
        if geom.name != FLOOR:
            geom.mass, geom.contype = 0.0, 0
            if not geom.name.endswith("_foot"):
                geom.conaffinity = 0
    spec.worldbody.add_camera(
        name=CAMERA,
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACK,
        pos=(0.0, -4.2, height + 0.1),
        xyaxes=(1.0, 0.0, 0.0, 0.0, 0.1, 1.0),
        fovy=30.0,
    )
    return spec


def _set_inertia(body: mujoco.MjsBody, mass: float, centre: tuple[float, float], about_joint: float) -> None:
    """Mass, centre of mass (forward, up) [m], and inertia about the joint [kg.m2] of a body in the plane."""
    across = about_joint - mass * (centre[0] ** 2 + centre[1] ** 2)
    body.mass, body.ipos, body.explicitinertial = mass, (centre[0], 0.0, centre[1]), True
    body.inertia = (across, across, 0.1 * across)


def _leg(torso: mujoco.MjsBody, side: str, offset: float, values: Mapping[str, float]) -> None:
    hinge, colour = mujoco.mjtJoint.mjJNT_HINGE, _COLOURS[side]
    thigh = torso.add_body(name=f"{side}_thigh", pos=(0.0, offset, 0.0))
    thigh.add_joint(name=hip(side), type=hinge, axis=AXIS)
    centre = (values["thigh_forward"], -values["thigh_centre"])
    _set_inertia(thigh, values["thigh_mass"], centre, values["thigh_inertia"])
    shin = thigh.add_body(name=f"{side}_shin", pos=(0.0, 0.0, -values["thigh_length"]))
    bend = shin.add_joint(name=knee(side), type=hinge, axis=AXIS, limited=mujoco.mjtLimited.mjLIMITED_TRUE)
    bend.range, bend.armature = KNEE_RANGE, values["spring_carrier_inertia"]
    centre = (values["shin_forward"], -values["shin_centre"])
    _set_inertia(shin, values["shin_mass"], centre, values["shin_inertia"] + values["shin_carrier_inertia"])
    radius, length = values["foot_radius"], values["shin_length"]
    for body, end, size in ((thigh, values["thigh_length"], 0.035), (shin, length - radius, 0.022)):
        body.add_geom(type=_CAPSULE, fromto=(0.0, 0.0, 0.0, 0.0, 0.0, -end), size=(size, 0.0, 0.0), rgba=colour)
        pin = (0.0, -0.035, 0.0, 0.0, 0.035, 0.0)
        body.add_geom(type=_CYLINDER, fromto=pin, size=(1.3 * size, 0.0, 0.0), rgba=_DARK)
    shin.add_geom(
        name=foot(side),
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        pos=(0.0, 0.0, radius - length),
        size=(radius, 0.0, 0.0),
        rgba=_RUBBER,
    )


def _draw_torso(torso: mujoco.MjsBody) -> None:
    box = mujoco.mjtGeom.mjGEOM_BOX
    torso.add_geom(type=box, size=(0.09, 0.05, 0.22), pos=(0.0, 0.0, 0.24), rgba=_METAL)
    torso.add_geom(type=box, size=(0.11, 0.055, 0.05), pos=(0.0, 0.0, 0.38), rgba=_DARK)
    torso.add_geom(type=_CYLINDER, fromto=(0.0, -0.05, 0.0, 0.0, 0.05, 0.0), size=(0.07, 0.0, 0.0), rgba=_DARK)


def goal_limits(values: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Goals of leg angle and leg shape [rad], alike on both sides."""
    del values
    return {coordinate(side, kind): GOAL_RANGE[kind] for side in SIDES for kind in (ANGLE, SHAPE)}


def _coordinates() -> tuple[DrivenCoordinate, ...]:
    rows = []
    for side in SIDES:
        # the leg angle is the mean of thigh and shin, the leg shape half their difference: paper 003, (1)
        angle, shape = ((knee(side), 0.5), (hip(side), 1.0)), ((knee(side), -0.5),)
        rows.append(DrivenCoordinate(coordinate(side, ANGLE), angle, motor_body=TORSO))
        rows.append(DrivenCoordinate(coordinate(side, SHAPE), shape, motor_body=TORSO))
    return tuple(rows)


def _words() -> dict[str, dict[str, str]]:
    """Chains by word; ``mabel`` is what the robot has anyway."""
    names = {item.name: item.name.partition("_")[2] for item in _coordinates()}
    kinds = ("ideal", "regression", "net")
    words = {word: {name: f"mabel_{word}_{kind}" for name, kind in names.items()} for word in kinds}
    return words | {"mabel": {name: f"mabel_{name}" for name in names}}


BIPED = Robot(
    name="biped",
    numbers=NUMBERS,
    coordinates=_coordinates(),
    goal_limits=goal_limits,
    chains=_words()["mabel"],
    build=build,
    words=_words(),
)
