"""One joint of a robot laid out for replay: the measured motion of all joints, and what this one works against."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...actuators import Chain
from ...actuators.stages import STAGES
from ..checks.signal import derivatives
from ..load.robot import RobotFile
from ..load.tree import Motion, TreeLoad, terms_along
from ..log.finding import Finding
from ..log.types import MeasuredRun
from .axis import Axis
from .joint_model import JointModel
from .terms import E_INERTIA, E_POSITION, E_SLOPE

MARGIN = 0.02  # of its range by which a joint may pass the end of it in the log before that is no stop


def unmeasured(robot: RobotFile, joint: str, runs: Sequence[MeasuredRun]) -> list[str]:
    """Joints whose motion a joint feels and that some run does not tell."""
    names = [robot.name(number) for number in robot.felt_by(joint)]
    return [name for name in names if any(name not in run.joints for run in runs)]


def motion_of(robot: RobotFile, run: MeasuredRun) -> Motion:
    """How all coordinates of a robot moved in a run, in the frame of its model."""
    model, n = robot.model, len(run.time)
    position, speed, acceleration = (np.zeros((n, model.nv)) for _ in range(3))
    for name in robot.passive:
        if name not in run.joints:
            continue
        log, frame = run.joints[name], robot.frame(name)
        values = log.position if log.link_position is None else log.link_position
        good = np.isfinite(values)
        values = np.interp(run.time, run.time[good], values[good])
        dof = int(model.jnt_dofadr[robot.number(name)])
        smooth, rate, change = derivatives(run.time, values)
        position[:, dof] = frame.sign * (smooth - frame.zero)
        speed[:, dof], acceleration[:, dof] = frame.sign * rate, frame.sign * change
    return Motion(position, speed, acceleration)


def terms_of(robot: RobotFile, joint: str, runs: Sequence[MeasuredRun]) -> list[np.ndarray]:
    """What a joint works against in each run (samples, T_COLUMNS), in the frame of the log."""
    frame = robot.frame(joint)
    found = []
    for run in runs:
        terms = terms_along(robot.model, robot.number(joint), motion_of(robot, run), frame.sign)
        terms[:, E_POSITION] = frame.sign * terms[:, E_POSITION] + frame.zero
        found.append(terms)
    return found


def completed(chain: Chain, robot: RobotFile, joint: str) -> tuple[Chain, str]:
    """The chain with what the model file knows of the joint's friction and armature where the chain says nothing, and a
    sentence on who owns which number.
    """
    passive, taken, left = robot.passive[joint], [], []
    if passive.friction > 0.0 or passive.damping > 0.0:
        if chain.find("friction") is None:
            friction = replace(STAGES["friction"].neutral(), coulomb=passive.friction, viscous=passive.damping)  # pyright: ignore
            chain = chain.with_stage(friction)
            taken.append("frictionloss and damping")
        else:
            left.append("frictionloss and damping")
    motor = next((stage for stage in chain.stages if "armature" in stage.parameters()), None)
    if passive.armature > 0.0:
        if motor is not None and motor.parameters()["armature"] == 0.0:
            ratio = chain.gear_ratio()
            chain = chain.with_value(f"{motor.name}.armature", passive.armature / ratio**2)
            taken.append("armature")
        else:
            left.append("armature")
    said = []
    if taken:
        said.append(f"{' and '.join(taken)} of the file are taken, since the chain has none")
    if left:
        said.append(f"{' and '.join(left)} are the chain's, and what the file has of it is left out")
    return chain, "; ".join(said)


def joint_of_tree(
    robot: RobotFile, joint: str, chain: Chain, runs: Sequence[MeasuredRun], terms: Sequence[np.ndarray] | None
) -> JointModel:
    """A joint of a robot as the search sees it; without terms, one whose link moves as measured."""
    axis = axis_of(robot, joint, runs)
    if terms is None:
        return JointModel(chain, axis=axis)
    rows = np.concatenate(terms)
    lower, upper = stops_of(robot, joint, axis)
    load = TreeLoad(
        lower_stop=lower,
        stop_angle=upper,
        typical_inertia=float(np.median(rows[:, E_INERTIA])),
        typical_gravity=float(np.quantile(np.abs(rows[:, E_SLOPE]), 0.99)),
    )
    return JointModel(chain, load, axis=axis)


def axis_of(robot: RobotFile, joint: str, runs: Sequence[MeasuredRun]) -> Axis:
    """Kind, range and effort of a joint in the runs."""
    logs = [run.joints[joint] for run in runs]
    low = min(float(np.nanmin(log.position)) for log in logs)
    high = max(float(np.nanmax(log.position)) for log in logs)
    commands = [np.abs(log.torque_command) for log in logs if log.torque_command is not None]
    effort = float(np.nanquantile(np.concatenate(commands), 0.999)) if commands else None
    return Axis(robot.slides(joint), low, high, effort or None)


def stops_of(robot: RobotFile, joint: str, axis: Axis) -> tuple[float, float]:
    """The range of a joint in the log's frame where the log stays within it: else the file's range is no stop."""
    model, number, frame = robot.model, robot.number(joint), robot.frame(joint)
    if not model.jnt_limited[number]:
        return -np.inf, np.inf
    ends = [float(frame.sign * end + frame.zero) for end in model.jnt_range[number]]
    lower, upper = min(ends), max(ends)
    margin = MARGIN * (upper - lower)
    if axis.low < lower - margin or axis.high > upper + margin:
        return -np.inf, np.inf
    return min(lower, axis.low), max(upper, axis.high)


def told(robot: RobotFile, joint: str, said: str) -> Finding | None:
    """Who owns the numbers that both the file and the chain may have."""
    if not said:
        return None
    return Finding(
        "robot.passive", "note", joint, None, f"Of joint '{joint}' in {robot.path.name}: {said}.",
    )  # fmt: skip


def without_motion(joint: str, absent: Sequence[str]) -> Finding:
    """Why a joint of a robot cannot be replayed freely."""
    columns = " and ".join(f"'{name}.position'" for name in absent)
    return Finding(
        "robot.unmeasured", "note", joint, None,
        f"What joint '{joint}' works against depends on how {', '.join(absent)} moved, which was not logged: its link is "
        f"moved as measured. Log {columns} to judge its motion.",
    )  # fmt: skip


