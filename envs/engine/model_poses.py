"""Where the joints of a model stand in a keyframe of its file, by what they are called: chains move their addresses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.polynomial import Polynomial

from ...actuators import Drivetrain

Label = tuple[str, str]
"""A joint by its own name, or one without a name by that of its body: ``("elbow", "")``, ``("", "trunk")``."""
Pose = Mapping[Label, tuple[float, ...]]
"""Positions of joints [rad or m]: one of a hinge or slide, a quaternion of a ball, place and quaternion of a free
one."""
SIZES = {int(mujoco.mjtJoint.mjJNT_FREE): 7, int(mujoco.mjtJoint.mjJNT_BALL): 4}
"""Positions that a joint has, where that is not one."""


def keyframes(full: mujoco.MjSpec, model: mujoco.MjModel) -> list[mujoco.MjsKey]:
    """Keyframes of a file that hold a position for each joint: a file can hold others, for more than the robot."""
    return [key for key in full.keys if len(key.qpos) == model.nq]


def home_pose(full: mujoco.MjSpec, model: mujoco.MjModel) -> np.ndarray:
    """Positions (nq,) in the keyframe ``home``, or in the first one; without one, in the pose of the file."""
    keys = keyframes(full, model)
    pose = next((key.qpos for key in keys if key.name == "home"), keys[0].qpos if keys else model.qpos0)
    return np.array(pose, dtype=float)


def standing(model: mujoco.MjModel, qpos: np.ndarray) -> Pose:
    """The joints that stand elsewhere in ``qpos`` (nq,) than in the model's own pose, quaternions made units."""
    found = {}
    for label, number in numbers(model).items():
        at = _place(model, number)
        values = np.array(qpos[at], dtype=float)
        if len(values) > 1:
            length = float(np.linalg.norm(values[-4:]))
            values[-4:] = values[-4:] / length if length > 0.0 else model.qpos0[at][-4:]
        if not np.allclose(values, model.qpos0[at], rtol=0.0, atol=1e-12):
            found[label] = tuple(float(value) for value in values)
    return found


def stand(model: mujoco.MjModel, pose: Pose, qpos: np.ndarray) -> None:
    """Put joints in ``qpos`` (..., nq) to where they stand in a pose; those that the model lacks are passed over."""
    if not pose:
        return
    for label, number in numbers(model).items():
        at = _place(model, number)
        if len(values := pose.get(label, ())) == at.stop - at.start:
            qpos[..., at] = values


def weight_of(model: mujoco.MjModel) -> float:
    """Weight of all its bodies [N]."""
    return float(mujoco.mj_getTotalmass(model)) * float(np.linalg.norm(model.opt.gravity))


def numbers(model: mujoco.MjModel) -> dict[Label, int]:
    """Joints of a model; those that cannot be told apart are left out."""
    found: dict[Label, int] = {}
    twice = {("", "")}
    for number in range(model.njnt):
        name = model.joint(number).name
        label = (name, "") if name else ("", model.body(int(model.jnt_bodyid[number])).name)
        twice |= {label} & found.keys()
        found[label] = number
    return {label: number for label, number in found.items() if label not in twice}


def _place(model: mujoco.MjModel, number: int) -> slice:
    """Addresses of the positions of a joint."""
    first = int(model.jnt_qposadr[number])
    return slice(first, first + SIZES.get(int(model.jnt_type[number]), 1))


# --- joints that equality constraints of a model tie to others: where they stand, and what moves with what -----------


@dataclass(frozen=True)
class Follower:
    """A joint that an equality constraint of the model moves.

    Attributes:
        leader: number of the joint that it follows; -1: it stays in a place.
        way: its position as a polynomial of the leader's.
    """

    leader: int
    way: Polynomial


def followers_of(model: mujoco.MjModel) -> dict[int, Follower]:
    """Hinges and slides that follow others by constraints that act, by number of the joint."""
    found = {}
    for k in range(model.neq):
        if int(model.eq_type[k]) != int(mujoco.mjtEq.mjEQ_JOINT) or not model.eq_active0[k]:
            continue
        one, two = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        way = Polynomial(model.eq_data[k, :5] if two >= 0 else model.eq_data[k, :1])
        if two >= 0:
            way = way(Polynomial([-home_of(model, two), 1.0]))
        found[one] = Follower(two, way + home_of(model, one))
    return found


def home_of(model: mujoco.MjModel, joint: int) -> float:
    """Where a joint is in the model's own pose [rad or m]."""
    return float(model.qpos0[model.jnt_qposadr[joint]])


def in_turn(model: mujoco.MjModel) -> dict[int, Follower]:
    """As :func:`followers_of`, each after its leader; those of a circle are left out."""
    left, found = followers_of(model), dict[int, Follower]()
    while ready := {number: follower for number, follower in left.items() if follower.leader not in left}:
        found |= ready
        left = {number: follower for number, follower in left.items() if number not in ready}
    return found


def place_followers(model: mujoco.MjModel, followers: dict[int, Follower], qpos: np.ndarray) -> None:
    """Put joints that follow others in ``qpos`` (..., nq) where their ties hold them: else these would jerk at them.

    Args:
        model: of the robot.
        followers: of it, by :func:`in_turn`.
        qpos: positions, changed in place.
    """
    for number, follower in followers.items():
        leader = qpos[..., model.jnt_qposadr[follower.leader]] if follower.leader >= 0 else np.zeros(qpos.shape[:-1])
        qpos[..., model.jnt_qposadr[number]] = follower.way(leader)


