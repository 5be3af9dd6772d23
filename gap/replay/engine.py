"""Commands replayed in MuJoCo itself: to confirm what the search found, and to make the logs of a virtual bench."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from ...actuators import Drivetrain
from ...actuators.layout import S_CURRENT, S_DUTY
from ...envs.robots import get_robot
from .joint_model import JointModel
from .simulator import CHANNELS

STEP = 1e-3  # [s] largest engine step; each sample interval is divided evenly, so that commands fall on steps


def bench(joint: JointModel, params: Mapping[str, float]) -> Drivetrain:
    """A bench in the engine that carries the joint."""
    robot = get_robot("bench")
    return robot.drivetrain({robot.coordinates[0].name: joint.chain}, joint.load.numbers(params))


def replay_in_engine(
    drivetrain: Drivetrain, time: np.ndarray, goal: np.ndarray, state: tuple[float, float], step: float = STEP
) -> np.ndarray:
    """Replay the commands of one run.

    Args:
        drivetrain: of one driven coordinate.
        time, goal: of the samples (n,) [s], [rad].
        state: position [rad] and speed [rad/s] at the first sample.
        step: largest engine step [s].

    Returns:
        Channels (n, 4): reading before it is rounded to ticks, link position [rad], duty, current [A].
    """
    model, name = drivetrain.model, drivetrain.coordinates[0].name
    original = model.opt.timestep
    model.opt.timestep = step
    drivetrain.set_teeth()  # as hard as this step allows
    data = mujoco.MjData(model)
    drivetrain.set_position(name, data.qpos, np.asarray(state[0]))
    data.ctrl[drivetrain.actuator_ids[name]] = goal[0]
    data.time = 0.0
    for joint in range(model.njnt):
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
            data.qvel[model.jnt_dofadr[joint]] = state[1]
    out = np.empty((len(time), len(CHANNELS)))
    for k in range(len(time)):
        data.ctrl[drivetrain.actuator_ids[name]] = goal[k]
        mujoco.mj_forward(model, data)
        now = np.array([data.time])
        reading = drivetrain.reading(name, data.qpos[None], data.userdata[None], now, ticks=False)[0]
        link = float(drivetrain.position(name, data.qpos, "link"))
        out[k] = (
            reading,
            link,
            drivetrain.state(name, data.userdata, S_DUTY),
            drivetrain.state(name, data.userdata, S_CURRENT),
        )
        if k + 1 < len(time):
            span = time[k + 1] - time[k]
            count = max(int(np.ceil(span / step - 1e-9)), 1)
            model.opt.timestep = span / count
            mujoco.mj_step(model, data, count)
            data.time = time[k + 1] - time[0]
    model.opt.timestep = original
    drivetrain.set_teeth()
    return out
