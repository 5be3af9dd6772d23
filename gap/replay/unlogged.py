"""Joints of a robot that its log has no columns of: those that follow others, and light ones that hold still."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from ...envs.engine.model_ties import Follower, followers_of, home_of
from ..load.robot import LoggedRobot
from ..load.tree import Motion, is_passive, passive_torques
from ..log.types import MeasuredRun

LIGHT = 0.05  # share of a joint's torque that a joint behind it may change and still count as held: assumed
SAMPLES = 60  # of a run at which that is asked
QUARTER = 0.5 * math.pi  # [rad] to either side, that a hinge without a range may turn: assumed
HAND = 0.05  # [m] the same of a slide


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
