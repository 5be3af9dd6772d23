"""What a model predicts from the measured state, over short windows: nothing adds up but what the model gets wrong.

A run of its own soon differs from the machine's, whatever the model: a hop more or less is enough. So the model is put
where the machine was at the start of each window, gets the goals that the machine got, when it got them, and is
compared over that window. How far it would be off if it were the machine is found alike, from a run of the model itself
through virtual servos: encoder steps, the time of the bytes on the line, and speeds taken from differences are in both.
"""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from ..actuators.engine import install
from ..gap.checks.bootstrap import block_weights
from .robot import ServoRobot
from .simulated import Recording, velocity_of
from .virtual.machine import Machine

WINDOW = 0.2  # [s]
DRAWS = 2000  # of the bootstrap
LOOPS = 5  # Newton steps that close a mechanism's loops


class Aligned:
    """A model that is put into measured states."""

    def __init__(self, robot: ServoRobot) -> None:
        """Build the machine that ``robot`` is believed to be."""
        sensors = {sensor.name: 1.0 for sensor in robot.sensors if not sensor.name.endswith(".link")}
        self._robot = robot
        self._machine = Machine(robot.robot, dict(robot.chains), None, robot.params, sensors)
        self._fixed = [self._machine.model.joint(name).id for name in self._driven_joints()]

    def _driven_joints(self) -> set[str]:
        model = self._machine.model
        names = {joint for item in self._machine.drivetrain.coordinates for joint, _ in item.terms}
        base = {name.partition(".")[0] for name in self._robot.base_names}
        return {model.joint(k).name for k in range(model.njnt)} & (names | base)

    def predict(self, run: Recording, window: float = WINDOW) -> Recording:
        """``run`` as the model predicts it from its state at the start of each window; NaN in these rows themselves."""
        machine, count = self._machine, len(run.time)
        per_window = max(round(window / run.period), 2)
        sent = np.where(np.isfinite(run.sent), run.sent, run.time) if len(run.sent) else run.time
        columns = {
            name: np.full(np.shape(getattr(run, name)), np.nan)
            for name in ("position", "duty", "current", "voltage", "base")
        }
        joints = range(len(machine.names))
        for first in range(1, count - 1, per_window):
            self._put(run, first)
            machine.data.time = run.time[first]
            for row in range(first, min(first + per_window, count - 1)):
                machine.advance(sent[row])
                for joint in joints:
                    machine.set_goal(joint, float(run.goal[row, joint]))
                machine.advance(run.time[row + 1])
                for name, value in (
                    ("position", machine.reading), ("duty", machine.duty), ("current", machine.current),
                    ("voltage", machine.voltage),
                ):  # fmt: skip
                    columns[name][row + 1] = [value(joint) for joint in joints]
                behind = range(len(joints), len(machine.encoders))
                columns["base"][row + 1] = [machine.position(sensor) for sensor in behind]
        velocity = velocity_of(run.time, np.where(np.isfinite(columns["position"]), columns["position"], run.position))
        return Recording(run.time, run.goal, velocity=velocity, rewards={}, **columns)

    def _put(self, run: Recording, row: int) -> None:
        """The state of the machine at a row, its speeds from the rows beside it."""
        model, data = self._machine.model, self._machine.data
        before, here, after = (self._qpos(run, at) for at in (row - 1, row, row + 1))
        qvel = np.zeros(model.nv)
        mujoco.mj_differentiatePos(model, qvel, float(run.time[row + 1] - run.time[row - 1]), before, after)
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = here, qvel
        for joint, name in enumerate(self._machine.names):
            data.ctrl[self._machine.drivetrain.actuator_ids[name]] = run.goal[row - 1, joint]
        install()
        mujoco.mj_forward(model, data)

    def _qpos(self, run: Recording, row: int) -> np.ndarray:
        machine = self._machine
        qpos = np.array(machine.model.qpos0)
        names = self._robot.base_names
        values: Mapping[str, float] = dict(zip(names, run.base[row].tolist(), strict=True))
        machine.layout.place(machine.model, qpos, values)
        link = run.link[row] if run.link.size else run.position[row]
        for _ in range(2):  # a coordinate of two joints needs the other's place
            for k, name in enumerate(machine.names):
                machine.drivetrain.set_position(name, qpos, run.position[row, k], link[k])
        return self._closed(qpos) if machine.model.neq else qpos

    def _closed(self, qpos: np.ndarray) -> np.ndarray:
        """The mechanism's loops closed by the joints that are neither driven nor measured."""
        model = self._machine.model
        data = mujoco.MjData(model)
        data.qpos[:] = qpos
        fixed = np.isin(model.dof_jntid, self._fixed)
        for _ in range(LOOPS):
            mujoco.mj_fwdPosition(model, data)
            rows = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
            jacobian = np.zeros((data.nefc, model.nv))
            if mujoco.mj_isSparse(model):
                mujoco.mju_sparse2dense(jacobian, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
            else:
                jacobian[:] = data.efc_J.reshape(data.nefc, model.nv)
            step = np.zeros(model.nv)
            step[~fixed] = np.linalg.lstsq(jacobian[rows][:, ~fixed], -data.efc_pos[: data.nefc][rows], rcond=None)[0]
            mujoco.mj_integratePos(model, data.qpos, step, 1.0)
        return np.array(data.qpos)


def squares(run: Recording, predicted: Recording, window: float = WINDOW) -> np.ndarray:
    """Mean squares in each whole window of the position error of the joints, and behind them of the base (w, k + b)."""
    per_window = max(round(window / run.period), 2)
    difference = np.concatenate([predicted.position - run.position, predicted.base - run.base], axis=1)
    count = (len(difference) - 2) // per_window
    whole = difference[2 : 2 + count * per_window].reshape(count, per_window, -1)
    return np.nanmean(whole**2, axis=1)


def ratios(found: np.ndarray, accounted: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray]:
    """How many times what is accounted for an error is (s,), and a lower confidence bound of that.

    Windows differ: in one of them a foot lands. So the bound is a bootstrap's, over the windows of both runs.

    Args:
        found, accounted: mean squares (w, s), (v, s).
        share: probability of a ratio below the bound.
    """
    rng = np.random.default_rng(0)

    def drawn(rows: np.ndarray) -> np.ndarray:
        return np.sqrt(block_weights(len(rows), DRAWS, rng) @ rows / len(rows))

    least = 1e-9  # [rad or m]
    ratio = np.sqrt(found.mean(axis=0)) / np.maximum(np.sqrt(accounted.mean(axis=0)), least)
    return ratio, np.quantile(drawn(found) / np.maximum(drawn(accounted), least), share, axis=0)
