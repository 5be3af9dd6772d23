"""A policy, or the bare reference gait, on several bipeds at once: what measuring walks and hops has in common."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np
from sealegs.agents.make_env import make_single_env
from sealegs.agents.policy_files import load_policy
from sealegs.envs.biped.env import FORWARD, PITCH, TOUCH, UP, BipedTask, sole_places
from sealegs.envs.contract import task_of
from sealegs.envs.engine.batch import BatchEngine

from benchmarks.learning import asked

Act = Callable[[np.ndarray], np.ndarray]
STARTS, SECONDS = 16, 60.0  # attempts, and how long each is to last [s]
SEED = 30_000  # of the starts: no training and no choice has seen these
PICTURES, PICTURE = 8, (200, 320)  # in a turn of the clock, width and height [px]


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


def load(policy: Path) -> tuple[dict[str, Any], Any, Act]:
    """Environment at the robot's own time step, drives, and the policy itself."""
    act, description = load_policy(policy)
    return at_own_step(description["env"]), description["actuators"], act


def reference_gait(training: Sequence[str]) -> tuple[dict[str, Any], Any, Act]:
    """The same of the gait that is corrected, with nobody to correct it."""
    config = asked(training)
    return at_own_step(config.env), config.actuator, lambda observation: np.zeros((len(observation), 4))


def at_own_step(env: dict[str, Any]) -> dict[str, Any]:
    """The environment at the robot's own time step, whatever a training takes."""
    params = {name: value for name, value in (env.get("params") or {}).items() if name != "timestep"}
    return {**env, "params": params}


def moments(
    env: dict[str, Any],
    actuator: Any,
    act: Act,
    starts: int = STARTS,
    seconds: float = SECONDS,
    seed: int | Sequence[int] = SEED,
) -> Iterator[Moment]:
    """Move from ``starts`` starts for ``seconds`` [s], or until the last one has fallen."""
    task, options = task_of(env)
    engine = BatchEngine(task, starts, **{**options, "actuator": actuator}, autoreset=False, threads=1)
    engine.seed(seed)
    qpos, observation = engine.batch.bind("qpos"), engine.reset()  # a mirrored task shows the policy swapped legs
    forward = qpos[:, FORWARD]
    upright = np.ones(starts, bool)
    for _ in range(round(seconds / engine.dt)):
        step = engine.step(act(observation))
        observation = step.observation
        upright &= ~step.terminated
        legs = np.stack([engine.drivetrain.position(name, qpos, "link") for name in engine.names], axis=1)
        where = sole_places(engine.numbers, forward, qpos[:, UP], qpos[:, PITCH], legs)
        yield Moment(upright.copy(), forward.copy(), where[..., 1], where[..., 0], engine.dt)
        if not upright.any():
            return


def draw(policy: Path, file: Path, speed: float, after: float = 10.0) -> None:
    """Pictures of one turn of the clock, two steps or a hop, at a commanded speed [m/s] from ``after`` [s] on."""
    env_config, actuator, act = load(policy)
    env_config |= {"speed": speed}
    task = task_of(env_config)[0]
    assert isinstance(task, BipedTask)
    env = make_single_env(env_config, actuator, *PICTURE)
    observation, _ = env.reset(seed=SEED)
    rate = env.metadata["render_fps"]
    shown = [round((round(after * task.cadence) + k / PICTURES) * rate / task.cadence) for k in range(PICTURES)]
    pictures = []
    for step in range(shown[-1] + 1):
        if step in shown:
            pictures.append(np.asarray(env.render()))
        observation = env.step(act(observation[None])[0])[0]
    env.close()
    imageio.imwrite(file, np.hstack(pictures))
