"""Where a free base is whose place nobody measured: turned as its IMU says, and on its floor with its nearest foot.

Where it is on a level floor, and where it heads, changes nothing. That foot stands still, and the base moves over it.
"""

from __future__ import annotations

import mujoco
import numpy as np

from ..envs.engine.model_poses import Pose, stand
from ..gap.ground.tree_model import PLANE, touching

FARTHEST = 10.0  # [m] that a floor is sought


class FreeBase:
    """The free base of a compiled robot.

    Attributes:
        home: positions where nothing is measured (nq,).
    """

    def __init__(self, model: mujoco.MjModel, place: tuple[int, int], pose: Pose) -> None:
        """Prepare.

        Args:
            model: robot and chains.
            place: where the joint begins in positions and in speeds.
            pose: where episodes start joints that nothing drives.
        """
        self._model, self._data = model, mujoco.MjData(model)
        self._qpos, self._dof = place
        self.home = np.array(model.qpos0)
        stand(model, pose, self.home)
        floors = [k for k in range(model.ngeom) if int(model.geom_type[k]) == PLANE]
        self._pairs = [(floor, geom) for floor in floors[:1] for geom in touching(model, floor)]

    def put(self, qpos: np.ndarray, turn: np.ndarray | None) -> None:
        """Put the base of ``qpos`` (nq,) onto its floor, turned by ``turn`` (4,); None: it stays turned as it is."""
        if turn is not None:
            qpos[self._qpos + 3 : self._qpos + 7] = turn
        if (nearest := self._nearest(qpos)) is not None:
            qpos[self._qpos + 2] -= nearest[0]

    def move(self, qpos: np.ndarray, qvel: np.ndarray, turn_rate: np.ndarray | None) -> None:
        """Write how the base moves into ``qvel`` (nv,), which holds the speeds of the joints.

        Args:
            qpos: from :meth:`put` (nq,).
            qvel: to complete.
            turn_rate: about its axes (3,) [rad/s]; None: it keeps that of ``qvel``.
        """
        dof = self._dof
        qvel[dof : dof + 3] = 0.0
        if turn_rate is not None:
            qvel[dof + 3 : dof + 6] = turn_rate
        if (nearest := self._nearest(qpos)) is None:
            return
        _, geom, point = nearest
        jacobian = np.zeros((3, self._model.nv))
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_jac(self._model, self._data, jacobian, None, point, int(self._model.geom_bodyid[geom]))
        qvel[dof : dof + 3] = -(jacobian @ qvel)

    def _nearest(self, qpos: np.ndarray) -> tuple[float, int, np.ndarray] | None:
        """What is nearest to the floor: how far [m], the geom, and its point (3,) [m]; None: nothing can touch it."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        ends, found = np.zeros(6), None
        for floor, geom in self._pairs:
            distance = mujoco.mj_geomDistance(self._model, self._data, floor, geom, FARTHEST, ends)
            if found is None or distance < found[0]:
                found = distance, geom, ends[3:].copy()
        return found if found is not None and found[0] < FARTHEST else None
