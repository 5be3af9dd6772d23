"""Where a robot touches the scene that its own file has, along its measured motion: replays of single joints have no
contacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from ..load.robot import LoggedRobot
from ..load.tree import carries
from ..log.types import MeasuredRun
from .tree import motion_of

EVERY = 0.05  # [s] between the poses that are looked at
NEAR = 1e-3  # [m] from which two surfaces count as touching: readings are no more exact
LEVEL = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))


@dataclass(frozen=True, eq=False)
class Touch:
    """What of a robot touches its scene in a run.

    Attributes:
        body: name of the body that does so most.
        joints: by name, the samples (n,) in which a body that the joint carries touches, 1 there.
    """

    body: str
    joints: dict[str, np.ndarray]


def touches_of(robot: LoggedRobot, run: MeasuredRun) -> Touch | None:
    """Where bodies of a robot touch what stands still in its file; None where none does.

    Args:
        robot: with a fixed base, all of whose joints have one coordinate.
        run: of it.
    """
    model = robot.model
    still = (model.geom_bodyid == 0) & ((model.geom_contype != 0) | (model.geom_conaffinity != 0))
    if not still.any() or not all(map(robot.turns, range(model.njnt))):
        return None
    model = model.__copy__()
    model.geom_margin[:] = np.maximum(model.geom_margin, NEAR)
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    data, position = mujoco.MjData(model), motion_of(robot, run).position
    at = np.arange(0, len(run.time), max(round(EVERY / run.period), 1))
    touching = np.zeros((len(at), model.nbody), bool)
    for k, sample in enumerate(at):
        data.qpos[model.jnt_qposadr] = position[sample, model.jnt_dofadr]
        mujoco.mj_fwdPosition(model, data)
        for contact in data.contact[: data.ncon]:
            if contact.dist < NEAR and (body := _body(model, *contact.geom)) > 0:
                touching[k, body] = True
    if not touching.any():
        return None
    joints = {}
    for name in run.joints:
        if (number := robot.number(name)) >= 0:
            mine = touching[:, [carries(model, number, body) for body in range(model.nbody)]].any(axis=1)
            mine = np.convolve(mine, np.ones(3), "same") > 0.0  # what lies between two poses, and just beside them
            joints[name] = np.interp(np.arange(len(run.time)), at, mine) > 0.0
    most = int(np.argmax(touching.sum(axis=0)))
    return Touch(model.body(most).name or f"body {most}", {name: mine.astype(float) for name, mine in joints.items()})


def _body(model: mujoco.MjModel, one: int, other: int) -> int:
    """The moving body of a contact with what stands still; 0 of any other contact, and of a base with the link on it,
    whose shapes often overlap.
    """
    first, second = (int(model.geom_bodyid[geom]) for geom in (one, other))
    if min(first, second) > 0 or max(first, second) == 0:
        return 0
    body, ground = max(first, second), one if first == 0 else other
    if not model.body_weldid[body]:
        return 0
    stands_on = int(model.geom_type[ground]) in LEVEL
    return body if stands_on or int(model.body_weldid[model.body_parentid[body]]) else 0


def untouched(runs: Sequence[MeasuredRun], joint: str) -> list[MeasuredRun]:
    """The runs without the marks of a joint, whose link is moved as measured whatever holds it."""
    return [
        replace(run, joints={**run.joints, joint: replace(run.joints[joint], touched=None)})
        if joint in run.joints
        else run
        for run in runs
    ]
