"""Short simulations of a robot that was just put together: whether one breaks though hardly anything moves it."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator

import mujoco
import numpy as np

from ...common.errors import WARNING, SealegsError
from ..any_robot.reach import ReachTask
from ..described.as_robot import as_robot
from ..described.robot_described import RobotFile
from ..described.robot_file import between_actions
from ..described.robot_step import SHORTEST, engine_number, said_again, weak
from ..engine.batch import BatchEngine
from ..engine.model_poses import NEAR, Loops, in_turn, place_followers

EPISODES = 64  # side by side, with goals of their own: what breaks in one of twenty shows
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


class _Trial(ReachTask):
    """Goals of any kind; what they are worth does not count."""

    takes_speeds = True


def steady(robot: RobotFile) -> RobotFile:
    """The robot with a step and an integrator that a short simulation survives, or with a warning that none does.

    Raises:
        SealegsError: it cannot be simulated at all.
    """
    robot = dataclasses.replace(robot, said=(*robot.said, *_loops(robot)))
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


def _loops(robot: RobotFile) -> list[str]:
    """How far the closed loops of a robot are open where the file has them, and whether they close."""
    task = _Trial.on(as_robot(robot))(start_noise=0.0)
    drivetrain = task.robot.drivetrain()
    if (loops := Loops.of(drivetrain)) is None:
        return []
    qpos = np.array(drivetrain.model.qpos0)[None].copy()
    task.place(drivetrain, {}, np.zeros((1, task.draws)), qpos, np.zeros((1, drivetrain.model.nv)))
    place_followers(drivetrain.model, in_turn(drivetrain.model), qpos)
    before, where = loops.open(qpos[0]), robot.model.path.name
    after = loops.close(qpos[0])
    if after > NEAR:
        return [
            f"{WARNING}{where}: the loops that welds and connects close stay open by {1e3 * after:.2g} mm or mrad "
            "where episodes start, whatever its joints do; correct their anchors, or start its joints elsewhere."
        ]
    if before > NEAR:
        return [
            f"{where}: the loops that welds and connects close are open by {1e3 * before:.2g} mm or mrad in the file; "
            "episodes start with them closed."
        ]
    return []


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
    """How many control steps simulations last, on average, and what breaks first, as a phrase; empty: nothing.

    Many robots rest, move a little, and then follow goals anywhere in their ranges, as a training begins.

    Raises:
        SealegsError: it cannot be simulated at all.
    """
    task = _Trial.on(as_robot(robot))(start_noise=0.0)
    engine = BatchEngine(task, EPISODES, autoreset=False)
    engine.seed(0)
    engine.reset()
    shape, random = (EPISODES, len(engine.names)), np.random.default_rng(0)
    rest = np.broadcast_to((task.centre - engine.goal_centre) / engine.goal_half, shape)
    aside, ends = rest + np.where(rest > 0.0, -ASIDE, ASIDE), rest
    lasted, first = np.full(EPISODES, len(WORDS) * ACTIONS), ""
    with _quiet():
        for count in range(len(WORDS) * ACTIONS):
            stage = count // ACTIONS
            if count % HOLDS == 0:
                ends = random.choice([-1.0, 1.0], shape)
            step = engine.step((rest, aside, random.uniform(-1.0, 1.0, shape), ends)[stage])
            away = np.abs(engine.motion(engine.batch.bind("ctrl")).link - engine.goal_centre) / engine.goal_half
            flown = ~(away.max(axis=1) < FAR)
            broken = (step.flags["unstable"] | flown) & (lasted > count)
            lasted[broken] = count
            if broken.any() and not first:
                first = _said(engine, int(np.flatnonzero(broken)[0]), away, (count + 1) * engine.dt, WORDS[stage])
    failed = int((lasted < len(WORDS) * ACTIONS).sum())
    said = f"{first}, in {failed} of {EPISODES} episodes" if 0 < failed < EPISODES else first
    return round(float(lasted.mean())), said


def _said(engine: BatchEngine, simulation: int, away: np.ndarray, time: float, word: str) -> str:
    """What broke in a simulation, and when [s], as a phrase."""
    when = f"after {time:.2g} s, {word}"
    if engine.batch.warning[simulation, list(BAD), 1].any():
        return f"{_bad(engine, simulation)} is beyond all bounds {when}"
    return f"joint {engine.names[int(away[simulation].argmax())]} has flown off {when}"


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep the engine from printing, and from writing a file of its own, what is told in a sentence."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def _bad(engine: BatchEngine, simulation: int) -> str:
    """What the engine found too large, and of which joint."""
    model, warnings = engine.drivetrain.model, engine.batch.warning[simulation]
    for warning, what in BAD.items():
        number, times = (int(value) for value in warnings[warning])
        if times:
            first = model.jnt_qposadr if what == "position" else model.jnt_dofadr
            joint = model.joint(int(np.searchsorted(first, number, side="right")) - 1).name
            return f"the {what} of {f'joint {joint}' if joint else 'a joint without a name'}"
    return "the state"
