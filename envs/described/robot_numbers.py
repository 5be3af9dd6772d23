"""The numbers of a robot that a model file describes, and the specification with other values for them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from ...actuators import Drivetrain
from ..bench.stops import STOP_DAMPING
from ..engine.numbers import Effect, Number, RobotError
from ..engine.stops import set_stop
from .model_file import UNITS, ModelBody, ModelFile

FREE = 1e3  # [rad or m] a stop that nothing reaches: there is none
AXES = ("x", "y", "z")
CARRIER = 1e-10
"""Mass, as a share of its body's, of the point at which the weight of a body is compensated: too light to be felt."""


def model_numbers(model: ModelFile, joints: Sequence[str], timestep: float) -> dict[str, Number]:
    """Every number of a model that may differ on the machine.

    Args:
        model: as read.
        joints: of the model that have stops of their own among the numbers.
        timestep: of the simulation [s].
    """
    source = model.path.name
    numbers = {
        "timestep": Number(timestep, "s", "assumed: see the robot's file", 1e-5, 0.05, numerical=True),
        "tilt_x": Number(0.0, "rad", "assumed: the base stands level", -math.pi, math.pi, neutral=True),
        "tilt_y": Number(0.0, "rad", "assumed: the base stands level", -math.pi, math.pi, neutral=True),
    }
    for body in model.bodies.values():
        numbers[f"{body.name}_mass"] = Number(body.mass, "kg", source, 1e-9)
        for axis, value in zip(AXES, body.centre, strict=True):
            numbers[f"{body.name}_centre_{axis}"] = Number(value, "m", source, -math.inf)
        numbers[f"{body.name}_inertia_factor"] = Number(1.0, "-", source, 1e-3, 1e3, neutral=True)
        numbers[f"{body.name}_payload"] = Number(0.0, "kg", "assumed: it carries nothing", -math.inf, neutral=True)
    for frame in model.frames:
        numbers[f"{frame}_payload"] = Number(0.0, "kg", "assumed: it carries nothing", neutral=True)
    for name in joints:
        joint = model.joints[name]
        about = "kg.m2" if joint.kind == "hinge" else "kg"
        said = "assumed: no inertia but that of the bodies"
        share = "assumed: the file gives the inertia of its body about the centre of mass"
        numbers[f"{name}_about_joint"] = Number(0.0, "-", share, -1.0, 2.0, neutral=True)
        numbers[f"{name}_inertia"] = Number(0.0, about, said, -math.inf, neutral=True)
        said = "assumed: no rotor but that of the chain"
        numbers[f"{name}_rotor"] = Number(0.0, about, said, -math.inf, neutral=True)
        low, high = joint.range or (-FREE, FREE)
        unit, free = UNITS[joint.kind][0], joint.range is None
        said = "assumed: nothing stops the joint" if free else source
        numbers[f"{name}_lower_stop"] = Number(low, unit, said, -FREE, FREE, neutral=free)
        numbers[f"{name}_upper_stop"] = Number(high, unit, said, -FREE, FREE, neutral=free)
        if joint.kind == "hinge":
            said = "0: as hard as the file has it, or the engine"
            numbers[f"{name}_stop_stiffness"] = Number(0.0, "N.m/rad", said, neutral=True)
    return numbers


def model_effects(model: ModelFile, joints: Mapping[str, str]) -> dict[str, Effect]:
    """What findings about a joint (``<joint>.<path>``) or a body do to the numbers.

    Args:
        model: as read.
        joints: joints of the model by driven coordinate.
    """
    effects: dict[str, Effect] = {}
    for coordinate, joint in joints.items():
        effects[f"{coordinate}.load.stop_angle"] = Effect(f"{joint}_upper_stop", "set")
        effects[f"{coordinate}.load.lower_stop"] = Effect(f"{joint}_lower_stop", "set")
        if model.joints[joint].kind == "hinge":
            effects[f"{coordinate}.load.stop_stiffness"] = Effect(f"{joint}_stop_stiffness", "set")
        effects[f"{coordinate}.load.extra_inertia"] = Effect(f"{joint}_inertia", "plus")
        effects[f"{coordinate}.load.rotor_inertia"] = Effect(f"{joint}_rotor", "plus")
        effects[f"{coordinate}.load.about_joint"] = Effect(f"{joint}_about_joint", "plus")
    for body in model.bodies:
        effects[f"{body}.body.mass_factor"] = Effect(f"{body}_mass", "times")
        effects[f"{body}.body.inertia_factor"] = Effect(f"{body}_inertia_factor", "times")
        for axis in AXES:
            effects[f"{body}.body.centre_{axis}"] = Effect(f"{body}_centre_{axis}", "plus")
    for body in (*model.bodies, *model.frames):
        effects[f"{body}.body.payload"] = Effect(f"{body}_payload", "plus")
    for axis in AXES[:2]:
        effects[f"base.tilt_{axis}"] = Effect(f"tilt_{axis}", "plus")
    return effects


