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
from ...envs.engine.model_poses import Follower, followers_of, home_of
from ..checks.signal import derivatives
from ..load.robot import LoggedRobot
from ..load.terms import E_COUPLING, E_INERTIA, E_POSITION, E_SLOPE, T_DRAWN, T_OWN, T_SIZE, T_SPIN
from ..load.tree import (
    Motion,
    TreeLoad,
    is_passive,
    least_payload,
    own_lever,
    passive_torques,
    terms_along,
    tip_behind,
    tip_mass,
)
from ..log.finding import Finding
from ..log.types import MeasuredRun
from .joint_model import Axis, JointModel

LIGHT = 0.05  # share of a joint's torque that a joint behind it may change and still count as held: assumed
SAMPLES = 60  # of a run at which that is asked
QUARTER = 0.5 * math.pi  # [rad] to either side, that a hinge without a range may turn: assumed
HAND = 0.05  # [m] the same of a slide
NOTHING: Mapping[str, np.ndarray] = MappingProxyType({})
HELD = "robot.held"
"""Code of the finding that says why a link is moved as measured."""
STILL = "robot.still"
"""Code of the finding that says which joints were not logged and are taken as held."""
PASSED = "robot.range"
"""Code of the finding that says that a log goes beyond the range of a joint."""
ROUNDED = 1e-3  # share by which numbers differ that were written with four digits, and more
MARGIN = 0.02  # of its range by which a joint may pass the end of it in the log before that is no stop


def logged(robot: LoggedRobot, runs: Sequence[MeasuredRun]) -> set[int]:
    """Numbers of the joints whose position every run has."""
    names = set.intersection(*(set(run.joints) for run in runs))
    return {number for name in names if (number := robot.number(name)) >= 0}


def needed(robot: LoggedRobot, numbers: Sequence[int], known: set[int]) -> list[int]:
    """Of some joints those that must be logged and are not: a follower is as well known as its leader."""
    followers, found = followers_of(robot.model), []
    for number in numbers:
        for _ in range(robot.model.njnt):
            if number in known or number not in followers:
                break
            number = followers[number].leader
        if number >= 0 and number not in known:
            found.append(number)
    return list(dict.fromkeys(found))


def with_unlogged(robot: LoggedRobot, motion: Motion, known: set[int], held: Mapping[int, float] | None = None) -> None:
    """Write into a motion where joints are that were not logged: at the start, held elsewhere, or behind a leader."""
    model, followers = robot.model, followers_of(robot.model)
    for number in range(model.njnt):
        if number not in known and robot.turns(number):
            motion.position[:, int(model.jnt_dofadr[number])] = (held or {}).get(number, start_of(robot, number))
    done = {number for number in range(model.njnt) if number in known or number not in followers} | {-1}
    for _ in followers:
        for number in [number for number, it in followers.items() if number not in done and it.leader in done]:
            _follow(model, motion, number, followers[number])
            done.add(number)


def _follow(model: mujoco.MjModel, motion: Motion, number: int, follower: Follower) -> None:
    dof, first, second = int(model.jnt_dofadr[number]), follower.way.deriv(1), follower.way.deriv(2)
    if follower.leader < 0:
        motion.position[:, dof] = follower.way(0.0)
        return
    at = int(model.jnt_dofadr[follower.leader])
    q, w, a = motion.position[:, at], motion.speed[:, at], motion.acceleration[:, at]
    motion.position[:, dof] = follower.way(q)
    motion.speed[:, dof], motion.acceleration[:, dof] = first(q) * w, first(q) * a + second(q) * w**2


def start_of(robot: LoggedRobot, number: int) -> float:
    """Where a joint of the model is before it moves [rad or m]."""
    name, model = robot.model.joint(number).name, robot.model
    start = next((item.start for item in robot.file.joints if item.terms == ((name, 1.0),)), None)
    start = robot.file.model.start.get(name, home_of(model, number)) if start is None else start
    return float(np.clip(start, *model.jnt_range[number])) if model.jnt_limited[number] else start


def behind(robot: LoggedRobot, joint: int, other: int) -> bool:
    """Whether one joint of the model carries another."""
    body, own = int(robot.model.jnt_bodyid[other]), int(robot.model.jnt_bodyid[joint])
    while body > own:
        body = int(robot.model.body_parentid[body])
    return body == own and other > joint


