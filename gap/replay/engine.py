"""Commands replayed in MuJoCo itself: of one joint on a bench, and of a whole robot.

A bench confirms what a search found, and makes the logs of a virtual one. A robot that is held near its goals is
simulated from end to end. One that is driven by torques goes elsewhere after a while, whatever its model: it begins
anew from the measured state every second, as replays of single joints do.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from ...actuators import Chain, Drivetrain
from ...actuators.layout import S_CURRENT, S_DUTY
from ...common.errors import SealegsError
from ...envs.described.as_robot import as_robot
from ...envs.robots import get_robot
from ..load.robot import LoggedRobot
from ..load.tree import Motion
from ..log.types import OF_CHAINS, MeasuredRun
from .joint_model import JointModel
from .simulator import CHANNELS
from .tree import motion_of

STEP = 1e-3  # [s] largest engine step; each sample interval is divided evenly, so that commands fall on steps
WINDOW = 1.0  # [s] after which a robot that is driven by torques begins anew
REST = 0.1  # [s] at the start of a run in which a joint may be at rest
SURE = 3.0  # standard deviations of the noise by which positions must leave their mean to move
LONGEST = 120.0  # [s] of a log that are replayed: the first of each run


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


@dataclass(frozen=True, eq=False)
class Whole:
    """A robot with chains, ready to be replayed.

    Attributes:
        robot: as its log names it.
        drivetrain: of it, in the frame of its model.
    """

    robot: LoggedRobot
    drivetrain: Drivetrain

    @property
    def by_torque(self) -> bool:
        """Whether the command of some joint is a torque."""
        return any(chain.command == "torque_command" for chain in self.drivetrain.chains.values())

    @property
    def names(self) -> list[str]:
        """Joints that are driven."""
        return [item.name for item in self.drivetrain.coordinates]

    def read(self, name: str) -> tuple[float, float]:
        """How a joint is read: the reading per position, and at position zero [rad], in the frame of the model."""
        encoder = self.drivetrain.chains[name].find("encoder")
        return (1.0, 0.0) if encoder is None else (encoder.scale, encoder.offset)


def why_not_whole(robot: LoggedRobot, runs: Sequence[MeasuredRun]) -> str | None:
    """Why a robot cannot be simulated as a whole along a log; None where it can."""
    if robot.file.base == "free" or not all(robot.turns(joint) for joint in range(robot.model.njnt)):
        return "its base moves, and what it stands on is not known"
    driven = {item.name: item for item in robot.file.joints}
    for name, item in driven.items():
        if len(item.terms) > 1:
            return f"the drive of '{name}' turns several joints"
        for run in runs:
            log = run.joints.get(name)
            if log is None or all(getattr(log, told) is None for told in OF_CHAINS):
                return f"{run.name} has no command of '{name}'"
            if log.enabled is not None and not np.all(log.enabled > 0.5):
                return f"the drive of '{name}' is off for a part of {run.name}"
    return None


def whole(robot: LoggedRobot, chains: Mapping[str, Chain], params: Mapping[str, float] | None = None) -> Whole:
    """A robot with chains, in the frame of its model, on all joints that it drives.

    Raises:
        SealegsError: they do not go together.
    """
    return Whole(robot, as_robot(robot.file).drivetrain(dict(chains), params))


def replay_whole(machine: Whole, run: MeasuredRun, step: float = STEP) -> dict[str, np.ndarray]:
    """Readings of all driven joints (n,) along a run, in the frame of the log and before they are rounded to ticks;
    NaN where the replay was not asked for or ended.
    """
    robot, drivetrain, model = machine.robot, machine.drivetrain, machine.drivetrain.model
    motion = _rested(robot, run, motion_of(robot, run))
    names, time = machine.names, run.time
    commands = {name: _command(machine, run, name) for name in names}
    frames = {name: robot.frame(name) for name in names}
    out = {name: np.full(len(time), np.nan) for name in names}
    starts = _starts(time, WINDOW if machine.by_torque else np.inf)
    original, data = model.opt.timestep, mujoco.MjData(model)
    model.opt.timestep = step
    drivetrain.set_teeth()
    for first, end in itertools.pairwise(starts):
        _place(machine, data, motion, first, commands)
        for k in range(first, end):
            for name in names:
                data.ctrl[drivetrain.actuator_ids[name]] = commands[name][k]
            now = np.array([data.time])
            for name in names:
                value = drivetrain.reading(name, data.qpos[None], data.userdata[None], now, ticks=False)[0]
                out[name][k] = frames[name].zero + frames[name].sign * value
            if k + 1 == end:
                break
            span = time[k + 1] - time[k]
            count = max(int(np.ceil(span / step - 1e-9)), 1)
            model.opt.timestep = span / count
            mujoco.mj_step(model, data, count)
            if not np.all(np.isfinite(data.qpos)):
                raise SealegsError(f"{run.name}: the simulation of the whole robot runs away at {time[k]:.2f} s.")
            data.time = time[k + 1] - time[first]
    model.opt.timestep = original
    drivetrain.set_teeth()
    return out


def _command(machine: Whole, run: MeasuredRun, name: str) -> np.ndarray:
    frame, kind = machine.robot.frame(name), machine.drivetrain.chains[name].command
    command = getattr(run.joints[name], kind)
    if command is None:
        raise SealegsError(f"{run.name} has no '{name}.{kind}', which the chain of '{name}' takes.")
    return frame.sign * (command - (frame.zero if kind == "goal" else 0.0))


def _starts(time: np.ndarray, window: float) -> np.ndarray:
    """First samples of what is replayed from a measured state, and the end of the last (w + 1,)."""
    end = int(np.searchsorted(time, time[0] + LONGEST))
    if not np.isfinite(window):
        return np.array([0, end])
    first = np.searchsorted(time, np.arange(time[0], time[end - 1] - 0.5 * window, window))
    return np.array([*np.unique(first), end])


def _rested(robot: LoggedRobot, run: MeasuredRun, motion: Motion) -> Motion:
    """A motion whose first speeds are zero where they are within their noise.

    The first derivative of a run has samples on one side only. Thrown off at a speed that it does not have, a joint
    that rests slips out of the friction that holds it, and stays where it slips to.
    """
    first = run.time <= run.time[0] + REST
    position, speed = motion.position.copy(), motion.speed.copy()
    for name, log in run.joints.items():
        number, values = robot.number(name), log.position if log.link_position is None else log.link_position
        values = values[first]
        if number < 0 or not robot.turns(number) or len(values) < 5 or not np.isfinite(values).all():
            continue
        time, frame, dof = run.time[first] - run.time[0], robot.frame(name), int(robot.model.jnt_dofadr[number])
        still, curved = (float(np.sum((values - np.polyval(np.polyfit(time, values, n), time)) ** 2)) for n in (0, 2))
        if still - curved <= SURE**2 * max(curved, 1e-300) / (len(values) - 3):
            position[0, dof], speed[0, dof] = frame.sign / robot.ratio(name) * (values.mean() - frame.zero), 0.0
    return Motion(position, speed, motion.acceleration)


def _place(
    machine: Whole, data: mujoco.MjData, motion: Motion, sample: int, commands: Mapping[str, np.ndarray]
) -> None:
    """Put the robot where it was measured, motors and links together."""
    drivetrain, robot = machine.drivetrain, machine.robot
    mujoco.mj_resetData(drivetrain.model, data)
    for joint in range(robot.model.njnt):  # those that nothing drives too; motors behind springs come below
        name, dof = robot.model.joint(joint).name, int(robot.model.jnt_dofadr[joint])
        if not name:  # where it starts cannot have been logged
            continue
        data.joint(name).qpos[0], data.joint(name).qvel[0] = motion.position[sample, dof], motion.speed[sample, dof]
    for name in machine.names:
        dof, ratio = int(robot.model.jnt_dofadr[robot.number(name)]), robot.ratio(name)
        scale, offset = machine.read(name)
        drivetrain.set_position(name, data.qpos, np.asarray((ratio * motion.position[sample, dof] - offset) / scale))
        drivetrain.set_speed(name, data.qvel, ratio * motion.speed[sample, dof] / scale)
        data.ctrl[drivetrain.actuator_ids[name]] = commands[name][sample]
    mujoco.mj_forward(drivetrain.model, data)
