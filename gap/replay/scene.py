"""Where a robot touches the scene that its own file has, or comes to the end of a tendon, along its measured motion:
replays of single joints have neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from ...envs.described.model_couplings import wrapped
from ..load.robot import LoggedRobot
from ..load.tree import carries
from ..log.types import MeasuredRun
from .tree import motion_of

EVERY = 0.05  # [s] between the poses that are looked at
NEAR = 1e-3  # [m] from which two surfaces count as touching: readings are no more exact
TAUT = 0.01  # of its range from where a tendon counts as at the end of it
LEVEL = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))


@dataclass(frozen=True, eq=False)
class Touch:
    """What of a robot touches its scene in a run.

    Attributes:
        part: body that does so most, or tendon that is at its end most, by name.
        joints: by name, the samples (n,) in which a body that the joint carries touches, or a tendon over it ends, 1
            there.
    """

    part: str
    joints: dict[str, np.ndarray]


def touches_of(robot: LoggedRobot, run: MeasuredRun) -> Touch | None:
    """Where bodies of a robot touch what stands still in its file, or tendons end; None where nothing does.

    Args:
        robot: with a fixed base, all of whose joints have one coordinate.
        run: of it.
    """
    model = robot.model
    still = (model.geom_bodyid == 0) & ((model.geom_contype != 0) | (model.geom_conaffinity != 0))
    ending = np.flatnonzero(model.tendon_limited)
    if not (still.any() or ending.size) or not all(map(robot.turns, range(model.njnt))):
        return None
    model = model.__copy__()
    model.geom_margin[:] = np.maximum(model.geom_margin, NEAR)
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    data, position = mujoco.MjData(model), motion_of(robot, run).position
    at = np.arange(0, len(run.time), max(round(EVERY / run.period), 1))
    touching = np.zeros((len(at), model.nbody), bool)
    taut = np.zeros((len(at), len(ending)), bool)
    low, high = model.tendon_range[ending].T
    for k, sample in enumerate(at):
        data.qpos[model.jnt_qposadr] = position[sample, model.jnt_dofadr]
        mujoco.mj_fwdPosition(model, data)
        for contact in data.contact[: data.ncon]:
            if contact.dist < NEAR and (body := _body(model, *contact.geom)) > 0:
                touching[k, body] = True
        taut[k] = abs(data.ten_length[ending] - 0.5 * (low + high)) > (0.5 - TAUT) * (high - low)
    if not (touching.any() or taut.any()):
        return None
    joints = {}
    for name in run.joints:
        if (number := robot.number(name)) >= 0:
            bodies = touching[:, [carries(model, number, body) for body in range(model.nbody)]]
            over = taut[:, [number in wrapped(model, tendon) for tendon in map(int, ending)]]
            mine = bodies.any(axis=1) | over.any(axis=1)
            mine = np.convolve(mine, np.ones(3), "same") > 0.0  # what lies between two poses, and just beside them
            joints[name] = np.interp(np.arange(len(run.time)), at, mine) > 0.0
    return Touch(_most(model, touching, taut, ending), {name: mine.astype(float) for name, mine in joints.items()})


def _most(model: mujoco.MjModel, touching: np.ndarray, taut: np.ndarray, ending: np.ndarray) -> str:
    """The body or tendon that does so in most poses."""
    bodies = touching.sum(axis=0)
    tendons = np.append(taut.sum(axis=0), 0)
    if tendons.max() > bodies.max():
        tendon = int(ending[np.argmax(tendons)])
        return model.tendon(tendon).name or f"tendon {tendon}"
    body = int(np.argmax(bodies))
    return model.body(body).name or f"body {body}"


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
