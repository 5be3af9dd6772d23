"""The learned walk of the biped: its training, and what is measured of a policy. See ``benchmarks/learning.py``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np

from agents.config import read_config
from agents.make_env import make_single_env
from agents.policy_files import load_policy
from benchmarks.learning import Bar
from envs.batch import BatchEngine
from envs.biped.task import BipedTask
from envs.contract import task_of

TRAINING = (
    "env=biped",
    "total_timesteps=550_000",
    "agent.learning_rate=lin_1e-3",
    "agent.policy_kwargs.log_std_init=-1",
    "evaluate.every=40_000",
    "evaluate.episodes=4",
    "video.seconds=0",
)
SECONDS, SPEED, STARTS = 60.0, 0.5, 16
"""Time without a fall [s], forward speed over it [m/s], and starts that each policy walks from."""
SEED = 10_000  # of the starts: no training draws these
DRAWN_AFTER, PICTURES, PICTURE = 10.0, 8, (200, 320)  # [s], in a turn of the clock, width and height [px]
SWITCHES = ("left foot switch", "right foot switch")


def reference() -> dict[str, float]:
    """The gait that the policies correct, with nobody to correct it."""
    config = read_config(TRAINING).config
    assert config is not None
    return walk(config.env, config.actuator, lambda observation: np.zeros((len(observation), 4)))


def measure(policy: Path) -> dict[str, float]:
    """Walks of a policy with the drives that it was trained with, at the robot's own time step."""
    act, description = load_policy(policy)
    return walk(at_own_step(description["env"]), description["actuators"], act)


def at_own_step(env: dict[str, Any]) -> dict[str, Any]:
    """The environment at the robot's documented time step, whatever the training took."""
    params = {name: value for name, value in (env.get("params") or {}).items() if name != "timestep"}
    return {**env, "params": params}


def walk(
    env: dict[str, Any],
    actuator: Any,
    act: Callable[[np.ndarray], np.ndarray],
    starts: int = STARTS,
    seconds: float = SECONDS,
) -> dict[str, float]:
    """Figures of ``starts`` walks of ``seconds`` [s]; one that ends in a fall stands still from there on."""
    task, options = task_of(env)
    engine = BatchEngine(task, starts, **{**options, "actuator": actuator}, autoreset=False, threads=1)
    engine.seed(SEED)
    feet = [task.observation_names().index(name) for name in SWITCHES]
    forward, observation = engine.batch.bind("qpos")[:, 0], engine.reset()
    upright, lasted = np.ones(starts, bool), np.zeros(starts)
    way, standing = np.zeros(starts), np.zeros((3, starts))
    for _ in range(round(seconds / engine.dt)):
        step = engine.step(act(observation))
        observation = step.observation
        upright &= ~step.terminated
        if not upright.any():
            break
        lasted[upright] += engine.dt
        way[upright] = forward[upright]
        down = (observation[:, feet] > 0.5).sum(axis=1)
        standing[down, np.arange(starts)] += upright * engine.dt
    share = standing.sum(axis=1) / max(float(lasted.sum()), engine.dt)
    speed = way / seconds
    return {
        "falls": float((~upright).sum()),
        "shortest walk [s]": float(lasted.min()),
        "slowest walk [m/s]": float(speed.min()),
        "mean speed [m/s]": float(speed.mean()),
        "share on one foot": float(share[1]),
        "share in the air": float(share[0]),
    }


def draw(policy: Path, file: Path) -> None:
    """Pictures of one turn of the clock, two steps or a hop, in the middle of a walk."""
    act, description = load_policy(policy)
    env = make_single_env(at_own_step(description["env"]), description["actuators"], *PICTURE)
    observation, _ = env.reset(seed=SEED)
    rate, task = float(description["control_rate"]), task_of(description["env"])[0]
    assert isinstance(task, BipedTask)
    before, turn = round(DRAWN_AFTER * task.cadence), rate / task.cadence
    shown = [round((before + k / PICTURES) * turn) for k in range(PICTURES)]
    pictures = []
    for step in range(shown[-1] + 1):
        if step in shown:
            pictures.append(np.asarray(env.render()))
        observation = env.step(act(observation[None])[0])[0]
    env.close()
    imageio.imwrite(file, np.hstack(pictures))


def bars(rows: Sequence[dict[str, float]], reference: dict[str, float]) -> list[Bar]:
    """Every seed's policy walks for a minute, from every start."""
    del reference
    reached = sum(row["falls"] == 0.0 and row["slowest walk [m/s]"] >= SPEED for row in rows)
    wanted = f"{SECONDS:g} s without a fall at {SPEED:g} m/s or more, from each of {STARTS} starts"
    return [Bar(wanted, f"{reached} of {len(rows)} seeds", reached == len(rows))]