def weight_of(
    robot: LoggedRobot,
    joint: str,
    motion: Motion,
    absent: Sequence[int],
    known: set[int],
    armature: float | None = None,
) -> float:
    """How much joints that were not logged may change the torque of one that carries them, as a share of it.

    The torque is compared with that of the same motion with these joints at either end of their range. What nothing
    drives may also give way to the motion; then its inertia falls away.

    Args:
        robot: that was logged.
        joint: whose torque it is.
        motion: of a run, as :func:`sealegs.gap.replay.tree.motion_of` gives it.
        absent: numbers of the joints.
        known: numbers of those that were logged.
        armature: of the joint's drive [kg.m2 or kg]; None: that of the robot's file.
    """
    model, number = robot.model, robot.number(joint)
    dof = int(model.jnt_dofadr[number])
    armature = robot.joint(joint).chain.armature() if armature is None else armature
    rows = np.unique(np.linspace(0, len(motion.position) - 1, SAMPLES).astype(int))
    plain = Motion(*(getattr(motion, key)[rows].copy() for key in ("position", "speed", "acceleration")))
    whole = torques_of(model, plain)[:, dof] + armature * plain.acceleration[:, dof]
    size = max(float(np.sqrt(np.mean(whole**2))), 1e-12)
    worst = 0.0
    for end in (0, 1):
        moved = Motion(plain.position.copy(), plain.speed, plain.acceleration)
        with_unlogged(robot, moved, known, {k: _ends(robot, k)[end] for k in absent})
        changed = torques_of(model, moved)[:, dof] + armature * moved.acceleration[:, dof] - whole
        worst = max(worst, float(np.sqrt(np.mean(changed**2))) / size)
    loose = [k for k in absent if not _is_driven(robot, k)]
    return max(worst, _loosened(robot, dof, plain, loose, known, armature)) if loose else worst


def _ends(robot: LoggedRobot, number: int) -> tuple[float, float]:
    if robot.model.jnt_limited[number]:
        low, high = map(float, robot.model.jnt_range[number])
        return low, high
    hinge = int(robot.model.jnt_type[number]) == int(mujoco.mjtJoint.mjJNT_HINGE)
    away, start = QUARTER if hinge else HAND, start_of(robot, number)
    return start - away, start + away


def _is_driven(robot: LoggedRobot, number: int) -> bool:
    """Whether somebody said that something drives a joint: the robot's YAML, or an actuator of its model."""
    name, said = robot.model.joint(number).name, robot.file.path != robot.file.model.path
    terms = [item.terms for item in (robot.file.joints if said else robot.file.model.drives)]
    return any(name == joint for some in terms for joint, _ in some)


def _loosened(
    robot: LoggedRobot, dof: int, motion: Motion, loose: Sequence[int], known: set[int], armature: float
) -> float:
    """Share of a joint's inertia that falls away where others give way, the worst of a few poses."""
    model, nv = robot.model, robot.model.nv
    first = [int(model.jnt_dofadr[k]) for k in loose]
    worst = 0.0
    for row in np.unique(np.linspace(0, len(motion.position) - 1, 5).astype(int)):
        at = motion.position[row]
        ways = np.zeros((len(loose) + 1, nv))  # unit motions of the joint, and of each loose one with its followers
        ways[0, dof] = 1.0
        for k, column in enumerate(first, 1):
            unit = Motion(at[None].copy(), np.zeros((1, nv)), np.zeros((1, nv)))
            unit.acceleration[0, column] = 1.0
            with_unlogged(robot, unit, known | set(loose), None)
            ways[k] = unit.acceleration[0]
        still = np.zeros_like(ways)
        pose = np.repeat(at[None], len(ways), axis=0)
        inertia = (
            ways @ (torques_of(model, Motion(pose, still, ways)) - torques_of(model, Motion(pose, still, still))).T
        )
        inertia[0, 0] += armature
        coupling, own = inertia[0, 1:], inertia[1:, 1:]
        lost = coupling @ np.linalg.lstsq(own, coupling, rcond=None)[0]
        worst = max(worst, float(lost / max(inertia[0, 0], 1e-12)))
    return worst


def torques_of(model: mujoco.MjModel, motion: Motion) -> np.ndarray:
    """Torques (n, nv) that a motion of a robot of hinges and slides needs."""
    data, result, out = mujoco.MjData(model), np.zeros(model.nv), np.empty_like(motion.position)
    passive = is_passive(model)
    address = [int(model.jnt_qposadr[j]) for j in range(model.njnt)]
    for k in range(len(out)):
        data.qpos[address] = motion.position[k]
        data.qvel[:], data.qacc[:] = motion.speed[k], motion.acceleration[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 1, result)
        out[k] = result + passive_torques(model, data) if passive else result
    return out


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
    for run, motion in zip(runs, motions or [motion_of(robot, run) for run in runs], strict=True):
        terms = terms_along(robot.model, robot.number(joint), motion, frame.sign, changes=changes)
        terms[:, E_POSITION] = frame.sign * terms[:, E_POSITION] + frame.zero
        terms[:, T_DRAWN:] = drawn_beside(run, joint)
        found.append(terms)
    return found


def drawn_beside(run: MeasuredRun, joint: str) -> np.ndarray:
    """What the drives of all joints but one draw from the supply, columns as of ``run.draws`` (n, 2)."""
    others = [rows for name, rows in run.draws.items() if joint in run.draws and name != joint]
    return np.sum([np.zeros((len(run.time), 2)), *others], axis=0)


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
