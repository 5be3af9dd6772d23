"""Joints that equality constraints of a model tie to others: where they stand, and what moves with what."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np


@dataclass(frozen=True)
class Tie:
    """What an equality constraint makes of a joint.

    Attributes:
        follower: number of the joint.
        leader: number of the joint that it follows; -1: it stays in a place.
        homes: of the follower and of the leader, in the model's own pose [rad or m].
        way: coefficients (5,) of a polynomial of the leader's distance from its home: of the follower from its own.
    """

    follower: int
    leader: int
    homes: tuple[float, float]
    way: tuple[float, ...]

    def at(self, position: np.ndarray) -> np.ndarray:
        """Where the follower stands while the leader stands at ``position`` [rad or m]."""
        return self.homes[0] + np.polynomial.polynomial.polyval(position - self.homes[1], self.way)


def ties_of(model: mujoco.MjModel) -> tuple[Tie, ...]:
    """Ties of hinges and slides that act, each after that of its leader; those of a circle are left out."""
    left: list[Tie] = []
    for k in range(model.neq):
        if not model.eq_active0[k] or int(model.eq_type[k]) != int(mujoco.mjtEq.mjEQ_JOINT):
            continue
        one, two = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        homes = [0.0 if joint < 0 else float(model.qpos0[model.jnt_qposadr[joint]]) for joint in (one, two)]
        way = tuple(map(float, model.eq_data[k, : 5 if two >= 0 else 1]))
        if all(tie.follower != one for tie in left):
            left.append(Tie(one, two, (homes[0], homes[1]), way))
    found: list[Tie] = []
    while left:
        waiting = {tie.follower for tie in left}
        ready = [tie for tie in left if tie.leader not in waiting]
        if not ready:
            break
        found += ready
        left = [tie for tie in left if tie not in ready]
    return tuple(found)


def place_followers(model: mujoco.MjModel, ties: tuple[Tie, ...], qpos: np.ndarray) -> None:
    """Put joints that follow others in ``qpos`` (..., nq) where their ties hold them: else these would jerk at them."""
    for tie in ties:
        leader = qpos[..., model.jnt_qposadr[tie.leader]] if tie.leader >= 0 else np.zeros(qpos.shape[:-1])
        qpos[..., model.jnt_qposadr[tie.follower]] = tie.at(leader)


def carried_along(model: mujoco.MjModel) -> dict[str, tuple[tuple[str, float, float], ...]]:
    """By name of a joint that leads: joints that follow it in proportion, offset [rad or m] and ratio of each."""
    ways: dict[int, tuple[int, float, float]] = {}
    for tie in ties_of(model):
        if tie.leader < 0 or any(tie.way[2:]):
            continue
        first, offset, ratio = ways.get(tie.leader, (tie.leader, 0.0, 1.0))
        slope = tie.way[1]
        own = tie.homes[0] + tie.way[0] - slope * tie.homes[1]
        ways[tie.follower] = first, own + slope * offset, slope * ratio
    found: dict[str, tuple[tuple[str, float, float], ...]] = {}
    for number, (first, offset, ratio) in ways.items():
        leader, name = model.joint(first).name, model.joint(number).name
        if leader and name:
            found[leader] = (*found.get(leader, ()), (name, offset, ratio))
    return found


def free_ways(model: mujoco.MjModel) -> np.ndarray:
    """Speeds of all degrees of freedom by each of them (nv, nv): followers move with their leaders, and have none.

    As the ties are at the model's own pose.
    """
    ways, tied = np.eye(model.nv), np.zeros(model.nv, dtype=bool)
    for tie in ties_of(model):
        own = int(model.jnt_dofadr[tie.follower])
        ways[own] = tie.way[1] * ways[model.jnt_dofadr[tie.leader]] if tie.leader >= 0 else 0.0
        tied[own] = True
    ways[:, tied] = 0.0
    return ways
