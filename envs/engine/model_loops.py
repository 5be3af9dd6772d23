"""Closed loops of a model: where its joints stand so that welds, connects and ties hold before the first step.

A file may describe a robot with its loops open, and an episode may begin anywhere. The engine closes a loop by force,
within a few milliseconds: what is open by millimetres then throws light rods about.
"""

from __future__ import annotations

import mujoco
import numpy as np

from ...actuators import Drivetrain

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
"""Kinds of equalities that close loops; ties of joints are placed by :mod:`sealegs.envs.engine.model_ties`."""


def _dense(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Jacobian of all constraints (nefc, nv)."""
    if not mujoco.mj_isSparse(model):
        return np.array(data.efc_J).reshape(-1, model.nv)[: data.nefc]
    dense = np.zeros((data.nefc, model.nv))
    mujoco.mju_sparse2dense(dense, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
    return dense
