"""A motor's turning parts as a full body of the model, with all six inertias, where a robot's numbers have them."""

from __future__ import annotations

import mujoco
import numpy as np

from ..common.errors import SealegsError, nearest

COPIED = ("mass", "ipos", "iquat", "inertia", "fullinertia", "explicitinertial")
DRAWN = ("type", "size", "pos", "quat", "fromto", "rgba", "group", "contype", "conaffinity", "mass")
TOUCHED = ("friction", "condim", "priority", "solmix", "solref", "solimp", "margin", "gap")


def rotor_body(spec: mujoco.MjSpec, name: str, joint: str) -> mujoco.MjsBody:
    """The body of that name, which must be a jointless child of the joint's body, in its frame.

    Raises:
        SealegsError: there is no such body, or it is somewhere else.
    """
    body = spec.body(name)
    if body is None:
        names = [other.name for other in spec.bodies]
        raise SealegsError(f"the model has no body '{name}'{nearest(name, names)} to be a rotor.")
    placed = np.any(np.asarray(body.pos) != 0.0) or np.any(np.asarray(body.quat) != (1.0, 0.0, 0.0, 0.0))
    if body.parent.name != spec.joint(joint).parent.name or list(body.joints) or placed:
        raise SealegsError(
            f"the rotor '{name}' must be a child of the body of joint '{joint}', in its frame and unmoved."
        )
    return body


def inertia_about(body: mujoco.MjsBody, axis: np.ndarray) -> float:
    """Inertia of a body about an axis through its origin [kg.m2]."""
    along = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    full = np.asarray(body.fullinertia, dtype=float)
    if np.isfinite(full).all():
        xx, yy, zz, xy, xz, yz = full
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    else:
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, np.asarray(body.iquat, dtype=float))
        matrix = turn.reshape(3, 3)
        tensor = matrix @ np.diag(np.asarray(body.inertia, dtype=float)) @ matrix.T
    aside = np.cross(along, np.asarray(body.ipos, dtype=float))
    return float(along @ tensor @ along + body.mass * (aside @ aside))


def release(spec: mujoco.MjSpec, rotor: mujoco.MjsBody, carrier: mujoco.MjsBody) -> mujoco.MjsBody:
    """Take a rotor out of its link and put it, without a joint yet, on the body that carries the motor.

    Raises:
        SealegsError: ``carrier`` is not the parent of the rotor's link.
    """
    link, name = rotor.parent, rotor.name
    if link.parent.name != carrier.name:
        raise SealegsError(f"the rotor '{name}' needs its motor on '{link.parent.name}', which carries its link.")
    values = {field: np.copy(getattr(rotor, field)) for field in COPIED}
    shapes = [{field: np.copy(getattr(geom, field)) for field in (*DRAWN, *TOUCHED)} for geom in rotor.geoms]
    spec.delete(rotor)
    moved = carrier.add_body(name=name, pos=link.pos, quat=link.quat)
    for field, value in values.items():
        setattr(moved, field, value if value.ndim else value.item())
    for shape in shapes:
        geom = moved.add_geom()
        for field, value in shape.items():
            setattr(geom, field, value if value.ndim else value.item())
    return moved
