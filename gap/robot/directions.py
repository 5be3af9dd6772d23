"""What a body, a payload or the base does to the load of each joint, per unit of a number of the robot.

The load of a joint is linear in masses and inertias of the bodies, and nearly so in where their centres are and in how
little the base is tilted. So a number of the robot adds its size times rows of its own to the terms of every joint.
What compensates the weight of bodies (``gravcomp``) was computed of the robot as believed, and changes with none of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from ..load.robot import LoggedRobot
from ..load.tree import DERIVATIVE_STEP, NO_SAME_FRAME, Motion, block_along, carries, least_payload, tip_behind
from ..log.types import Array, MeasuredRun
from ..replay.parameters import Parameter
from ..search.settings import DEFAULT

ABOUT_JOINTS = "robot.about_joints"
"""Number that says how much of mass times distance squared the file's inertias have too much."""
ROW_RATE = 200.0  # [Hz] at which rows are computed; between them they are straight lines
DERIVATIVE_SHIFT = 1e-3  # [m] over which derivatives are taken
TILT_PARAMETERS = tuple(Parameter(f"base.tilt_{axis}", "rad", -0.5, 0.5, 0.0, 0.01) for axis in "xy")
"""How far the base is tilted about either axis."""


@dataclass(frozen=True, eq=False)
class Direction:
    """One number of a robot that all its joints may feel.

    Attributes:
        parameter: the number: ``body.<name>.mass_factor`` or the like, of :mod:`sealegs.envs.described.robot_numbers`.
        neutral: its value where the model is right.
        change: model before and after, and by how much the number differs between them.
        parts: names of what it changes: a body, the base, or joints.
        effect: what it changes of each, such as ``body.mass_factor``.
    """

    parameter: Parameter
    neutral: float
    change: Callable[[], tuple[mujoco.MjModel | None, mujoco.MjModel, float]]
    parts: tuple[str, ...]
    effect: str

    @property
    def number(self) -> str:
        """The number that it turns."""
        return self.parameter.number

    @property
    def body(self) -> str:
        """Name of the body whose mass, or its centre, it changes; empty where it is none's."""
        return self.parts[0] if self.effect.startswith("body.") else ""


def rows_of(
    direction: Direction, robot: LoggedRobot, joint: str, runs: Sequence[MeasuredRun], motions: Sequence[Motion]
) -> list[Array] | None:
    """What the number adds to the terms of a joint in each run, per unit (samples, T_SIZE); None where nothing."""
    number, sign = robot.number(joint), robot.frame(joint).sign
    if direction.body and not carries(robot.model, number, robot.model.body(direction.body).id):
        return None
    before, after, by = direction.change()
    found = []
    for run, whole in zip(runs, motions, strict=True):
        every = max(round(1.0 / (ROW_RATE * run.period)), 1)
        at = np.unique(np.append(np.arange(0, len(run.time), every), len(run.time) - 1))
        motion = Motion(whole.position[at], whole.speed[at], whole.acceleration[at])
        rows = block_along(after, number, motion, sign)
        if before is not None:
            rows = rows - block_along(before, number, motion, sign)
        samples = np.arange(len(run.time))
        found.append(np.stack([np.interp(samples, at, column) for column in (rows / by).T], axis=1))
    return found if max(float(np.abs(rows).max()) for rows in found) > 1e-9 else None


# --- which numbers there are ---------------------------------------------------------------------------------------


def payload(robot: LoggedRobot, joint: str) -> Direction | None:
    """Something carried at the end of the robot behind a joint."""
    tip = tip_behind(robot.model, robot.number(joint))
    name = robot.model.body(tip.body).name
    if not name:
        return None

    def change() -> tuple[None, mujoco.MjModel, float]:
        other = _empty(robot.model)
        _weigh(other, tip.body, 1.0, tip.point, np.zeros(3))
        return None, other, 1.0

    mass, least = _whole(robot.model), least_payload(robot.model, tip)
    parameter = Parameter(f"body.{name}.payload", "kg", least, 5.0 * mass, 0.0, 0.05 * mass)
    return Direction(parameter, 0.0, change, (name,), "body.payload")


def masses(robot: LoggedRobot, light: float = DEFAULT.light_body) -> Iterator[Direction]:
    """The mass of each body that is more than a small part (``light``) of the robot."""
    for body in _heavy(robot.model, light):

        def change(body: int = body) -> tuple[None, mujoco.MjModel, float]:
            model, other = robot.model, _empty(robot.model)
            _weigh(other, body, model.body_mass[body], model.body_ipos[body], model.body_inertia[body])
            return None, other, 1.0

        name = robot.model.body(body).name
        parameter = Parameter(f"body.{name}.mass_factor", "1", 0.2, 6.0, 1.0, 0.1, logarithmic=True)
        yield Direction(parameter, 1.0, change, (name,), "body.mass_factor")


def centres(robot: LoggedRobot, light: float = DEFAULT.light_body) -> Iterator[tuple[str, tuple[Direction, ...]]]:
    """The centre of mass of each such body, along the axes of its frame, by its name."""
    for body in _heavy(robot.model, light):
        name = robot.model.body(body).name
        yield name, tuple(_centre(robot.model, body, name, axis) for axis in range(3))


