"""Joints that an equality constraint of a robot's file ties to another one, such as the fingers of a gripper."""

from __future__ import annotations

import mujoco
import numpy as np

from ...envs.engine.model_ties import followers_of
from ..log.types import Array


def moved_by(model: mujoco.MjModel, joint: int) -> dict[int, float]:
    """How far joints go that move with one in proportion, per unit of its own way: itself first, by number."""
    found, followers = {joint: 1.0}, followers_of(model)
    for _ in followers:
        for number, follower in followers.items():
            if number not in found and follower.leader in found and follower.way.trim().degree() <= 1:
                found[number] = found[follower.leader] * float(follower.way.deriv()(0.0))
    return found


class Turned:
    """A joint with those that an equality moves with it: where they are as it goes further, and their torques on it."""

    def __init__(self, model: mujoco.MjModel, joint: int) -> None:
        moved = moved_by(model, joint)
        self.dofs = np.array([model.jnt_dofadr[number] for number in moved])
        self.address = np.array([model.jnt_qposadr[number] for number in moved])
        self.ratios = np.array(list(moved.values()))
        self.alone = len(moved) == 1
        self._dof, self._at = int(self.dofs[0]), int(self.address[0])

    def place(self, data: mujoco.MjData, row: Array, way: float) -> None:
        """Put them where a row of positions (nv,) has them, and ``way`` further [rad or m]."""
        if self.alone:  # a tenth of the time
            data.qpos[self._at] = row[self._dof] + way
        else:
            data.qpos[self.address] = row[self.dofs] + way * self.ratios

    def of(self, torques: Array) -> float:
        """What torques (nv,) come to at the joint."""
        return float(torques[self._dof]) if self.alone else float(self.ratios @ torques[self.dofs])

    def along(self, torques: Array) -> Array:
        """The same of torques along a log (n, nv), as (n,)."""
        return torques[:, self.dofs] @ self.ratios
