"""The learned walk of the biped: its training, and what is measured of a policy. See ``benchmarks/learning.py``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.config import read_config
from agents.policy_files import load_policy
from benchmarks.learning import Bar
from envs.batch import BatchEngine
from envs.contract import task_of

TRAINING = ("env=biped", "total_timesteps=1_000_000", "video.seconds=0")
SECONDS, SPEED, STARTS = 60.0, 0.5, 16
"""Time without a fall [s], forward speed over it [m/s], and starts that each policy walks from."""
SEED = 10_000  # of the starts: no training draws these
SWITCHES = ("left foot switch", "right foot switch")


def reference() -> dict[str, float]:
    """The gait that the policies correct, with nobody to correct it."""
    config = read_config(TRAINING).config
    assert config is not None
    return walk(config.env, config.actuator, lambda observation: np.zeros((len(observation), 4)))


def measure(policy: Path) -> dict[str, float]:
    """Walks of a policy with the drives that it was trained with, at the robot's own time step."""
    act, description = load_policy(policy)
    return walk(description["env"], description["actuators"], act)


def walk(env: dict[str, Any], actuator: Any, act: Callable[[np.ndarray], np.ndarray]) -> dict[str, float]:
    """Figures of ``STARTS`` walks of ``SECONDS``; a walk that ends in a fall stands still from there on."""
    task, options = task_of(env)
    engine = BatchEngine(task, STARTS, **{**options, "actuator": actuator}, autoreset=False, threads=1)
    engine.seed(SEED)
    feet = [task.observation_names().index(name) for name in SWITCHES]
    forward, observation = engine.batch.bind("qpos")[:, 0], engine.reset()
    upright, lasted = np.ones(STARTS, bool), np.zeros(STARTS)
    way, standing = np.zeros(STARTS), np.zeros((3, STARTS))
    for _ in range(round(SECONDS / engine.dt)):
        step = engine.step(act(observation))
        observation = step.observation
        upright &= ~step.terminated
        if not upright.any():
            break
        lasted[upright] += engine.dt
        way[upright] = forward[upright]
        down = (observation[:, feet] > 0.5).sum(axis=1)
        standing[down, np.arange(STARTS)] += upright * engine.dt
    share = standing.sum(axis=1) / max(float(lasted.sum()), engine.dt)
    speed = way / SECONDS
    return {
        "falls": float((~upright).sum()),
        "shortest walk [s]": float(lasted.min()),
        "slowest walk [m/s]": float(speed.min()),
        "mean speed [m/s]": float(speed.mean()),
        "share on one foot": float(share[1]),
        "share in the air": float(share[0]),
    }


def bars(rows: Sequence[dict[str, float]], reference: dict[str, float]) -> list[Bar]:
    """Every seed's policy walks for a minute, from every start."""
    del reference
    reached = sum(row["falls"] == 0.0 and row["slowest walk [m/s]"] >= SPEED for row in rows)
    wanted = f"{SECONDS:g} s without a fall at {SPEED:g} m/s or more, from each of {STARTS} starts"
    return [Bar(wanted, f"{reached} of {len(rows)} seeds", reached == len(rows))]