def _centre(model: mujoco.MjModel, body: int, name: str, axis: int) -> Direction:
    key = f"centre_{'xyz'[axis]}"

    def change() -> tuple[mujoco.MjModel, mujoco.MjModel, float]:
        ends = []
        for way in (
            -DERIVATIVE_SHIFT,
            DERIVATIVE_SHIFT,
        ):  # to both sides: the effect of a shift on inertia is quadratic
            ends.append(_uncompensated(model))
            ends[-1].body_ipos[body, axis] += way
            ends[-1].body_sameframe[body] = NO_SAME_FRAME
        return ends[0], ends[1], 2.0 * DERIVATIVE_SHIFT

    parameter = Parameter(f"body.{name}.{key}", "m", -0.15, 0.15, 0.0, 0.005)
    return Direction(parameter, 0.0, change, (name,), f"body.{key}")


def tilt(robot: LoggedRobot) -> tuple[Direction, Direction]:
    """The base does not stand level."""
    return _tilt(robot.model, 0), _tilt(robot.model, 1)


def _tilt(model: mujoco.MjModel, axis: int) -> Direction:
    def change() -> tuple[mujoco.MjModel, mujoco.MjModel, float]:
        before, other = _uncompensated(model), _uncompensated(model)
        x, y, z = (float(part) for part in model.opt.gravity)
        c, s = math.cos(DERIVATIVE_STEP), math.sin(DERIVATIVE_STEP)
        other.opt.gravity[:] = (x, c * y + s * z, c * z - s * y) if axis == 0 else (c * x - s * z, y, s * x + c * z)
        return before, other, DERIVATIVE_STEP

    return Direction(TILT_PARAMETERS[axis], 0.0, change, ("base",), f"tilt_{'xy'[axis]}")


def about_joints(robot: LoggedRobot) -> Direction | None:
    """Inertias that the model file gives about the joints instead of the centres of mass: 1 where it does.

    None where for no body that could be: what is given about a joint is at least mass times distance squared.
    """
    model = robot.model
    found = too_much(model)
    if not found:
        return None

    def change() -> tuple[None, mujoco.MjModel, float]:
        other = _empty(model)
        for number, (inertia, quaternion) in found.items():
            body = int(model.jnt_bodyid[number])
            other.body_inertia[body], other.body_iquat[body] = inertia, quaternion
        return None, other, -1.0

    joints = tuple(robot.column(number) for number in found)
    parameter = Parameter(ABOUT_JOINTS, "1", -0.5, 1.5, 0.0, 0.2)
    return Direction(parameter, 0.0, change, joints, "load.about_joint")


def every(robot: LoggedRobot) -> dict[str, Direction]:
    """All numbers of a robot that its joints may feel, however light the body is."""
    driven = [joint.name for joint in robot.file.joints if robot.number(joint.name) >= 0]
    found = [payload(robot, joint) for joint in driven]
    found += [*masses(robot, 0.0), *(one for _, group in centres(robot, 0.0) for one in group), *tilt(robot)]
    return {one.number: one for one in (*found, about_joints(robot)) if one is not None}


def too_much(model: mujoco.MjModel) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """By joint whose body's inertia may be given about it: mass times distance squared as principal inertia (3,) and
    axes (4,).
    """
    found: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    for number in range(model.njnt):
        body = int(model.jnt_bodyid[number])
        away = np.array(model.body_ipos[body] - model.jnt_pos[number])
        size = float(np.linalg.norm(away))
        if size < 1e-6 or int(model.body_jntnum[body]) != 1:
            continue
        more = float(model.body_mass[body]) * size**2
        least = float(np.sort(model.body_inertia[body])[1])  # of what is across the arm
        if 0.0 < more < least:
            quaternion = np.zeros(4)
            mujoco.mju_quatZ2Vec(quaternion, away / size)
            found[number] = np.array([more, more, 0.0]), quaternion
    return found


def _whole(model: mujoco.MjModel) -> float:
    return float(model.body_mass[model.body_weldid > 0].sum())


def _heavy(model: mujoco.MjModel, light: float) -> list[int]:
    least = light * _whole(model)
    return [
        b for b in range(1, model.nbody) if model.body_weldid[b] and model.body_mass[b] > least and model.body(b).name
    ]


def _uncompensated(model: mujoco.MjModel) -> mujoco.MjModel:
    """The robot without what compensates the weight of its bodies, which the engine would change with them."""
    other = model.__copy__()
    other.body_gravcomp[:] = 0.0
    return other


def _empty(model: mujoco.MjModel) -> mujoco.MjModel:
    """The robot without any mass, and without springs, armature and damping of its joints, which are no body's."""
    other = _uncompensated(model)
    other.body_sameframe[:] = NO_SAME_FRAME
    other.dof_armature[:] = other.dof_damping[:] = 0.0
    other.jnt_stiffness[:] = other.jnt_stiffnesspoly[:] = 0.0
    other.opt.density = other.opt.viscosity = 0.0  # what a fluid takes hangs on shapes, not on masses
    other.body_mass[:] = other.body_inertia[:] = other.body_subtreemass[:] = 0.0
    return other


def _weigh(model: mujoco.MjModel, body: int, mass: float, centre: np.ndarray, inertia: np.ndarray) -> None:
    """Give one body of an empty robot its mass."""
    model.body_mass[body], model.body_ipos[body], model.body_inertia[body] = mass, centre, inertia
    while body > 0:
        model.body_subtreemass[body] = mass
        body = int(model.body_parentid[body])
    model.body_subtreemass[0] = mass
