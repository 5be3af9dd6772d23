"""One joint of a robot laid out for replay: the measured motion of all joints, and what this one works against."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import mujoco
import numpy as np

from ...actuators import Chain
from ...envs.described.robot_described import stated
from ..checks.signal import derivatives
from ..load.robot import LoggedRobot
from ..load.terms import E_COUPLING, E_INERTIA, E_POSITION, E_SLOPE, T_OWN, T_SIZE, T_SPIN
from ..load.tree import Motion, least_payload, own_lever, terms_along, tip_behind, tip_mass
from ..load.tree_load import TreeLoad
from ..log.finding import Finding
from ..log.types import MeasuredRun
from .axis import Axis
from .joint_model import JointModel
from .unlogged import LIGHT, behind, logged, needed, start_of, weight_of, with_unlogged

NOTHING: Mapping[str, np.ndarray] = MappingProxyType({})
HELD = "robot.held"
"""Code of the finding that says why a link is moved as measured."""
STILL = "robot.still"
"""Code of the finding that says which joints were not logged and are taken as held."""
PASSED = "robot.range"
"""Code of the finding that says that a log goes beyond the range of a joint."""
ROUNDED = 1e-3  # share by which numbers differ that were written with four digits, and more
MARGIN = 0.02  # of its range by which a joint may pass the end of it in the log before that is no stop


def not_free(
    robot: LoggedRobot, joint: str, runs: Sequence[MeasuredRun], armature: float | None = None
) -> Finding | None:
    """Why a joint of a robot cannot be replayed freely; None where it can.

    Args:
        robot: that was logged.
        joint: its name.
        runs: of it.
        armature: of its drive [kg.m2 or kg]; None: that of the robot's file.
    """
    if robot.joint(joint).terms != ((robot.joint(joint).joint, 1.0),):
        return _held(joint, "its drive turns several joints together, or one through a ratio")
    if joint in robot.file.coupled:
        return _held(joint, robot.file.coupled[joint])
    if loose := [number for number in robot.felt_by(joint) if not robot.turns(number)]:
        if any(int(robot.model.jnt_type[number]) == int(mujoco.mjtJoint.mjJNT_FREE) for number in loose):
            return _held(
                joint,
                "the robot's base moves, and what the ground does to it is in no column; to judge it by its position "
                "alone, hang the robot up and write base: fixed in its YAML",
            )
        return _held(joint, f"no column says how the ball joint '{robot.column(loose[0])}' moves; weld it in the model")
    logs = [run.joints[joint] for run in runs if joint in run.joints]
    if logs and all(log.always_touched for log in logs):
        return _held(joint, "what it carries touches the floor, or what else stands still in the model, nearly always")
    absent = _absent(robot, joint, runs)
    if not absent or _light(robot, joint, runs, absent, armature):
        return None
    unnamed = [robot.column(number) for number in absent if not robot.model.joint(number).name]
    columns = " and ".join(f"'{robot.column(number)}.position'" for number in absent)
    first = f"name {' and '.join(unnamed)} in the model, and " if unnamed else ""
    return _held(joint, f"what it works against depends on joints that were not logged; {first}log {columns}")


def held_still(
    robot: LoggedRobot, joint: str, runs: Sequence[MeasuredRun], armature: float | None = None
) -> Finding | None:
    """Which joints behind one that is replayed freely are taken as held, since they were not logged."""
    absent = _absent(robot, joint, runs)
    if not absent or not all(map(robot.turns, range(robot.model.njnt))):
        return None
    said = [f"'{robot.column(number)}' at {start_of(robot, number):.3g}" for number in absent]
    known = logged(robot, runs)
    share = max(weight_of(robot, joint, motion_of(robot, run), absent, known, armature) for run in runs)
    return Finding(
        STILL, "note", joint, None,
        f"Joint '{joint}': {' and '.join(said)} was not logged and is taken as held there; it changes the torque by "
        f"{max(share, 1e-3):.1%} at most.",
        value=share,
    )  # fmt: skip


def _absent(robot: LoggedRobot, joint: str, runs: Sequence[MeasuredRun]) -> list[int]:
    return needed(robot, robot.felt_by(joint), logged(robot, runs))


def _light(
    robot: LoggedRobot, joint: str, runs: Sequence[MeasuredRun], absent: Sequence[int], armature: float | None
) -> bool:
    """Whether joints that were not logged hardly matter to one that carries them all."""
    known, own = logged(robot, runs), robot.number(joint)
    if not all(behind(robot, own, number) for number in absent):
        return False
    return all(weight_of(robot, joint, motion_of(robot, run), absent, known, armature) < LIGHT for run in runs)


def _held(joint: str, why: str) -> Finding:
    return Finding(
        HELD, "note", joint, None, f"The link of joint '{joint}' is moved as measured, not simulated: {why}.",
    )  # fmt: skip


def motion_of(robot: LoggedRobot, run: MeasuredRun, flattened: Mapping[str, np.ndarray] = NOTHING) -> Motion:
    """How all coordinates of a robot moved in a run, in the frame of its model.

    Joints that were not logged follow their leader, or are at their start.

    Args:
        robot: that was logged.
        run: of it.
        flattened: what smoothing takes from position, speed and acceleration of joints (n, 3), in the log's frame.
    """
    model, n = robot.model, len(run.time)
    position, speed, acceleration = (np.zeros((n, model.nv)) for _ in range(3))
    for name, log in run.joints.items():
        if (number := robot.number(name)) < 0 or not robot.turns(number):
            continue
        frame = robot.frame(name)
        values = log.position if log.link_position is None else log.link_position
        good = np.isfinite(values)
        values = np.interp(run.time, run.time[good], values[good])
        dof = int(model.jnt_dofadr[number])
        smooth, rate, change = np.array(derivatives(run.time, values)) + (
            flattened[name].T if name in flattened else 0.0
        )
        ratio = frame.sign / robot.ratio(name)
        position[:, dof] = ratio * (smooth - frame.zero)
        speed[:, dof], acceleration[:, dof] = ratio * rate, ratio * change
    motion = Motion(position, speed, acceleration)
    if all(map(robot.turns, range(model.njnt))):
        with_unlogged(robot, motion, logged(robot, [run]))
    return motion


def terms_of(
    robot: LoggedRobot,
    joint: str,
    runs: Sequence[MeasuredRun],
    motions: Sequence[Motion] | None = None,
    *,
    changes: bool = True,
) -> list[np.ndarray]:
    """What a joint works against in each run (samples, T_COLUMNS), in the frame of the log.

    Args:
        robot, joint, runs: that were logged.
        motions: of the robot in each run; default: as measured.
        changes: whether also what other numbers of the robot would add to it.
    """
    frame = robot.frame(joint)
    found = []
    for motion in motions or [motion_of(robot, run) for run in runs]:
        terms = terms_along(robot.model, robot.number(joint), motion, frame.sign, changes=changes)
        terms[:, E_POSITION] = frame.sign * terms[:, E_POSITION] + frame.zero
        found.append(terms)
    return found


def held_terms(
    robot: LoggedRobot, joint: str, runs: Sequence[MeasuredRun]
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """What a joint works against on a planned motion, the others held in the middle of where they were.

    Returns:
        A function of times (n,) [s] and goals (n,) of the log's frame that gives terms (n, T_COLUMNS).
    """
    frame, number = robot.frame(joint), robot.number(joint)
    dof = int(robot.model.jnt_dofadr[number])
    middle = np.median(np.concatenate([motion_of(robot, run).position for run in runs]), axis=0)

    def along(time: np.ndarray, goal: np.ndarray) -> np.ndarray:
        position, speed, acceleration = (np.zeros((len(time), robot.model.nv)) for _ in range(3))
        position[:] = middle
        smooth, rate, change = derivatives(time, goal)
        position[:, dof] = frame.sign * (smooth - frame.zero)
        speed[:, dof], acceleration[:, dof] = frame.sign * rate, frame.sign * change
        terms = terms_along(robot.model, number, Motion(position, speed, acceleration), frame.sign)
        terms[:, E_POSITION] = frame.sign * terms[:, E_POSITION] + frame.zero
        return terms

    return along


def owned(robot: LoggedRobot, joint: str, chain: Chain | None = None) -> Finding | None:
    """Who owns the numbers that both the model file and the chain may have, and what the file has more than any chain.

    Args:
        robot: that was logged.
        joint: its name.
        chain: that drives it; None: that of the robot's file.

    Returns:
        None where the file has neither.
    """
    item, file = robot.joint(joint), robot.file.model.path.name
    chain = item.chain if chain is None else chain
    counts = []
    for key, value in item.model_values.items():
        ours = stated(chain, key)
        same = math.isclose(ours, value, rel_tol=ROUNDED)
        whose = "the file's" if item.owners[key] == "file" and same else "the chain's"
        if value:
            counts.append(f"{key} is {whose}" + (f" ({ours:g} in place of {value:g})" if ours and not same else ""))
    said = [f"{', '.join(counts)}; what {file} has of it is not added a second time"] if counts else []
    simplified = robot.file.model.joints[item.joint].simplified
    if not (said or simplified):
        return None
    return Finding(
        "robot.owners", "warning" if simplified else "note", joint, None,
        f"Joint '{joint}': {'; '.join([*said, *simplified])}.",
    )  # fmt: skip


def joint_of_tree(
    robot: LoggedRobot, joint: str, chain: Chain, runs: Sequence[MeasuredRun], terms: Sequence[np.ndarray] | None
) -> JointModel:
    """A joint of a robot as the search sees it; without terms, one whose link moves as measured.

    What the robot's file owns, the chain carries: the joint alone has none of it.
    """
    chain = robot.joint(joint).carried(chain)
    axis = axis_of(robot, joint, runs)
    if (drive := chain.impedance_drive()) is not None:
        asked = np.concatenate([drive.stiffness * np.abs(log.goal - log.position) for run in runs
                                if (log := run.joints[joint]).goal is not None])  # fmt: skip
        axis = replace(axis, effort=min(float(np.nanquantile(asked, 0.999)), drive.torque_limit))
    if terms is None:
        return JointModel(chain, axis=axis, of_robot=True)
    rows = np.concatenate(terms)
    lower, upper = stops_of(robot, joint, axis)
    tip = tip_behind(robot.model, robot.number(joint))
    load = TreeLoad(
        lower_stop=lower,
        stop_angle=upper,
        typical_inertia=float(np.median(rows[:, E_INERTIA])),
        typical_gravity=float(np.quantile(np.abs(rows[:, E_SLOPE]), 0.99)),
        own_lever=own_lever(robot.model, robot.number(joint)),
        least_payload=least_payload(robot.model, tip),
        tip_mass=tip_mass(robot.model, robot.number(joint), tip),
        carried=bool(np.any(rows[:, T_OWN + T_SPIN * T_SIZE + E_COUPLING - E_INERTIA])),
    )
    return JointModel(chain, load, axis=axis, of_robot=True)


def axis_of(robot: LoggedRobot, joint: str, runs: Sequence[MeasuredRun]) -> Axis:
    """Kind, range and effort of a joint in the runs."""
    logs = [run.joints[joint] for run in runs]
    low = min(float(np.nanmin(log.position)) for log in logs)
    high = max(float(np.nanmax(log.position)) for log in logs)
    commands = [np.abs(log.torque_command) for log in logs if log.torque_command is not None]
    effort = float(np.nanquantile(np.concatenate(commands), 0.999)) if commands else None
    return Axis(robot.slides(joint), low, high, effort or None)


def told_range(robot: LoggedRobot, joint: str, runs: Sequence[MeasuredRun]) -> Finding | None:
    """That a log goes beyond the range that the robot's file gives a joint; None where it does not."""
    axis, ends = axis_of(robot, joint, runs), robot.ends(joint)
    if ends is None or np.isfinite(stops_of(robot, joint, axis)).any():
        return None
    unit = axis.unit("rad")
    return Finding(
        PASSED, "note", joint, f"{joint}.position",
        f"'{joint}' goes from {axis.low:.4g} to {axis.high:.4g} {unit}, beyond the range of {ends[0]:.4g} to "
        f"{ends[1]:.4g} {unit} in {robot.file.model.path.name}: that range stops nothing in the replay, and that of "
        "the extended model is wider. Correct it in the file, or the joint's zero or direction in the log.",
    )  # fmt: skip


def stops_of(robot: LoggedRobot, joint: str, axis: Axis) -> tuple[float, float]:
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
