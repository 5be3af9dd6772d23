"""Where a robot rests on something level that its model lacks: a table under an arm, found in its log.

An arm hangs below its goals, by its weight. Where it presses on a table it stands above them, at the lowest height that
it ever reaches, and joints are pushed that nobody commanded: more than friction holds them anywhere else in the log. A
stop of a joint, or a friction, pushes no other one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from ...envs.described.model_file import centre_of
from ..log.parts import PARTS, stretches
from ..log.types import Array, MeasuredRun
from .robot import LoggedRobot

POSE_RATE = 25.0  # [1/s] at which poses are looked at
SLOW_SPEEDS = (0.1, 0.4)  # [rad/s] below which joints are judged: what a log has enough of, the slower the clearer
REVERSAL_SPEED = 0.05  # [rad/s] over which dry friction turns around
SPEED_SECONDS = 0.3  # [s] over which a speed is told
MIN_HEIGHT_LEVER = 0.01  # [m/rad] from which the height of a body tells of a joint
RESTING_HEIGHT_SHARE = 0.05
"""Of the reach of a robot: heights above the lowest one at which it may rest, where its shape is not known."""
CLEAR_HEIGHT_SHARE = 2.0 * RESTING_HEIGHT_SHARE
"""And above which it certainly does not; while it rests, it sinks by less in a second."""
CONTACT_HEIGHT_QUANTILE = 0.95  # share of the poses that certainly rest, above whose heights no contact is expected
CONTACT_THICKNESS = 0.002  # [m] by which it may be higher all the same
MIN_CLEAR_SECONDS = 8.0  # [s] slow and clear of what is below, in which what holds a joint is seen
WRONG_POSE_SHARE = 1e-3  # of all poses, that may be lower than the lowest one: a reading that is none
HOLDING_TAIL_SHARE = 0.005  # of these on either side that may be anything
PUSH_BEYOND_SHARE = 0.25  # of the width of what friction holds, by which a push must leave it
MIN_PUSH = 0.005  # [rad] and at least so much: resolution, and what a soft drive leaves
MIN_CONTACT_SECONDS = 0.2  # [s] of one contact
MIN_RESTING_SECONDS = len(PARTS) * MIN_CONTACT_SECONDS  # [s] of all
CONTACT_MARGIN = 0.5 * MIN_CONTACT_SECONDS  # [s] around a contact that is left out with it
MIN_PUSHED_JOINTS = 2  # joints at least
HINGE_KIND = int(mujoco.mjtJoint.mjJNT_HINGE)


@dataclass(frozen=True, eq=False)
class Resting:
    """Contacts of one body with what is below the robot.

    Attributes:
        body: its name.
        height: of its lowest known point in the frame of the model, where it rests [m].
        deeper: how far below that the goals went [m].
        joints: that carry it, and were logged: those that cannot be simulated without the contacts.
        stretches: first and last time of each contact by the name of its run [s].
    """

    body: str
    height: float
    deeper: float
    joints: tuple[str, ...]
    stretches: Mapping[str, tuple[tuple[float, float], ...]]

    @property
    def seconds(self) -> float:
        """How long it rests in all [s]."""
        return _seconds(dict(self.stretches))


@dataclass(frozen=True, eq=False)
class _Poses:
    """A run at some samples: positions of all coordinates as measured and as commanded (m, nv), and what is known."""

    run: str
    joints: tuple[str, ...]  # that were logged and have one coordinate
    period: float  # [s] between two of them
    time: Array
    measured: Array
    goal: Array
    speed: Array  # (m, nv)
    on: np.ndarray  # (m,) the drives of all of them


def find_resting(robot: LoggedRobot, runs: Sequence[MeasuredRun]) -> Resting | None:
    """Where the robot rests on something level; None where nothing shows it.

    Args:
        robot: with a fixed base, all of whose joints have one coordinate.
        runs: of it.
    """
    model = robot.model
    strength = float(np.linalg.norm(model.opt.gravity))
    joints = _following(robot, runs)
    if strength == 0.0 or len(joints) < MIN_PUSHED_JOINTS or not all(map(robot.turns, range(model.njnt))):
        return None
    poses = [_poses(robot, run, joints) for run in runs]
    held = np.concatenate([_gravity(model, each.measured) for each in poses])
    up = -model.opt.gravity / strength
    places = [_lowest(model, _bodies(robot), each.measured, up) for each in poses]
    goals = [_lowest(model, _bodies(robot), each.goal, up) for each in poses]
    found = []
    for body in _bodies(robot):
        mine, its = [each[body] for each in places], np.concatenate([each[body][0] for each in goals])
        tried = (
            _on_body(robot, body, joints, poses=poses, held=held, places=mine, goals=its, slow=slow)
            for slow in SLOW_SPEEDS
        )
        found += [each for each in tried if each is not None]
    if not found:
        return None
    lowest = min(found, key=lambda each: each.height).body  # what carries it comes to its own lowest with it
    return max((each for each in found if each.body == lowest), key=lambda each: each.seconds)


def _on_body(
    robot: LoggedRobot,
    body: int,
    joints: Mapping[str, int],
    poses: Sequence[_Poses],
    held: Array,
    places: Sequence[tuple[Array, Array]],
    goals: Array,
    slow: float,
) -> Resting | None:
    """Contacts of one body, see :func:`find_resting`.

    Args:
        robot: that was logged.
        body: its number.
        joints: that follow goals, with their coordinates.
        poses: of each run.
        held: torque of gravity on all coordinates (all poses, nv).
        places: height of its lowest point [m] and the change of that with each coordinate, in each run.
        goals: the same height at the goals (all poses,) [m].
        slow: speed below which joints are judged [rad/s].
    """
    model = robot.model
    height, lever = (np.concatenate(part) for part in zip(*places, strict=True))
    carrying = {name: dof for name, dof in joints.items() if np.quantile(np.abs(lever[:, dof]), 0.9) > MIN_HEIGHT_LEVER}
    if len(carrying) < MIN_PUSHED_JOINTS:
        return None
    speed = np.concatenate([each.speed for each in poses])
    judged = np.concatenate([each.on for each in poses])
    judged &= (np.abs(speed[:, list(carrying.values())]) < slow).all(axis=1)
    hinges = [dof for dof in carrying.values() if int(model.jnt_type[model.dof_jntid[dof]]) == HINGE_KIND]
    reach = float(np.abs(lever[:, hinges]).max()) if hinges else float(np.ptp(height))
    lowest = float(np.quantile(height, WRONG_POSE_SHARE))
    clear = judged & (height > lowest + CLEAR_HEIGHT_SHARE * reach)
    period = np.concatenate([np.full(len(each.time), each.period) for each in poses])
    if period[clear].sum() < MIN_CLEAR_SECONDS:
        return None
    error = np.concatenate([each.measured - each.goal for each in poses])
    pushed = np.zeros(len(height), int)
    for dof in carrying.values():
        moves = np.stack([held[:, dof], speed[:, dof], np.tanh(speed[:, dof] / REVERSAL_SPEED)], axis=1)
        pushed += _pushed(error[:, dof], moves, lever[:, dof], clear)
    sinks = np.concatenate([_rate(each.time, h) for (h, _), each in zip(places, poses, strict=True)])
    near = (height < lowest + RESTING_HEIGHT_SHARE * reach) & (goals < height)
    above = near & (sinks < CLEAR_HEIGHT_SHARE * reach)
    sure = above & judged & (pushed >= MIN_PUSHED_JOINTS)
    if _seconds(_stretches(poses, sure, sure)) < MIN_RESTING_SECONDS:
        return None
    # once there is a table, an arm that sags onto it from goals above it rests there as well
    touches = height < np.quantile(height[sure], CONTACT_HEIGHT_QUANTILE) + CONTACT_THICKNESS
    rests = sure | ((above | touches) & (pushed > 0))
    return Resting(
        model.body(body).name or f"body {body}",
        float(np.median(height[sure])),
        float((height - goals)[sure].max()),
        tuple(_carrying(robot, body, poses)),
        _stretches(poses, rests, near | touches),
    )


def _carrying(robot: LoggedRobot, body: int, poses: Sequence[_Poses]) -> list[str]:
    """Logged joints that a body hangs on, the one next to the base first."""
    bodies = set[int]()
    while body > 0:
        bodies.add(body)
        body = int(robot.model.body_parentid[body])
    names = dict.fromkeys(name for each in poses for name in each.joints)
    return [name for name in names if int(robot.model.jnt_bodyid[robot.number(name)]) in bodies]


def _rate(time: Array, values: Array) -> Array:
    """How fast values change (m,); zero of a single one."""
    return np.abs(np.gradient(values, time)) if len(time) > 1 else np.zeros(len(time))


def _pushed(error: Array, moves: Array, lever: Array, clear: np.ndarray) -> np.ndarray:
    """Poses (m,) in which a joint stands where neither gravity and motion nor what else holds it in clear air brings
    it, on the side to which a push from below would.

    Args:
        error: from its goal (m,).
        moves: what that grows with (m, k).
        lever: change of the height with it (m,).
        clear: poses that nothing touches (m,).
    """
    rows = np.column_stack([moves, np.ones(len(moves))])
    left = error - rows @ np.linalg.lstsq(rows[clear], error[clear], rcond=None)[0]
    low, high = np.quantile(left[clear], [HOLDING_TAIL_SHARE, 1.0 - HOLDING_TAIL_SHARE])
    margin = max(PUSH_BEYOND_SHARE * (high - low), MIN_PUSH)
    return (np.abs(lever) > MIN_HEIGHT_LEVER) & np.where(lever > 0.0, left > high + margin, left < low - margin)


Stretches = dict[str, tuple[tuple[float, float], ...]]


def _seconds(stretches: Stretches) -> float:
    return sum(b - a for spans in stretches.values() for a, b in spans)


def _stretches(poses: Sequence[_Poses], rests: np.ndarray, around: np.ndarray) -> Stretches:
    """First and last time of the contacts of each run that has some.

    Args:
        poses: of each run.
        rests: at which something rests for certain (all poses,).
        around: and those next to them at which it rests as well.
    """
    found: Stretches = {}
    first = 0
    for each in poses:
        part = slice(first, first + len(each.time))
        first = part.stop
        if spans := _spans(each.time, rests[part], around[part]):
            found[each.run] = spans
    return found


def _spans(time: Array, rests: np.ndarray, around: np.ndarray) -> tuple[tuple[float, float], ...]:
    found: list[tuple[float, float]] = []
    for a, b in stretches(rests):
        if time[b - 1] - time[a] < MIN_CONTACT_SECONDS:
            continue
        while a > 0 and around[a - 1]:
            a -= 1
        while b < len(time) and around[b]:
            b += 1
        span = (
            max(float(time[a] - CONTACT_MARGIN), float(time[0])),
            min(float(time[b - 1] + CONTACT_MARGIN), float(time[-1])),
        )
        if found and span[0] <= found[-1][1]:
            last = found.pop()
            span = min(last[0], span[0]), max(last[1], span[1])
        found.append(span)
    return tuple(found)


def _following(robot: LoggedRobot, runs: Sequence[MeasuredRun]) -> dict[str, int]:
    """Hinges and slides that follow position goals in every run, with their coordinates."""
    return {
        name: dof
        for name, dof in _turning(robot, runs[0]).items()
        if all(name in run.joints and run.joints[name].goal is not None for run in runs)
    }


def _turning(robot: LoggedRobot, run: MeasuredRun) -> dict[str, int]:
    """Logged joints of one coordinate, with it."""
    numbers = {name: robot.number(name) for name in run.joints}
    return {
        name: int(robot.model.jnt_dofadr[number])
        for name, number in numbers.items()
        if number >= 0 and robot.turns(number)
    }


def _bodies(robot: LoggedRobot) -> list[int]:
    """Those that move."""
    model = robot.model
    return [body for body in range(1, model.nbody) if int(model.body_weldid[body]) != 0]


def _poses(robot: LoggedRobot, run: MeasuredRun, joints: Mapping[str, int]) -> _Poses:
    every = max(round(1.0 / (POSE_RATE * run.period)), 1)
    time = run.time[::every]
    measured, goal, speed = (np.zeros((len(time), robot.model.nv)) for _ in range(3))
    on = np.ones(len(time), bool)
    turning = _turning(robot, run)
    for name, dof in turning.items():
        log, frame, ratio = run.joints[name], robot.frame(name), robot.ratio(name)
        place = frame.to_model(_whole(run.time, log.position)) / ratio
        before, measured[:, dof], after = (
            np.interp(time + side * SPEED_SECONDS, run.time, place) for side in (-0.5, 0.0, 0.5)
        )
        speed[:, dof] = (after - before) / SPEED_SECONDS
        goal[:, dof] = measured[:, dof]
        if name in joints and log.goal is not None:
            goal[:, dof] = frame.to_model(_whole(run.time, log.goal)[::every]) / ratio
            on &= np.ones(len(time), bool) if log.enabled is None else log.enabled[::every] > 0.5
    return _Poses(
        run.name,
        joints=tuple(turning),
        period=every * run.period,
        time=time,
        measured=measured,
        goal=goal,
        speed=speed,
        on=on,
    )


def _whole(time: Array, values: Array) -> Array:
    good = np.isfinite(values)
    return values if good.all() else np.interp(time, time[good], values[good])


def _gravity(model: mujoco.MjModel, positions: Array) -> Array:
    """Torque of gravity on all coordinates at rest (m, nv) [N.m or N]."""
    data, out = mujoco.MjData(model), np.empty((len(positions), model.nv))
    for k, position in enumerate(positions):
        data.qpos[:] = position
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        out[k] = -data.qfrc_bias
    return out


def _lowest(
    model: mujoco.MjModel, bodies: Sequence[int], positions: Array, up: Array
) -> dict[int, tuple[Array, Array]]:
    """Height of the lowest known point of each body (m,) [m], and its change with each coordinate (m, nv)."""
    surfaces = {body: _surface(model, body) for body in bodies}
    found = {body: (np.empty(len(positions)), np.empty((len(positions), model.nv))) for body in bodies}
    data, rows = mujoco.MjData(model), np.zeros((3, model.nv))
    for k, position in enumerate(positions):
        data.qpos[:] = position
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        for body, (points, radii) in surfaces.items():
            places = data.xpos[body] + points @ data.xmat[body].reshape(3, 3).T
            heights = places @ up - radii
            point = int(np.argmin(heights))
            mujoco.mj_jac(model, data, rows, None, places[point], body)
            found[body][0][k], found[body][1][k] = heights[point], up @ rows
    return found


def _surface(model: mujoco.MjModel, body: int) -> tuple[Array, Array]:
    """Points on a body (p, 3) in its frame, each the middle of a ball of a radius (p,); where the model has no shapes,
    its sites and centres.
    """
    points, radii = [], []
    for geom in range(model.ngeom):
        if int(model.geom_bodyid[geom]) != body:
            continue
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        own, radius = _corners(model, geom)
        points.append(model.geom_pos[geom] + own @ turn.reshape(3, 3).T)
        radii.append(np.full(len(own), radius))
    if not points:
        sites = [model.site_pos[site] for site in range(model.nsite) if int(model.site_bodyid[site]) == body]
        points = [np.array([*sites, np.zeros(3), centre_of(model, body)])]
        radii = [np.zeros(len(points[0]))]
    return np.concatenate(points), np.concatenate(radii)


def _corners(model: mujoco.MjModel, geom: int) -> tuple[Array, float]:
    """Points of a shape in its frame (p, 3), and the radius of the balls around them."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    kinds = mujoco.mjtGeom
    if kind == kinds.mjGEOM_SPHERE:
        return np.zeros((1, 3)), float(size[0])
    if kind == kinds.mjGEOM_CAPSULE:
        return np.array([[0.0, 0.0, -size[1]], [0.0, 0.0, size[1]]]), float(size[0])
    if kind == kinds.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        vertices = model.mesh_vert[first : first + count]
        return vertices[np.unique((vertices @ _ways().T).argmax(axis=0))].astype(float), 0.0
    if kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_ELLIPSOID):
        size = np.array([size[0], size[0], size[1]]) if kind == kinds.mjGEOM_CYLINDER else size
        ways = _ways()
        if kind == kinds.mjGEOM_CYLINDER:  # of its rims
            flat = np.linalg.norm(ways[:, :2], axis=1, keepdims=True)
            rim = np.divide(ways[:, :2], flat, out=np.zeros_like(ways[:, :2]), where=flat > 0.0)
            ways = np.column_stack([rim, np.where(ways[:, 2] < 0.0, -1.0, 1.0)])
        return ways * size, 0.0
    return np.array(np.meshgrid(*([-1.0, 1.0],) * 3)).reshape(3, -1).T * size, 0.0  # a box


def _ways() -> Array:
    """Directions (98, 3) spread over a ball."""
    grid = np.array(np.meshgrid(*([-2.0, -1.0, 0.0, 1.0, 2.0],) * 3)).reshape(3, -1).T
    edge = grid[np.abs(grid).max(axis=1) == 2.0]
    return edge / np.linalg.norm(edge, axis=1, keepdims=True)
