"""Joints that equality constraints of a model tie to others: where they stand, and what moves with what."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.polynomial import Polynomial


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
