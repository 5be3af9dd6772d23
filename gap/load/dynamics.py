"""Mass matrix and bias torques of a robot along a motion: many samples at once, on the threads of MuJoCo's batch."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np
from mujoco import batch
from numba import get_num_threads
from numpy.typing import NDArray

from ..log.types import Array
from .robot import SINGLE_COORDINATE_KINDS

MAX_BATCH_SAMPLES = 4096  # samples at once, which bounds the memory
REGULARISING_INERTIA = 1.0
"""[kg.m2] of each joint, taken off again: a robot without masses would have a singular matrix."""
UNNEEDED_FORCES = (
    mujoco.mjtDisableBit.mjDSBL_CONTACT,
    mujoco.mjtDisableBit.mjDSBL_CONSTRAINT,
    mujoco.mjtDisableBit.mjDSBL_ACTUATION,
    mujoco.mjtDisableBit.mjDSBL_SENSOR,
)
Numbers = NDArray[np.integer]


def single_joints(model: mujoco.MjModel) -> tuple[Numbers, Numbers]:
    """Degrees of freedom of hinges and slides, and their coordinates; free and ball joints stay where they are."""
    found = [j for j in range(model.njnt) if int(model.jnt_type[j]) in SINGLE_COORDINATE_KINDS]
    return model.jnt_dofadr[found], model.jnt_qposadr[found]


class Dynamics:
    """What accelerations, speeds and gravity ask of some joints that move together.

    Armature is no body's, and is left out. MuJoCo takes the mass matrix of a body that stands alone on the world, such
    as a carriage, from its compiled model, and as diagonal: both are wrong once a number is changed. What such joints
    need is computed sample by sample.

    Args:
        model: of a robot of hinges and slides.
        dofs: degrees of freedom that move together.
        ratios: by how much each moves (len(dofs),), 1 of the one whose torque is asked for.
        samples: at most, at once.
    """

    def __init__(self, model: mujoco.MjModel, dofs: Numbers, ratios: Array, samples: int) -> None:
        bodies = model.__copy__()
        bodies.opt.disableflags |= sum(int(flag) for flag in UNNEEDED_FORCES)
        bodies.dof_armature[:] = REGULARISING_INERTIA
        bodies.tendon_armature[:] = 0.0
        self.size = min(samples, MAX_BATCH_SAMPLES)
        self.dofs, self.ratios = dofs, ratios
        self.all_dofs, self.address = single_joints(model)
        self._model = bodies
        self._alone = bool(np.any(model.body_simple[model.dof_bodyid[dofs]]))
        self._batch = batch.Batch(bodies, nsim=self.size, nthread=get_num_threads())
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._bias, self._mass = self._batch.bind("qfrc_bias"), self._batch.bind("M")
        self._entries = list(_entries(model, dict(zip(dofs.tolist(), ratios.tolist(), strict=True))))

    def at(self, position: Array, speed: Array) -> tuple[Array, Array]:
        """Row of the mass matrix (n, nv) [kg.m2] and bias torque (n,) [N.m] of the joints, at positions and speeds
        (n, nv) of the robot; n is at most ``size``.
        """
        bias = self.bias(position, speed)
        n = len(position)
        if self._alone:
            return self._rows(n), bias
        row = np.zeros(speed.shape)
        row[:, self.dofs] = -REGULARISING_INERTIA * self.ratios
        for entry, column, ratio in self._entries:
            row[:, column] += ratio * self._mass[:n, entry]
        return row, bias

    def bias(self, position: Array, speed: Array) -> Array:
        """The bias torque of :meth:`at` alone (n,) [N.m]."""
        n = len(position)
        self._qpos[:n, self.address] = position[:, self.all_dofs]
        self._qvel[:n] = speed
        self._batch.forward(np.arange(n), stage=mujoco.mjtStage.mjSTAGE_VEL)
        return self._bias[:n][:, self.dofs] @ self.ratios

    def _rows(self, samples: int) -> Array:
        """Row of the mass matrix (samples, nv) where the batch stands, by the Newton-Euler algorithm."""
        model, data = self._model, mujoco.MjData(self._model)
        rows, needed = np.empty((samples, model.nv)), np.zeros(model.nv)
        for k in range(samples):
            data.qpos[:], data.qvel[:] = self._qpos[k], 0.0
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            mujoco.mj_rne(model, data, 0, needed)
            still = needed[self.dofs] @ self.ratios
            for dof in range(model.nv):
                data.qacc[:] = 0.0
                data.qacc[dof] = 1.0
                mujoco.mj_rne(model, data, 1, needed)
                rows[k, dof] = needed[self.dofs] @ self.ratios - still
        return rows


def _entries(model: mujoco.MjModel, ratios: dict[int, float]) -> Iterator[tuple[int, int, float]]:
    """Entries of MuJoCo's sparse lower triangle that joints with these ratios (by degree of freedom) need: where each
    stands, the column that it adds to, and its factor.
    """
    for row in range(model.nv):
        for entry in range(model.M_rowadr[row], model.M_rowadr[row] + model.M_rownnz[row]):
            column = int(model.M_colind[entry])
            if row in ratios:
                yield entry, column, ratios[row]
            if column in ratios and column != row:
                yield entry, row, ratios[column]