def apply_numbers(spec: mujoco.MjSpec, model: ModelFile, values: Mapping[str, float]) -> None:
    """Write the numbers into a specification of the model; what stays as it was read is not touched.

    What compensates the weight of a body (its ``gravcomp``) acts on as the file has it: a machine computes that of the
    robot as believed.

    Raises:
        RobotError: no body has such a mass or inertia, or what compensates weights cannot stay as it is.
    """
    spec.option.timestep = values["timestep"]
    if values["tilt_x"] or values["tilt_y"]:
        if compensated := [body.name or "without a name" for body in spec.bodies if body.gravcomp]:
            raise RobotError(
                f"{model.path.name}: the base cannot be tilted (tilt_x {values['tilt_x']:g}, tilt_y "
                f"{values['tilt_y']:g} rad), since MuJoCo would tilt the compensation of weights (gravcomp of bodies "
                f"{', '.join(compensated)}) with it; stand the base level, or leave gravcomp out of the file."
            )
        spec.option.gravity = _tilted(np.asarray(spec.option.gravity), values["tilt_x"], values["tilt_y"])
    less: dict[str, float] = {}  # [kg or kg.m2] inertia that joints have too much of, where no body can give it
    excess: dict[str, np.ndarray] = {}  # what bodies have too much of inertia about their joint's axis
    for name, joint in model.joints.items():
        more = values.get(f"{name}_inertia", 0.0)
        if more and joint.kind == "hinge" and joint.body in model.bodies:
            excess[joint.body] = excess.get(joint.body, np.zeros((3, 3))) - _turning(more, np.asarray(joint.axis))
        elif more < 0.0:
            less[name] = -more
        elif more:
            spec.joint(name).armature += more
        if rotor := values.get(f"{name}_rotor", 0.0):  # with that of the chain, it is no less than nothing
            spec.joint(name).armature += rotor
        if (share := values.get(f"{name}_about_joint", 0.0)) and joint.body in model.bodies:
            body = model.bodies[joint.body]
            too_much = share * body.mass * _about(np.asarray(body.centre) - np.asarray(joint.place))
            excess[joint.body] = excess.get(joint.body, np.zeros((3, 3))) + too_much
    for body in model.bodies.values():
        _weigh(spec, body, values, excess.get(body.name))
    for name, tip in model.frames.items():
        if payload := values[f"{name}_payload"]:
            frame = _explicit(spec, name)
            frame.mass, frame.ipos, frame.inertia, frame.gravcomp = payload, tip, np.zeros(3), 0.0
    _lighten(spec, less)
    for name, stops in _moved_stops(model, values).items():
        joint, item = model.joints[name], spec.joint(name)
        item.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        # a file that the main one attaches may count angles in another unit
        item.range = np.degrees(stops) if item.compiler.degree and joint.kind == "hinge" else stops


