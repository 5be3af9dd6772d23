"""The learned hexapod beside the reference gait, for ``python -m benchmarks.learning hexapod``.

Both walk with the printed chain (LuGre joint friction) in the same simulations, started alike: the reference gait is
the action 0. Energy and way count after the start.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from sealegs.actuators.gravity import GRAVITY
from sealegs.agents.policy_files import load_policy
from sealegs.envs.contract import task_of
from sealegs.envs.engine.batch import BatchEngine
from sealegs.envs.hexapod.env import HexapodTask
from sealegs.envs.hexapod.robot import total_mass

from benchmarks.learning import Bar, asked

TRAINING = ("env=hexapod", "video.seconds=0")
SPEED = 0.03  # [m/s] of the reference gait
COMMANDED = 1.01 * SPEED  # [m/s] of policies, so that none is slower than the reference gait is when it slips a little
EPISODES, START, WINDOW = 4, 12.0, 36.0  # [s] two cycles of the reference gait, then six
SEED = 1000
Act = Callable[[np.ndarray], np.ndarray]
MOST = 0.8
"""Of the reference gait's specific resistance."""


def reference() -> dict[str, float]:
    """Figures of the reference gait, and the reward of an episode as in training."""
    config = asked(TRAINING)
    walk = config.env, config.actuator, unchanged
    return _figures(*walk, SPEED) | {"reward": _reward(*walk)}


def measure(policy: Path) -> dict[str, float]:
    """Figures of a policy with the drives that it was trained with, means over the episodes."""
    act, description = load_policy(policy)
    return _figures(description["env"], description["actuators"], act, COMMANDED)


def bars(rows: Sequence[dict[str, float]], reference: dict[str, float]) -> list[Bar]:
    """What issue 4 asks for, of the best seed and of all."""
    resistance, speed = (np.array([row[name] for row in rows]) for name in ("specific resistance", "speed [cm/s]"))
    share = resistance / reference["specific resistance"]
    best, wanted = int(np.argmin(share)), reference["speed [cm/s]"]
    return [
        Bar(
            f"the best seed: at most {MOST:.0%} of the reference gait's specific resistance, at its {wanted:.3f} cm/s",
            f"seed {best}: {share[best]:.1%} at {speed[best]:.3f} cm/s",
            bool(share[best] <= MOST and speed[best] >= wanted),
        ),
        Bar(
            f"every seed: at most {MOST:.0%} of its specific resistance",
            f"{share.min():.1%} to {share.max():.1%}",
            bool(share.max() <= MOST),
        ),
        Bar(
            f"every seed: at least its speed, {wanted:.3f} cm/s",
            f"{speed.min():.3f} to {speed.max():.3f} cm/s",
            bool(speed.min() >= wanted),
        ),
        Bar(
            "every seed: no fall",
            f"{sum(row['falls'] for row in rows):.0f} falls",
            all(row["falls"] == 0.0 for row in rows),
        ),
    ]


def unchanged(observation: np.ndarray) -> np.ndarray:
    return np.zeros((len(observation), len(HexapodTask().action_names())))


def _engine(
    env: dict[str, Any], actuator: Any, seed: int | Sequence[int], starts: int = EPISODES, **task: float
) -> BatchEngine:
    kind, options = task_of({**env, **task})
    options |= {"actuator": actuator, "control_rate": options.get("control_rate", HexapodTask.control_rate)}
    engine = BatchEngine(kind, starts, **options, autoreset=False, threads=1)
    engine.seed(seed)
    return engine


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
    seed: int | Sequence[int] = SEED,
    watch: Callable[[Moved], None] | None = None,
) -> Walked:
    """Walk for ``window`` [s] after ``START``; specific resistance by (35), the energy from the mean power of each
    control step."""
    engine = _engine(env, actuator, seed, starts, speed=speed, resistance_weight=1.0)
    weight = total_mass(engine.numbers) * GRAVITY
    places = engine.batch.bind("qpos")[:, :2]
    observation, start = engine.reset(), round(START * HexapodTask.control_rate)
    steps = start + round(window * HexapodTask.control_rate)
    energy, fallen, begun = np.zeros(starts), np.zeros(starts, bool), places.copy()
    geoms = None if watch is None else engine.batch.bind("geom_xpos")
    for k in range(steps):
        if k == start:
            begun = places.copy()
        if watch is not None and geoms is not None:
            engine.watch = partial(watch, Moved(engine, geoms, k >= start))
        result = engine.step(act(observation))
        observation, fallen = result.observation, fallen | result.terminated
        if k >= start:
            energy -= result.terms["reward_resistance"] * weight * speed * engine.dt
    way = places - begun
    return Walked(energy / (weight * way[:, 0]), way, fallen)


def _figures(env: dict[str, Any], actuator: Any, act: Act, speed: float) -> dict[str, float]:
    found = walked(env, actuator, act, speed)
    way = found.way
    return {
        "specific resistance": float(found.resistance.mean()),
        "largest of an episode": float(found.resistance.max()),
        "speed [cm/s]": float(100.0 * way[:, 0].mean() / WINDOW),
        "to the side [cm/m]": float(100.0 * np.abs(way[:, 1] / way[:, 0]).max()),
        "falls": float(found.fallen.sum()),
    }


def _reward(env: dict[str, Any], actuator: Any, act: Act, steps: int = 30) -> float:
    engine = _engine(env, actuator, 2000, speed=SPEED)
    observation, total = engine.reset(), np.zeros(EPISODES)
    for _ in range(steps):
        result = engine.step(act(observation))
        observation, total = result.observation, total + result.reward
    return float(total.mean())
