"""One leg with its foot in the air: what gravity asks of its joints (5.3), and how its joints are coupled (1)."""

from __future__ import annotations

import mujoco
import numpy as np

from ...envs.hexapod.kinematics import link_angles
from ...envs.hexapod.robot import KINDS, coordinate, loop_joints
from .paper import Machine

STEP = 1e-6  # [m] of a screw, by which the motion of the links is found
LEG = 0


def _along(machine: Machine) -> np.ndarray:
    """Speeds of all joints for a unit speed of each driven joint of the leg, the body held (nv, 3)."""
    at = {name: int(machine.model.joint(name).dofadr[0]) for name in loop_joints(LEG)}
    screws = np.array([machine.data.joint(coordinate(LEG, kind)).qpos[0] for kind in KINDS[1:]])
    along = np.zeros((machine.model.nv, len(KINDS)))
    for k, kind in enumerate(KINDS):
        along[int(machine.model.joint(coordinate(LEG, kind)).dofadr[0]), k] = 1.0
        if k:
            ends = [link_angles(machine.values, *(screws + sign * STEP * np.eye(2)[k - 1])) for sign in (-1.0, 1.0)]
            rise, bend = (float(after - before) / (2.0 * STEP) for before, after in zip(*ends, strict=True))
            along[[at[name] for name in loop_joints(LEG)], k] = rise, -bend, -bend
    return along


def _in_the_air() -> Machine:
    machine = Machine("none")
    machine.place(machine.stance())
    machine.data.qpos[2] += 1.0
    mujoco.mj_forward(machine.model, machine.data)
    return machine


def gravity() -> tuple[float, float, float]:
    """Force that gravity asks of each joint of a leg at its stance, in the order of the joints [N.m, N, N]."""
    machine = _in_the_air()
    rotation, vertical, horizontal = _along(machine).T @ machine.data.qfrc_bias
    return float(rotation), float(vertical), float(horizontal)


def coupling() -> tuple[float, float]:
    """Largest mutual inertia of two joints of a leg over the root of the product of their own ones.

    Returns:
        With the rotors behind their gears, and without.
    """
    machine, along = (found := _in_the_air()), _along(found)
    inertia = np.zeros((machine.model.nv, machine.model.nv))
    mujoco.mj_fullM(machine.model, machine.data, inertia)
    links = inertia - np.diag(machine.model.dof_armature)
    ratios = []
    for matrix in (along.T @ inertia @ along, along.T @ links @ along):
        scale = np.sqrt(np.diag(matrix))
        ratios.append(float(np.abs(np.triu(matrix / np.outer(scale, scale), 1)).max()))
    return ratios[0], ratios[1]
