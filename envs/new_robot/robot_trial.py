"""A short simulation of a robot that was just put together: whether it breaks though hardly anything moves it."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator

import mujoco
import numpy as np

from ...common.errors import SealegsError
from ..any_robot.reach import ReachTask
from ..described.as_robot import as_robot
from ..described.robot_assembly import WARNING, between_actions
from ..described.robot_described import RobotFile
from ..described.robot_step import SHORTEST, engine_number, said_again, weak
from ..engine.batch import BatchEngine

ACTIONS = 25  # control steps at rest, as many with goals aside, anywhere, and at the ends of ranges
HOLDS = 5  # control steps for which goals stay at such ends, so that joints get there
ASIDE = 0.1  # of half a range that goals go aside: a motion that any robot survives; assumed
FAR = 100.0  # half ranges from the middle of its own at which a joint has flown off
HALVINGS = 2  # of the step, for a robot that breaks; assumed
WORDS = ("at rest", "of a small motion", "of goals anywhere in its ranges", "of goals at the ends of its ranges")
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
    lasted, trouble = tried(robot)
    if not trouble:
        return robot
    where = robot.model.path.name
    before, best, left = f"{where}: the simulation steps by ", robot, trouble
    for other in _others(robot):
        try:
            longer, found = tried(other)
        except SealegsError:  # a chain that this step makes unstable
            continue
        if longer > lasted:
            lasted, best, left = longer, other, found
        if not found:
            break
    said = robot.said
    if best is not robot:
        weaker = ", and assumed servos of a quarter of their stiffness" if best.joints is not robot.joints else ""
        since = f"since at {1e3 * robot.timestep:g} ms with {robot.integrator} {trouble}"
        said = tuple(
            sentence for sentence in said_again(said, robot.joints, best.joints) if not sentence.startswith(before)
        )
        said = (*said, f"{before}{1e3 * best.timestep:g} ms, with {best.integrator}{weaker}, {since}.")
    if left:
        sentence = (
            f"{WARNING}{where}: a short trial of the simulation breaks at any step and integrator that was tried: "
        )
        said = (*said, f"{sentence}{left}; look for a light body, a stiff spring or bodies that touch there.")
    return dataclasses.replace(best, said=said)


def _others(robot: RobotFile) -> Iterator[RobotFile]:
    """The robot with other steps and integrators, the file's own among them, and with weaker servos."""
    option = robot.model.spec().option
    names = {engine_number(name): name for name in ("Euler", "implicit", "RK4")}
    rows = [
        (robot.timestep, "implicitfast"),
        (between_actions(float(option.timestep)), names.get(int(option.integrator), "implicitfast")),
    ]
    for step, integrator in rows:
        yield dataclasses.replace(robot, timestep=step, integrator=integrator)
    weaker = tuple(weak(joint, 0.25, robot.timestep, robot.integrator) for joint in robot.joints)
    if weaker != robot.joints:
        yield dataclasses.replace(robot, joints=weaker)
    for k in range(1, HALVINGS + 1):
        for integrator in ("RK4", "implicitfast"):
            if (step := robot.timestep / 2.0**k) >= SHORTEST:
                yield dataclasses.replace(robot, timestep=step, integrator=integrator)


def tried(robot: RobotFile) -> tuple[int, str]:
    """How many control steps a simulation lasts, and what breaks then, as a phrase; empty: nothing.

    The robot rests, moves a little, and then follows goals anywhere in its ranges, as in the first steps of a training.

    Raises:
        SealegsError: it cannot be simulated at all.
    """
    task = ReachTask.on(as_robot(robot))(start_noise=0.0)
    engine = BatchEngine(task, 1, autoreset=False)
    engine.seed(0)
    engine.reset()
    rest, random = (task.centre - engine.goal_centre) / engine.goal_half, np.random.default_rng(0)
    aside, ends = rest + np.where(rest > 0.0, -ASIDE, ASIDE), rest
    with _quiet():
        for count in range(len(WORDS) * ACTIONS):
            stage = count // ACTIONS
            if count % HOLDS == 0:
                ends = random.choice([-1.0, 1.0], len(rest))
            step = engine.step((rest, aside, random.uniform(-1.0, 1.0, len(rest)), ends)[stage][None])
            when = f"after {(count + 1) * engine.dt:.2g} s, {WORDS[stage]}"
            if step.flags["unstable"][0]:
                return count, f"{_bad(engine)} is beyond all bounds {when}"
            away = np.abs(engine.motion(engine.batch.bind("ctrl")).link[0] - engine.goal_centre) / engine.goal_half
            if not away.max() < FAR:
                return count, f"joint {engine.names[int(away.argmax())]} has flown off {when}"
    return len(WORDS) * ACTIONS, ""


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep the engine from printing, and from writing a file of its own, what is told in a sentence."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


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
