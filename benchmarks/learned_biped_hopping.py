"""The learned hopping of the biped: its training, and what is measured of it. See ``benchmarks/learning.py``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.config import read_config
from agents.policy_files import load_policy
from benchmarks.learned_biped import SECONDS, SEED, STARTS, SWITCHES, at_own_step, draw
from benchmarks.learning import Bar
from envs.batch import BatchEngine
from envs.contract import task_of

__all__ = ["TRAINING", "bars", "draw", "measure", "reference"]
TRAINING = (
    "env=biped",
    "env.hopping=1",
    "env.speed=0.3",
    "env.cadence=1.65",
    "env.gait_weight=2",
    "env.healthy_height=0.7",
    "total_timesteps=400_000",
    "agent.learning_rate=lin_1e-3",
    "agent.policy_kwargs.log_std_init=-1",
    "evaluate.every=50_000",
    "evaluate.episodes=4",
    "video.seconds=0",
)
FLIGHT = 0.06
"""Both feet up for so long make a hop [s]; shorter, they may have bounced."""


def reference() -> dict[str, float]:
    """The gait that the policy corrects, with nobody to correct it."""
    config = read_config(TRAINING).config
    assert config is not None
    return hop(config.env, config.actuator, lambda observation: np.zeros((len(observation), 4)))


def measure(policy: Path) -> dict[str, float]:
    """Hopping of a policy with the drives that it was trained with, at the robot's own time step."""
    act, description = load_policy(policy)
    return hop(at_own_step(description["env"]), description["actuators"], act)


def hop(env: dict[str, Any], actuator: Any, act: Callable[[np.ndarray], np.ndarray]) -> dict[str, float]:
    """Figures of ``STARTS`` attempts to hop for ``SECONDS``."""
    task, options = task_of(env)
    engine = BatchEngine(task, STARTS, **{**options, "actuator": actuator}, autoreset=False, threads=1)
    engine.seed(SEED)
    feet = [task.observation_names().index(name) for name in SWITCHES]
    forward, observation = engine.batch.bind("qpos")[:, 0], engine.reset()
    upright = np.ones(STARTS, bool)
    lasted, way, air, flight, hops = (np.zeros(STARTS) for _ in range(5))
    for _ in range(round(SECONDS / engine.dt)):
        step = engine.step(act(observation))
        observation = step.observation
        upright &= ~step.terminated
        if not upright.any():
            break
        lasted[upright] += engine.dt
        way[upright] = forward[upright]
        flying = upright & (observation[:, feet] < 0.5).all(axis=1)
        hops += upright & ~flying & (flight > FLIGHT - 0.5 * engine.dt)  # it lands
        flight = np.where(flying, flight + engine.dt, 0.0)
        air += flying * engine.dt
    return {
        "falls": float((~upright).sum()),
        "shortest [s]": float(lasted.min()),
        "fewest hops": float(hops.min()),
        "hops per second": float(hops.sum() / lasted.sum()),
        "share in the air": float(air.sum() / lasted.sum()),
        "mean speed [m/s]": float((way / SECONDS).mean()),
    }


def bars(rows: Sequence[dict[str, float]], reference: dict[str, float]) -> list[Bar]:
    """It hops on, as often as the paper's controller did: 92 times."""
    del reference
    reached = sum(row["falls"] == 0.0 and row["fewest hops"] >= 92.0 for row in rows)
    wanted = f"92 hops in {SECONDS:g} s without a fall, from each of {STARTS} starts"
    return [Bar(wanted, f"{reached} of {len(rows)} seeds", reached == len(rows))]
