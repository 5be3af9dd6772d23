"""Policies, or the bare references that they correct, at their tasks from starts that no training has seen."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from sealegs.actuators.gravity import GRAVITY
from sealegs.envs import ENVIRONMENTS
from sealegs.envs.arm.kinematics import tool
from sealegs.envs.arm.tables import JOINTS
from sealegs.envs.biped.env import FORWARD, PITCH, TOUCH, UP, sole_places
from sealegs.envs.contract import task_of
from sealegs.envs.engine.batch import BatchEngine
from sealegs.envs.hexapod.robot import total_mass

Act = Callable[[np.ndarray], np.ndarray]
Seeds = int | Sequence[int]
MILLIMETRE = 1e-3
FOOT_STARTS, FOOT_SETTLED, FOOT_SECONDS, FOOT_SEED = 64, 0.2, 4.0, 1000  # of the leg's path; times in [s]
TOOL_STARTS, TOOL_STEPS, TOOL_SEED = 16, 500, 10_000  # of the arm's line, which takes 5 s
STARTS, SECONDS, SEED = 16, 60.0, 30_000  # of bipeds, and how long each attempt is to last [s]
HIGH = 0.005  # [m] that both soles must leave the floor by in a hop; lower, they may have bounced
EPISODES, START, WINDOW, WALK_SEED = 4, 12.0, 36.0, 1000  # of hexapods; [s] two cycles of the reference gait, then six
SPEED = 0.03  # [m/s] of the hexapod's reference gait
COMMANDED = 1.01 * SPEED  # [m/s] of policies, so that none is slower than the reference gait is when it slips a little


def begin(env: dict[str, Any], actuator: Any, starts: int, seed: Seeds) -> BatchEngine:
    """Simulations of an environment that have not begun, on one thread."""
    task, options = task_of(env)
    engine = BatchEngine(task, starts, **{**options, "actuator": actuator}, autoreset=False, threads=1)
    engine.seed(seed)
    return engine


def still(number: int) -> Act:
    """So many actions of 0, whatever is seen: what is corrected, with nobody to correct it."""
    return lambda seen: np.zeros((len(seen), number))


def hopper_rewards(env: dict[str, Any], actuator: Any, act: Act, starts: int, seed: Seeds) -> tuple[Any, Any]:
    """Reward of an episode (n,), which is over with a fall, and who is upright at its end (n,)."""
    engine = begin(env, actuator, starts, seed)
    seen, rewards, upright = engine.reset(), np.zeros(starts), np.ones(starts, bool)
    for _ in range(ENVIRONMENTS["Hopper"]):
        step = engine.step(act(seen))
        seen, rewards = step.observation, rewards + np.where(upright, step.reward, 0.0)
        upright &= ~step.terminated
    return rewards, upright


def foot_errors(
    env: dict[str, Any], actuator: Any, act: Act, starts: int = FOOT_STARTS, seed: Seeds = FOOT_SEED
) -> tuple[np.ndarray, np.ndarray]:
    """Distance of a leg's foot from its path at each control step after the first (m, n) [mm], and rewards (n,)."""
    engine = begin(env, actuator, starts, seed)
    task: Any = engine.task
    seen, found, rewards = engine.reset(), [], np.zeros(starts)
    for _ in range(round(FOOT_SECONDS / engine.dt)):
        step = engine.step(act(seen))
        seen, rewards = step.observation, rewards + step.reward
        found.append(task.error(engine.motion(np.zeros((starts, 3)))))
    return np.array(found)[round(FOOT_SETTLED / engine.dt) :] / MILLIMETRE, rewards


