"""The numbers of a robot that a model file describes, and the specification with other values for them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from .model_file import UNITS, ModelBody, ModelFile
from .robot import Effect, Number

FREE = 1e3  # [rad or m] a stop that nothing reaches: there is none
AXES = ("x", "y", "z")


def model_numbers(model: ModelFile, joints: Sequence[str], timestep: float) -> dict[str, Number]:
    """Every number of a model that may differ on the machine.

    Args:
        model: as read.
        joints: of the model that have stops of their own among the numbers.
        timestep: of the simulation [s].
    """
    source = model.path.name
    numbers = {
        "timestep": Number(timestep, "s", "assumed: see the robot's file", 1e-5, 0.05),
        "tilt_x": Number(0.0, "rad", "assumed: the base stands level", -math.pi, math.pi, neutral=True),
        "tilt_y": Number(0.0, "rad", "assumed: the base stands level", -math.pi, math.pi, neutral=True),
    }
    for body in model.bodies.values():
        numbers[f"{body.name}_mass"] = Number(body.mass, "kg", source, 1e-9)
        for axis, value in zip(AXES, body.centre, strict=True):
            numbers[f"{body.name}_centre_{axis}"] = Number(value, "m", source, -math.inf)
        numbers[f"{body.name}_inertia_factor"] = Number(1.0, "-", source, 1e-3, 1e3, neutral=True)
    for name in joints:
        joint = model.joints[name]
        low, high = joint.range or (-FREE, FREE)
        unit, free = UNITS[joint.kind][0], joint.range is None
        said = "assumed: nothing stops the joint" if free else source
        numbers[f"{name}_lower_stop"] = Number(low, unit, said, -FREE, FREE, neutral=free)
        numbers[f"{name}_upper_stop"] = Number(high, unit, said, -FREE, FREE, neutral=free)
    return numbers


def model_effects(model: ModelFile, joints: Mapping[str, str]) -> dict[str, Effect]:
    """What findings about a joint (``<joint>.<path>``) or a body do to the numbers.

    Args:
        model: as read.
        joints: joints of the model by driven coordinate.
    """
    effects: dict[str, Effect] = {}
    for coordinate, joint in joints.items():
        effects[f"{coordinate}.load.stop_angle"] = Effect(f"{joint}_upper_stop", "most")
        effects[f"{coordinate}.load.lower_stop"] = Effect(f"{joint}_lower_stop", "least")
    for body in model.bodies:
        effects[f"{body}.body.mass_factor"] = Effect(f"{body}_mass", "times")
        effects[f"{body}.body.inertia_factor"] = Effect(f"{body}_inertia_factor", "times")
        for axis in AXES:
            effects[f"{body}.body.centre_{axis}"] = Effect(f"{body}_centre_{axis}", "plus")
    for axis in AXES[:2]:
        effects[f"base.tilt_{axis}"] = Effect(f"tilt_{axis}", "plus")
    return effects


def apply_numbers(spec: mujoco.MjSpec, model: ModelFile, values: Mapping[str, float]) -> None:
    """Write the numbers into a specification of the model; what stays as it was read is not touched."""
    spec.option.timestep = values["timestep"]
    if values["tilt_x"] or values["tilt_y"]:
        spec.option.gravity = _tilted(np.asarray(spec.option.gravity), values["tilt_x"], values["tilt_y"])
    for body in model.bodies.values():
        _weigh(spec, body, values)
    for name, joint in model.joints.items():
        if f"{name}_lower_stop" not in values:
            continue
        stops = values[f"{name}_lower_stop"], values[f"{name}_upper_stop"]
        if stops == (joint.range or (-FREE, FREE)):
            continue
        item = spec.joint(name)
        item.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        item.range = np.degrees(stops) if spec.compiler.degree and joint.kind == "hinge" else stops


def _tilted(gravity: np.ndarray, about_x: float, about_y: float) -> np.ndarray:
    """Gravity [m/s2] as a base feels it that is turned about its x axis, then about its y axis [rad]."""
    c, s = math.cos(about_x), math.sin(about_x)
    rolled = np.array([gravity[0], c * gravity[1] + s * gravity[2], -s * gravity[1] + c * gravity[2]])
    c, s = math.cos(about_y), math.sin(about_y)
    return np.array([c * rolled[0] - s * rolled[2], rolled[1], s * rolled[0] + c * rolled[2]])


def _weigh(spec: mujoco.MjSpec, body: ModelBody, values: Mapping[str, float]) -> None:
    mass = values[f"{body.name}_mass"]
    centre = tuple(values[f"{body.name}_centre_{axis}"] for axis in AXES)
    factor = values[f"{body.name}_inertia_factor"]
    if mass == body.mass and centre == body.centre and factor == 1.0:
        return
    item = spec.body(body.name)
    item.explicitinertial, item.fullinertia = True, [math.nan] * 6
    item.mass, item.ipos, item.iquat = mass, centre, body.axes
    item.inertia = factor * mass / body.mass * np.asarray(body.inertia)
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
