"""Which joints of a model are wheels: they turn without end, and are told a speed."""

from __future__ import annotations

import re

import mujoco
import numpy as np

from .model_drives import ModelDrive

WHEEL = re.compile(r"wheel|tire|tyre|track|sprocket|roller|propeller|rotor|spinner", re.IGNORECASE)
"""What names of such joints and of their bodies have in them."""
ROUND = (int(mujoco.mjtGeom.mjGEOM_CYLINDER), int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_ELLIPSOID))
ASIDE = 0.05  # of its radius, or of 1 rad: by which a round shape may be off the joint's axis; assumed


def wheels_of(model: mujoco.MjModel, drives: tuple[ModelDrive, ...]) -> dict[str, float]:
    """Hinges without a range that are wheels, and the radius of their shape [m]; 0 where it has none that is round.

    They are what an actuator of the file drives by a speed, what is called a wheel, and the last joint of a limb whose
    shape that touches is round about its axis. Other hinges without a range, such as the wrist of an arm, follow
    positions.
    """
    by_speed = {drive.name for drive in drives if drive.stiffness == 0.0 < drive.damping}
    by_position = {drive.name for drive in drives if drive.stiffness > 0.0}
    found = {}
    for number in range(model.njnt):
        name, body = model.joint(number).name, int(model.jnt_bodyid[number])
        hinge = int(model.jnt_type[number]) == int(mujoco.mjtJoint.mjJNT_HINGE)
        if not hinge or not name or model.jnt_limited[number] or name in by_position:
            continue
        radius = _radius(model, number, body)
        called = WHEEL.search(f"{name} {model.body(body).name}") is not None
        if name in by_speed or called or (radius > 0.0 and not _carries(model, body)):
            found[name] = radius
    return found


def _carries(model: mujoco.MjModel, body: int) -> bool:
    """Whether further joints hang on a body."""
    for other in range(body + 1, model.nbody):
        if model.body_jntnum[other]:
            parent = other
            while parent > body:
                parent = int(model.body_parentid[parent])
            if parent == body:
                return True
    return False


def _radius(model: mujoco.MjModel, joint: int, body: int) -> float:
    """Largest radius of the shapes round about a joint's axis that touch, on what moves as one with its body [m]."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    axis, anchor = data.xaxis[joint], data.xanchor[joint]
    radius = 0.0
    for geom in np.flatnonzero(model.body_weldid[model.geom_bodyid] == model.body_weldid[body]):
        kind, touches = int(model.geom_type[geom]), model.geom_contype[geom] or model.geom_conaffinity[geom]
        if kind not in ROUND or not touches:
            continue
        size, away = model.geom_size[geom], data.geom_xpos[geom] - anchor
        own = float(size[0])
        along = data.geom_xmat[geom].reshape(3, 3)[:, 2]
        level = kind == ROUND[1] or np.linalg.norm(np.cross(along, axis)) < ASIDE
        if level and np.linalg.norm(away - (away @ axis) * axis) < ASIDE * own:
            radius = max(radius, own)
    return radius