def tool_errors(
    env: dict[str, Any], actuator: Any, act: Act, starts: int = TOOL_STARTS, seed: Seeds = TOOL_SEED
) -> tuple[np.ndarray, np.ndarray]:
    """Distance of an arm's tool from its place at each control step (m, n) [mm], and rewards (n,)."""
    engine = begin(env, actuator, starts, seed)
    task: Any = engine.task
    seen, places = engine.reset(), engine.batch.bind("qpos")
    errors, rewards = np.empty((TOOL_STEPS, starts)), np.zeros(starts)
    for k in range(TOOL_STEPS):
        step = engine.step(act(seen))
        seen, rewards = step.observation, rewards + step.reward
        angles = np.stack([engine.drivetrain.position(name, places, "link") for name in JOINTS], axis=-1)
        wanted, _, _ = task.wanted(np.array([(k + 1) * engine.dt]), np.full((1, 1), 5.0), engine.numbers)
        errors[k] = np.linalg.norm(tool(angles) - tool(wanted), axis=1) / MILLIMETRE
    return errors, rewards


# --- bipeds ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Moment:
    """All bipeds after a control step.

    Attributes:
        upright: whether it has not fallen so far (n,).
        forward: way of the hip (n,) [m].
        clearance: of the left and the right sole over the floor (n, 2) [m].
        places: of both along the way (n, 2) [m].
        dt: time since the moment before [s].
    """

    upright: np.ndarray
    forward: np.ndarray
    clearance: np.ndarray
    places: np.ndarray
    dt: float

    @property
    def down(self) -> np.ndarray:
        """Which feet touch the floor (n, 2)."""
        return self.clearance < TOUCH


def at_own_step(env: dict[str, Any]) -> dict[str, Any]:
    """The environment at the robot's own time step, whatever a training takes."""
    params = {name: value for name, value in (env.get("params") or {}).items() if name != "timestep"}
    return {**env, "params": params}


def moments(
    env: dict[str, Any], actuator: Any, act: Act, starts: int = STARTS, seconds: float = SECONDS, seed: Seeds = SEED
) -> Iterator[Moment]:
    """Move from ``starts`` starts for ``seconds`` [s], or until the last one has fallen."""
    engine = begin(env, actuator, starts, seed)
    qpos, seen = engine.batch.bind("qpos"), engine.reset()  # a mirrored task shows the policy swapped legs
    forward, upright = qpos[:, FORWARD], np.ones(starts, bool)
    for _ in range(round(seconds / engine.dt)):
        step = engine.step(act(seen))
        seen = step.observation
        upright &= ~step.terminated
        legs = np.stack([engine.drivetrain.position(name, qpos, "link") for name in engine.names], axis=1)
        where = sole_places(engine.numbers, forward, qpos[:, UP], qpos[:, PITCH], legs)
        yield Moment(upright.copy(), forward.copy(), where[..., 1], where[..., 0], engine.dt)
        if not upright.any():
            return


def walk(
    env: dict[str, Any], actuator: Any, act: Act, starts: int = STARTS, seconds: float = SECONDS
) -> dict[str, float]:
    """Figures of a walk; who has fallen stands still from there on."""
    upright, feet = np.ones(starts, bool), np.zeros(3)
    lasted, way = np.zeros(starts), np.zeros(starts)
    steps = Steps(starts)
    for moment in moments(env, actuator, act, starts, seconds):
        upright = moment.upright
        steps.see(moment)
        lasted += upright * moment.dt
        way = np.where(upright, moment.forward, way)
        feet += np.bincount(moment.down[upright].sum(axis=1), minlength=3)
    return {
        "falls": float((~upright).sum()),
        "speed [m/s]": float((way / seconds).mean()),
        "shortest [s]": float(lasted.min()),
        "slowest [m/s]": float((way / seconds).min()),
        "share on one foot": float(feet[1] / feet.sum()),
        "share in the air": float(feet[0] / feet.sum()),
        **steps.figures(way),
    }


