"""Commands replayed in MuJoCo itself: to confirm what the search found, and to make the logs of a virtual bench."""

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco
import numpy as np

from ...actuators import Drivetrain
from ...actuators.layout import S_CURRENT, S_DUTY
from ...actuators.mounting import spring_constraint
from ...envs.robots import get_robot
from .joint_model import GRAVITY, JointModel
from .simulator import CHANNELS, STOP_DAMPING, STOP_STIFFNESS

FAR = 100.0  # [rad] where a joint is not blocked on one side
STEP = 1e-3  # [s] largest engine step; each sample interval is divided evenly, so that commands fall on steps


def bench_parameters(joint: JointModel, params: Mapping[str, float]) -> dict[str, float]:
    """Bench parameters with the load's changes written into them, as far as mass, arm and length can express them.

    A point mass ``m`` at ``l`` on a rod is matched in gravity torque and inertia; the rod stays as it is, or is left
    out where it is too heavy for that.
    """
    load, arm = joint.load, params.get("arm_mass", 0.0)
    if load == type(load)():
        return {"mass": params["mass"], "arm_mass": arm, "length": params["length"]}
    moment = load.gravity_torque(params) / GRAVITY
    inertia = load.inertia(params)
    without_rod = {"mass": moment**2 / inertia, "arm_mass": 0.0, "length": inertia / moment}
    if arm == 0.0:
        return without_rod
    # mass l + arm l / 2 = moment and mass l^2 + arm l^2 / 3 = inertia, solved for mass and length, the rod as believed:
    # mass = moment / l - arm / 2, hence l moment - l^2 arm / 6 = inertia
    root = np.sqrt(max(moment**2 - 4.0 * (arm / 6.0) * inertia, 0.0))
    length = float(2.0 * inertia / (moment + root))
    mass = moment / length - arm / 2.0
    return {"mass": mass, "arm_mass": arm, "length": length} if mass > 0.0 else without_rod


def bench(joint: JointModel, params: Mapping[str, float]) -> Drivetrain:
    """A bench in the engine that carries the joint."""
    robot = get_robot("bench")
    name = robot.coordinates[0].name
    drivetrain = robot.drivetrain({name: joint.chain}, bench_parameters(joint, params))
    if math.isfinite(joint.load.stop_angle) or math.isfinite(joint.load.lower_stop):
        _block(drivetrain, name, joint, params)
    return drivetrain


def _block(drivetrain: Drivetrain, name: str, joint: JointModel, params: Mapping[str, float]) -> None:
    """Put what stops the link into model and specification: a joint limit as stiff as the search has it."""
    model, limit = drivetrain.model, drivetrain.spec.joint(name)
    number = model.joint(name).id
    lower, upper = max(joint.load.lower_stop, -FAR), min(joint.load.stop_angle, FAR)
    stiff = model.njnt == 1
    inertia = joint.load.inertia(params) + (joint.chain.armature() if stiff else 0.0)
    solref, solimp = spring_constraint(STOP_STIFFNESS, STOP_DAMPING, 1.0 / inertia, model.opt.timestep)
    limit.limited, limit.range = True, (lower, upper)
    limit.solref_limit, limit.solimp_limit = solref, solimp
    model.jnt_limited[number] = True
    model.jnt_range[number] = lower, upper
    model.jnt_solref[number], model.jnt_solimp[number] = solref, solimp


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