def carried_along(model: mujoco.MjModel) -> dict[str, tuple[tuple[str, float, float], ...]]:
    """By name of a joint that leads: joints that follow it in proportion, offset [rad or m] and ratio of each."""
    ways: dict[int, tuple[int, Polynomial]] = {}
    found: dict[str, tuple[tuple[str, float, float], ...]] = {}
    for number, follower in in_turn(model).items():
        if follower.leader < 0 or follower.way.trim().degree() > 1:
            continue
        first, way = ways.get(follower.leader, (follower.leader, Polynomial([0.0, 1.0])))
        ways[number] = first, follower.way(way)
        offset, ratio = float(ways[number][1](0.0)), float(ways[number][1].deriv()(0.0))
        leader, name = model.joint(first).name, model.joint(number).name
        if leader and name:
            found[leader] = (*found.get(leader, ()), (name, offset, ratio))
    return found


def free_ways(model: mujoco.MjModel) -> np.ndarray:
    """Speeds of all degrees of freedom by each of them (nv, nv): followers move with their leaders, and have none.

    As the ties are at the model's own pose.
    """
    ways, tied = np.eye(model.nv), np.zeros(model.nv, dtype=bool)
    for number, follower in in_turn(model).items():
        own, leader = int(model.jnt_dofadr[number]), follower.leader
        slope = 0.0 if leader < 0 else float(follower.way.deriv()(home_of(model, leader)))
        ways[own] = slope * ways[model.jnt_dofadr[leader]]
        tied[own] = True
    ways[:, tied] = 0.0
    return ways


# --- closed loops of a model: where its joints stand so that welds, connects and ties hold before the first step -----
#
# A file may describe a robot with its loops open, and an episode may begin anywhere. The engine closes a loop by
# force, within a few milliseconds: what is open by millimetres then throws light rods about.

STEPS = 30  # of the search, at most
CLOSED = 1e-7  # [m or rad] of an equality's residual below which nothing is open
NEAR = 1e-4  # [m or rad] of it, that counts as closed where the search ends; assumed
DRIVEN = 30.0  # times as hard to move as a joint that nothing drives; assumed
BASE = 1e6  # the same of a free base: it stays
DAMPING = 1e-4  # of the largest singular value: ways in which loops are stretched out


class Loops:
    """The loops of a model, ready to be closed."""

    @classmethod
    def of(cls, drivetrain: Drivetrain) -> Loops | None:
        """The loops of a robot with its chains; None: it has none."""
        model = drivetrain.model
        if not np.isin(model.eq_type[model.eq_active0.astype(bool)], LOOPING).any():
            return None
        terms = [drivetrain.terms(item.name, side) for item in drivetrain.coordinates for side in ("motor", "link")]
        return cls(model, np.array([model.joint(joint).dofadr[0] for each in terms for joint, _ in each]))

    def __init__(self, model: mujoco.MjModel, driven: np.ndarray) -> None:
        """Prepare.

        Args:
            model: of the robot.
            driven: numbers of the degrees of freedom that actuators drive.
        """
        self._model, self._data = model, mujoco.MjData(model)
        weight = np.ones(model.nv)
        weight[driven] = DRIVEN
        for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
            at = int(model.jnt_dofadr[joint])
            weight[at : at + 6] = BASE
        self._ease = 1.0 / weight

    def open(self, qpos: np.ndarray) -> float:
        """How far equalities are from holding at ``qpos`` (nq,) [m or rad]."""
        self._data.qpos[:] = qpos
        return float(np.abs(self._residual()[0]).max(initial=0.0))

    def close_each(self, qpos: np.ndarray) -> None:
        """Close the loops of many simulations (n, nq), in place."""
        for row in qpos:
            self.close(row)

    def close(self, qpos: np.ndarray) -> float:
        """Move joints in ``qpos`` (nq,), in place, so that all equalities hold, as little as can be.

        Joints that nothing drives move first. Where stops or the geometry keep a loop open, it is left as near as it
        comes.

        Returns:
            What is still open [m or rad].
        """
        model, data = self._model, self._data
        data.qpos[:] = best = qpos.copy()
        least, ease = np.inf, self._ease.copy()
        for _ in range(STEPS):
            error, rows = self._residual()
            size = float(np.abs(error).max(initial=0.0))
            if size < least:
                least, best = size, data.qpos.copy()
            if size < CLOSED:
                break
            slope = _dense(model, data)[rows] * np.sqrt(ease)
            left, values, right = np.linalg.svd(slope, full_matrices=False)
            inverse = values / (values**2 + (DAMPING * values.max(initial=1e-12)) ** 2)
            change = -np.sqrt(ease) * (right.T @ (inverse * (left.T @ error)))
            mujoco.mj_integratePos(model, data.qpos, change, 1.0)
            self._within(data.qpos)
        qpos[:] = best
        return least

    def _residual(self) -> tuple[np.ndarray, np.ndarray]:
        """Errors of the equalities (e,) [m or rad], and which rows of the constraints (nefc,) these are."""
        data = self._data
        mujoco.mj_fwdPosition(self._model, data)
        rows = data.efc_type[: data.nefc] == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        return data.efc_pos[: data.nefc][rows].copy(), rows

    def _within(self, qpos: np.ndarray) -> None:
        """Hold hinges and slides within their stops."""
        model = self._model
        single = (model.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE)) & model.jnt_limited.astype(bool)
        at = model.jnt_qposadr[single]
        qpos[at] = np.clip(qpos[at], *model.jnt_range[single].T)


LOOPING = (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD))
"""Kinds of equalities that close loops; ties of joints are placed by :func:`place_followers`."""


def _dense(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Jacobian of all constraints (nefc, nv)."""
    if not mujoco.mj_isSparse(model):
        return np.array(data.efc_J).reshape(-1, model.nv)[: data.nefc]
    dense = np.zeros((data.nefc, model.nv))
    mujoco.mju_sparse2dense(dense, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
    return dense