class Steps:
    """What tells a walk from a shuffle: how high each foot swings, how far it slides, and whether both do alike."""

    def __init__(self, starts: int) -> None:
        self._top, self._slid = np.zeros((starts, 2)), np.zeros((starts, 2))
        self._before: Moment | None = None
        self._peaks: tuple[list[float], list[float]] = ([], [])

    def see(self, moment: Moment) -> None:
        """The bipeds after a control step."""
        down = moment.down
        for k, side in enumerate(self._peaks):
            landed = moment.upright & down[:, k] & (self._top[:, k] > 0.0)
            side += self._top[landed, k].tolist()
        self._top = np.where(down, 0.0, np.maximum(self._top, moment.clearance))
        if self._before is not None:
            stood = down & self._before.down & moment.upright[:, None]
            self._slid += np.where(stood, np.abs(moment.places - self._before.places), 0.0)
        self._before = moment

    def figures(self, way: np.ndarray) -> dict[str, float]:
        """Median height of each foot's swings [mm], each foot's slip over the way, and how far both heights differ."""
        heights = [float(np.median(side)) / MILLIMETRE if side else 0.0 for side in self._peaks]
        slips = self._slid.sum(axis=0) / max(float(np.abs(way).sum()), 1e-6)
        return {
            "left swings, median [mm]": heights[0],
            "right swings, median [mm]": heights[1],
            "left slip over the way": float(slips[0]),
            "right slip over the way": float(slips[1]),
            "heights differ by": 1.0 - min(heights) / max(*heights, 1e-6),
        }


@dataclass(frozen=True)
class Attempts:
    """Attempts to hop: who is upright at the end, how long each lasted and was in the air [s], its way [m] and its
    hops, all (n,); heights of all hops [m]."""

    upright: np.ndarray
    lasted: np.ndarray
    air: np.ndarray
    way: np.ndarray
    count: np.ndarray
    heights: list[float]


def hops(
    env: dict[str, Any], actuator: Any, act: Act, starts: int = STARTS, seconds: float = SECONDS, seed: Seeds = SEED
) -> Attempts:
    """Hop from ``starts`` starts for ``seconds`` [s], each until it falls."""
    upright = np.ones(starts, bool)
    lasted, way, air, highest, count = (np.zeros(starts) for _ in range(5))
    heights: list[float] = []
    for moment in moments(env, actuator, act, starts, seconds, seed):
        upright = moment.upright
        lasted += upright * moment.dt
        way = np.where(upright, moment.forward, way)
        lower = moment.clearance.min(axis=1)
        flying = upright & ~moment.down.any(axis=1)
        air += flying * moment.dt
        landed = upright & ~flying & (highest >= HIGH)
        count += landed
        heights += list(highest[landed])
        highest = np.where(flying, np.maximum(highest, lower), 0.0)
    return Attempts(upright, lasted, air, way, count, heights)


# --- hexapods --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Walked:
    """What walks came to: specific resistance (n,), ways forward and to the side (n, 2) [m], and who fell (n,)."""

    resistance: np.ndarray
    way: np.ndarray
    fallen: np.ndarray


@dataclass(frozen=True)
class Moved:
    """Walks at a new goal: their engine, the places of all geoms (n, geoms, 3) [m], and whether the way counts."""

    engine: BatchEngine
    geoms: np.ndarray
    counts: bool


def walked(
    env: dict[str, Any],
    actuator: Any,
    act: Act,
    speed: float = COMMANDED,
    *,
    starts: int = EPISODES,
    window: float = WINDOW,
    seed: Seeds = WALK_SEED,
    watch: Callable[[Moved], None] | None = None,
) -> Walked:
    """Walk for ``window`` [s] after ``START``; specific resistance by (35), the energy from the mean power of each
    control step."""
    engine = begin({**env, "speed": speed, "resistance_weight": 1.0}, actuator, starts, seed)
    weight = total_mass(engine.numbers) * GRAVITY
    places = engine.batch.bind("qpos")[:, :2]
    seen, start, steps = engine.reset(), round(START / engine.dt), round((START + window) / engine.dt)
    energy, fallen, begun = np.zeros(starts), np.zeros(starts, bool), places.copy()
    geoms = None if watch is None else engine.batch.bind("geom_xpos")
    for k in range(steps):
        if k == start:
            begun = places.copy()
        if watch is not None and geoms is not None:
            engine.watch = partial(watch, Moved(engine, geoms, k >= start))
        step = engine.step(act(seen))
        seen, fallen = step.observation, fallen | step.terminated
        if k >= start:
            energy -= step.terms["reward_resistance"] * weight * speed * engine.dt
    way = places - begun
    return Walked(energy / (weight * way[:, 0]), way, fallen)
