"""How the base of a robot on legs must turn, from its joints alone: they move as measured, and it stands on them.

Nothing that an IMU says is used, so that the IMU can be held against it. A joint is so heavy that only the force which
makes it follow its path can move it, as in :mod:`sealegs.gap.ground.tree_replay`.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ...common.errors import SealegsError
from ...envs.engine.base import BaseLayout
from ...envs.engine.model_poses import in_turn, place_followers, stand
from ...envs.engine.robot import Robot
from ...envs.engine.turns import projected_gravity
from ..checks.signal import derivatives
from ..load.robot import Frame
from ..log.parts import SPEED_REACH
from ..log.types import Array, MeasuredRun
from .pieces import WITHOUT_END, made_heavy
from .tree_model import PLANE, touching
from .tree_replay import shares

SETTLING_SECONDS, SPEED_UP_SECONDS = 0.5, 0.2  # that it settles in its first pose, and in which motion then sets in
FALLEN_ANGLE = 0.7  # [rad] from upright: what it does then, its legs do not tell


@dataclass(frozen=True, eq=False)
class Carried:
    """How a base turns, in the axes of the model.

    Attributes:
        time: of the run, as far as it stands (n,) [s].
        orientation: quaternion (n, 4).
    """

    time: Array
    orientation: Array


def carried(robot: Robot, run: MeasuredRun, frames: dict[str, Frame]) -> Carried | None:
    """The base over a run; None where it has no floor or feet to stand on, or its joints were not all logged."""
    names = [item.name for item in robot.coordinates]
    if any(name not in run.joints for name in names):
        return None
    try:
        drivetrain = robot.drivetrain(None, run.robot_params)
    except SealegsError:
        return None
    model = drivetrain.model
    place = BaseLayout.of_model(model, range(model.njnt)).base
    floors = [k for k in range(model.ngeom) if int(model.geom_type[k]) == PLANE]
    if place is None or not floors:
        return None
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    model.opt.cone, model.opt.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, max(model.opt.impratio, 10.0)
    joints, motors = shares([drivetrain.terms(name) for name in names])
    step = float(model.opt.timestep)
    clock, angles = _paths(run, names, frames, step)
    position = angles @ motors.T
    moved = np.diff(position, axis=0, prepend=position[:1]) / step  # as the engine integrates: a speed first
    dofs = made_heavy(model, joints)
    places = [int(model.joint(name).qposadr[0]) for name in joints]
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)  # a foot bears on the floor with the whole robot, not as its own light body
    stand(model, robot.pose, data.qpos)
    data.qpos[places] = position[0]
    place_followers(model, in_turn(model), data.qpos)
    if not _put_down(model, data, floors[0], place[0]):
        return None
    upright = projected_gravity(np.array(data.qpos[place[0] + 3 : place[0] + 7]))
    turned = np.empty((len(clock), 4))
    for k in range(len(clock)):
        data.qpos[places], data.qvel[dofs] = position[k], moved[k]
        turned[k] = data.qpos[place[0] + 3 : place[0] + 7]
        if not np.isfinite(turned[k]).all() or projected_gravity(turned[k]) @ upright < np.cos(FALLEN_ANGLE):
            break
        if k + 1 < len(clock):
            data.qfrc_applied[dofs] = WITHOUT_END * (moved[k + 1] - moved[k]) / step
            mujoco.mj_step(model, data)
    else:
        k += 1
    kept = slice(int(np.searchsorted(clock[:k], run.time[0] + SPEED_UP_SECONDS)), k)
    return Carried(clock[kept], turned[kept])


def _paths(run: MeasuredRun, names: list[str], frames: dict[str, Frame], step: float) -> tuple[Array, Array]:
    """Times of the run at steps of the engine, and the coordinates there (n, k), behind a rest in the first pose."""
    span = float(run.time[-1] - run.time[0])
    since = np.arange(-SETTLING_SECONDS, span, step)
    # the time of the run passes by and by: still at first, then ever faster, then as it did
    ramp = np.clip(since, 0.0, SPEED_UP_SECONDS)
    passed = np.where(since < SPEED_UP_SECONDS, 0.5 * ramp**2 / SPEED_UP_SECONDS, since - 0.5 * SPEED_UP_SECONDS)
    clock = run.time[0] + passed
    columns = []
    for name in names:
        frame, log = frames.get(name, Frame()), run.joints[name]
        good = np.isfinite(log.position)
        values = frame.to_model(np.interp(run.time, run.time[good], log.position[good]))
        smooth, rate, _ = derivatives(run.time, values, SPEED_REACH)
        columns.append(CubicHermiteSpline(run.time, smooth, rate)(clock))
    return clock, np.stack(columns, axis=1)


def _put_down(model: mujoco.MjModel, data: mujoco.MjData, floor: int, base: int) -> bool:
    """Set the robot onto its floor; whether there is anything that can stand on it."""
    mujoco.mj_kinematics(model, data)
    touch = touching(model, floor)
    nearest = min((mujoco.mj_geomDistance(model, data, floor, geom, 10.0, None) for geom in touch), default=np.inf)
    if not np.isfinite(nearest):
        return False
    data.qpos[base + 2] -= nearest
    return True
