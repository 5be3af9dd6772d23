"""A short simulation of a robot that was just put together: whether it breaks though hardly anything moves it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import mujoco
import numpy as np

from ..actuators.errors import SealegsError
from .any_robot.reach import ReachTask
from .batch import BatchEngine
from .robot_assembly import WARNING, between_actions
from .robot_described import RobotFile
from .robot_step import SHORTEST

ACTIONS = 25  # control steps at rest, and as many with goals aside
ASIDE = 0.1  # of half a range that goals go aside: a motion that any robot survives; assumed
FAR = 100.0  # half ranges from the middle of its own at which a joint has flown off
HALVINGS = 2  # of the step, for a robot that breaks; assumed
BAD = {
    int(mujoco.mjtWarning.mjWARN_BADQPOS): "position",
    int(mujoco.mjtWarning.mjWARN_BADQVEL): "speed",
    int(mujoco.mjtWarning.mjWARN_BADQACC): "acceleration",
}
"""What goes beyond the engine's bounds before it starts a simulation anew."""


def steady(robot: RobotFile) -> RobotFile:
    """The robot with a step and an integrator that a short simulation survives, or with a warning that none does.

    Raises:
        SealegsError: it cannot be simulated at all.
    """
    if not (trouble := broken(robot)):
        return robot
    where = robot.model.path.name
    before = f"{where}: the simulation steps by "
    for step, integrator in _others(robot):
        other = dataclasses.replace(robot, timestep=step, integrator=integrator)
        try:
            if broken(other):
                continue
        except SealegsError:  # a chain that this step makes unstable
            continue
        sentence = f"{before}{1e3 * step:g} ms, with {integrator}, since at {1e3 * robot.timestep:g} ms with "
        sentence += f"{robot.integrator} {trouble}."
        return dataclasses.replace(other, said=(*(s for s in robot.said if not s.startswith(before)), sentence))
    sentence = (
        f"{WARNING}{where}: a short trial of the simulation breaks at any step and integrator that was tried: "
        f"{trouble}; look for a light body, a stiff spring or bodies that touch there before you train."
    )
    return dataclasses.replace(robot, said=(*robot.said, sentence))


def _others(robot: RobotFile) -> Iterator[tuple[float, str]]:
    """Steps [s] and integrators to try instead, the file's own among them."""
    option = robot.model.spec().option
    names = {int(getattr(mujoco.mjtIntegrator, f"mjINT_{name.upper()}")): name for name in ("Euler", "implicit", "RK4")}
    yield robot.timestep, "implicitfast"
    yield between_actions(float(option.timestep)), names.get(int(option.integrator), "implicitfast")
    for k in range(1, HALVINGS + 1):
        for integrator in ("implicitfast", "RK4"):
            if (step := robot.timestep / 2.0**k) >= SHORTEST:
                yield step, integrator


def broken(robot: RobotFile) -> str:
    """What breaks in a simulation of a robot at rest, or with goals that hardly move, as a phrase; empty: nothing.

    Raises:
        SealegsError: it cannot be simulated at all.
    """
    task = ReachTask.on(robot.robot())(start_noise=0.0)
    engine = BatchEngine(task, 1, autoreset=False)
    engine.seed(0)
    engine.reset()
    rest = (task.centre - engine.goal_centre) / engine.goal_half
    for count in range(2 * ACTIONS):
        moves = count >= ACTIONS
        aside = np.where(rest > 0.0, -ASIDE, ASIDE) if moves else 0.0
        step = engine.step((rest + aside)[None])
        when = f"after {(count + 1) * engine.dt:.2g} s {'of a small motion' if moves else 'at rest'}"
        if step.flags["unstable"][0]:
            return f"{_bad(engine)} is beyond all bounds {when}"
        away = np.abs(engine.motion(engine.batch.bind("ctrl")).link[0] - engine.goal_centre) / engine.goal_half
        if not away.max() < FAR:
            return f"joint {engine.names[int(away.argmax())]} has flown off {when}"
    return ""


def _bad(engine: BatchEngine) -> str:
    """What the engine found too large, and of which joint."""
    model, warnings = engine.drivetrain.model, engine.batch.warning[0]
    for warning, what in BAD.items():
        number, times = (int(value) for value in warnings[warning])
        if times:
            first = model.jnt_qposadr if what == "position" else model.jnt_dofadr
            joint = model.joint(int(np.searchsorted(first, number, side="right")) - 1).name
            return f"the {what} of {f'joint {joint}' if joint else 'a joint without a name'}"
    return "the state"