def _moved_stops(model: ModelFile, values: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Stops by joint [rad or m] that are elsewhere than the file has them."""
    found = {
        name: (values[f"{name}_lower_stop"], values[f"{name}_upper_stop"])
        for name in model.joints
        if f"{name}_lower_stop" in values
    }
    return {name: stops for name, stops in found.items() if stops != (model.joints[name].range or (-FREE, FREE))}


def harden_stops(model: ModelFile, drivetrain: Drivetrain, values: Mapping[str, float]) -> None:
    """Make the stops of hinges as hard as they were found [N.m/rad].

    The engine takes that per inertia, so chains must be in the model.
    """
    moved, compiled = _moved_stops(model, values), drivetrain.model
    for name, joint in model.joints.items():
        stiffness, ends = values.get(f"{name}_stop_stiffness", 0.0), moved.get(name, joint.range)
        if stiffness == 0.0 or ends is None:
            continue
        mobility = float(compiled.dof_invweight0[compiled.joint(name).dofadr[0]])
        if mobility > 0.0:
            set_stop(drivetrain, name, ends, 1.0 / mobility, (stiffness, STOP_DAMPING))


def _turning(inertia: float, axis: np.ndarray) -> np.ndarray:
    """More inertia of a body about an axis (3,), as a tensor (3, 3) [kg.m2]: that of a disc, which has the least about
    all others that a body can have. What is taken off (below 0) is taken off about the axis alone.
    """
    about = np.outer(axis, axis)
    return inertia * (about if inertia < 0.0 else 0.5 * (about + np.eye(3)))


def inertia_about(inertia: float, own: np.ndarray, axis: np.ndarray) -> float:
    """What more inertia of a body about an axis of its own (3,) has about another (3,) [kg.m2]."""
    return float(axis @ _turning(inertia, own) @ axis)


def _lighten(spec: mujoco.MjSpec, less: Mapping[str, float]) -> None:
    """Take inertia [kg or kg.m2] from joints, by a negative armature: gravity feels nothing of it.

    Raises:
        RobotError: nothing, or less, would be left at some joint.
    """
    if not less:
        return
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    masses = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, masses)
    for name, amount in less.items():
        dof = int(model.jnt_dofadr[model.joint(name).id])
        masses[dof, dof] -= amount
        if np.linalg.eigvalsh(masses)[0] <= 0.0:
            raise RobotError(
                f"joint '{name}' would have a negative inertia: what was found at it is more than the model file gives "
                "it; correct the masses there."
            )
        spec.joint(name).armature -= amount


def _tilted(gravity: np.ndarray, about_x: float, about_y: float) -> np.ndarray:
    """Gravity [m/s2] as a base feels it that is turned about its x axis, then about its y axis [rad]."""
    c, s = math.cos(about_x), math.sin(about_x)
    rolled = np.array([gravity[0], c * gravity[1] + s * gravity[2], -s * gravity[1] + c * gravity[2]])
    c, s = math.cos(about_y), math.sin(about_y)
    return np.array([c * rolled[0] - s * rolled[2], rolled[1], s * rolled[0] + c * rolled[2]])


def _weigh(spec: mujoco.MjSpec, body: ModelBody, values: Mapping[str, float], excess: np.ndarray | None = None) -> None:
    """Write mass, centre and inertia of a body, less an excess (3, 3) [kg.m2]."""
    mass = values[f"{body.name}_mass"]
    centre = tuple(values[f"{body.name}_centre_{axis}"] for axis in AXES)
    factor = values[f"{body.name}_inertia_factor"]
    payload = values[f"{body.name}_payload"]
    if mass == body.mass and centre == body.centre and factor == 1.0 and payload == 0.0 and excess is None:
        return
    if mass + payload <= 0.0:
        raise RobotError(f"body '{body.name}' of {mass:g} kg cannot carry {payload:g} kg: nothing would be left of it.")
    item = _explicit(spec, body.name)
    inertia = factor * mass / body.mass * np.asarray(body.inertia)
    if payload == 0.0 and excess is None and (centre == body.centre or not item.gravcomp):
        item.gravcomp *= body.mass / mass
        item.mass, item.ipos, item.iquat, item.inertia = mass, centre, body.axes, inertia
        return
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, np.asarray(body.axes))
    axes = turn.reshape(3, 3)
    own, tip = np.asarray(centre), np.asarray(body.tip)
    total = mass + payload
    middle = (mass * own + payload * tip) / total
    whole = axes @ np.diag(inertia) @ axes.T + mass * _about(own - middle) + payload * _about(tip - middle)
    whole = whole if excess is None else whole - excess
    if item.gravcomp:
        total, middle, whole = _kept_compensation(spec, body, total, middle, whole)
    principal, frame = np.linalg.eigh(whole)
    if principal[0] <= 0.0:
        raise RobotError(
            f"body '{body.name}' would have a negative inertia: what was found at its joint is more than the model "
            "file gives it; correct its inertia there."
        )
    principal[2] = min(principal[2], principal[0] + principal[1])  # no body has more, about whatever axis
    frame[:, 0] *= np.linalg.det(frame)  # a rotation, not a mirror
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, frame.ravel())
    item.mass, item.ipos, item.iquat, item.inertia = total, middle, quaternion, principal


def _explicit(spec: mujoco.MjSpec, name: str) -> mujoco.MjsBody:
    """A body whose mass and inertia are to be written; those of the others stay as the compiler takes them."""
    shapes = mujoco.mjtInertiaFromGeom
    # which overrides all that is written; a file that the main one attaches has a setting of its own
    forced = [body for body in spec.bodies[1:] if body.compiler.inertiafromgeom == shapes.mjINERTIAFROMGEOM_TRUE]
    if forced:
        plain = spec.copy()
        model = plain.compile()
        for body, compiled in zip(spec.bodies[1:], plain.bodies[1:], strict=True):
            if (mass := float(model.body_mass[compiled.id])) or body.explicitinertial:
                body.explicitinertial, body.fullinertia = True, [math.nan] * 6
                body.mass, body.inertia = mass, model.body_inertia[compiled.id]
                body.ipos, body.iquat = model.body_ipos[compiled.id], model.body_iquat[compiled.id]
        for body in forced:
            body.compiler.inertiafromgeom = shapes.mjINERTIAFROMGEOM_AUTO
    item = spec.body(name)
    item.explicitinertial, item.fullinertia = True, [math.nan] * 6
    return item


def _kept_compensation(
    spec: mujoco.MjSpec, body: ModelBody, mass: float, centre: np.ndarray, inertia: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Let the weight of a body be compensated as before, where its centre of mass was: at a point with next to no mass.

    Returns:
        Mass [kg], centre (3,) [m] and inertia about it (3, 3) [kg.m2] that are left for the body itself.
    """
    item, place = spec.body(body.name), np.asarray(body.centre)
    light = max(CARRIER * body.mass, spec.compiler.boundmass, item.compiler.boundmass)
    point = item.add_body(pos=place, mass=light, ipos=np.zeros(3), inertia=np.zeros(3), explicitinertial=True)
    point.gravcomp, item.gravcomp = item.gravcomp * body.mass / light, 0.0
    left = mass - light
    middle = (mass * centre - light * place) / left
    return left, middle, inertia - light * _about(place - centre) - left * _about(middle - centre)


def _about(away: np.ndarray) -> np.ndarray:
    """Inertia (3, 3) per kilogram of a point so far away (3,) [m]."""
    return float(away @ away) * np.eye(3) - np.outer(away, away)
