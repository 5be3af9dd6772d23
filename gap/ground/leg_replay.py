"""Many stances on many grounds at once, in the engine.

The motors follow their measured motion and push the leg through its springs, so what is judged is body and ground; a
joint without a spring between motor and link is driven by its commands.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco.batch import Batch

from ...actuators.gravity import GRAVITY
from ...envs.engine.scene import FLOOR
from ...envs.hopper.robot import HIP, KNEE
from ..log.types import MeasuredRun
from .leg_model import GROUND_BODY, GROUND_JOINT, LegModel
from .pieces import ENGINE_STEP, WITHOUT_END, Piece, Replayer

JOINTS = (HIP, KNEE)


class LegReplay(Replayer[LegModel]):
    """The engine with a leg in it; ``goal`` are those of its motors at every step (steps + 1, stances, 2) [rad]."""

    def __init__(self, leg: LegModel, runs: Sequence[MeasuredRun], stances: Sequence[Piece]) -> None:
        """Build the leg; ``leg`` gives body and chains, the ground may differ from replay to replay."""
        super().__init__(leg, runs, stances)
        model = self.model
        for name in JOINTS:  # a motor so heavy that only the force which makes it follow its path can move it
            if _has_motor(model, name):
                motor = int(model.joint(f"{name}_motor").dofadr[0])
                model.dof_armature[motor] = WITHOUT_END
                model.dof_frictionloss[motor] = model.dof_damping[motor] = 0.0
        mujoco.mj_setConst(model, mujoco.MjData(model))
        self.drivetrain.set_teeth()  # they are told per inertia
        self.follows = [model.joint(f"{name}_motor").id if _has_motor(model, name) else -1 for name in JOINTS]
        shape = (self.steps + 1, len(self.pieces), len(JOINTS))
        position, self.goal = np.empty(shape), np.empty(shape)
        ticks = np.arange(self.steps + 1) * ENGINE_STEP
        for k, stance in enumerate(self.pieces):
            run = runs[stance.run]
            at = run.time[stance.start] + ticks
            held = np.clip(np.searchsorted(run.time, at + 1e-9, side="right") - 1, 0, len(run.time) - 1)
            for j, name in enumerate(JOINTS):
                log = run.joints[name]
                position[:, k, j] = np.interp(at, run.time, log.position)
                self.goal[:, k, j] = position[:, k, j] if log.goal is None else log.goal[held]
        self._follow(position)

    def _run(self, models: Sequence[LegModel], ground: np.ndarray, piece: np.ndarray, states: np.ndarray) -> np.ndarray:
        n, model = len(ground), self.model
        batch = self._begun(n)
        self._lay_ground(batch, models, ground)
        batch.set_const(np.arange(n))  # inertias follow from the ground's mass
        # which is to make no contact softer
        batch.expand("body_invweight0")[:n, model.body(GROUND_BODY).id] = 0.0
        qpos, qvel = batch.bind("qpos"), batch.bind("qvel")
        x, z, hip, knee = (int(model.joint(name).qposadr[0]) for name in ("base_x", "base_z", HIP, KNEE))
        order = [z, x, hip, knee]  # every joint has one degree of freedom: qpos and qvel agree in order
        leg = states.copy()
        leg[:, 3] -= leg[:, 2]  # the knee joint turns relative to the upper link
        leg[:, 7] -= leg[:, 6]
        # the engine moves with the speed at the end of a step: half a step makes free fall exact
        leg[:, 4] += 0.5 * GRAVITY * ENGINE_STEP
        qpos[:n, order], qvel[:n, order] = leg[:, :4], leg[:, 4:]
        control = np.zeros((n, self.steps, model.nu + model.nv))
        for j, name in enumerate(JOINTS):
            control[:, :, self.drivetrain.actuator_ids[name]] = self.goal[:-1, piece, j].T
            if (number := self.follows[j]) >= 0:
                motor = int(model.jnt_dofadr[number])
                qpos[:n, motor], qvel[:n, motor] = self.position[0, piece, j], self.speed[0, piece, j]
                control[:, :, model.nu + motor] = WITHOUT_END * self.acceleration[:, piece, j].T
        recorded = np.empty((self.steps + 1, n, 4))
        recorded[0] = leg[:, :4]
        spec = int(mujoco.mjtState.mjSTATE_CTRL) | int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
        path = batch.rollout(self.steps, control, spec, ("qpos",), np.arange(n))["qpos"]
        recorded[1:] = path[:, :, order].transpose(1, 0, 2)
        recorded[:, :, 3] += recorded[:, :, 2]
        return recorded

    def _lay_ground(self, batch: Batch, legs: Sequence[LegModel], ground: np.ndarray) -> None:
        n, floor, body = len(ground), self.model.geom(FLOOR).id, self.model.body(GROUND_BODY).id
        joint = self.model.joint(GROUND_JOINT)
        value = {path: np.array([leg.value(path) for leg in legs])[ground] for path in legs[0].ground}
        batch.expand("geom_friction")[:n, floor, 0] = value["contact.friction"]
        batch.expand("geom_solref")[:n, floor, 0] = value["contact.time"]
        half = -0.5 * value["contact.slope"]
        quaternion = batch.expand("body_quat")
        quaternion[:n, body, 0], quaternion[:n, body, 2] = np.cos(half), np.sin(half)
        batch.expand("body_pos")[:n, body, 2] = value["contact.height"]
        stiffness, damping, mass = np.array([leg.compliance() for leg in legs])[ground].T
        batch.expand("jnt_stiffness")[:n, joint.id] = stiffness
        batch.expand("dof_damping")[:n, joint.dofadr[0]] = damping
        batch.expand("body_mass")[:n, body] = mass


def _has_motor(model: mujoco.MjModel, name: str) -> bool:
    return any(model.joint(k).name == f"{name}_motor" for k in range(model.njnt))
