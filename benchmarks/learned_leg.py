"""The learned leg beside the best PID, for ``python -m benchmarks.learning leg``.

Both lead the foot along the same random paths with the printed drives. The PID is that of
``configs/actuator/silo4.yaml``, tuned by ``papers/leg/tuning.py``; the policy corrects the goals of a stiff PD
(``silo4_pd``). Goals reach the firmware of both every 2 ms.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from sealegs.agents.policy_files import load_policy
from sealegs.envs.contract import task_of
from sealegs.envs.engine.batch import BatchEngine
from sealegs.envs.leg.env import LegTask

from benchmarks.learning import Bar

TRAINING = ("env=leg", "actuator=silo4_pd", "video.seconds=0")
EPISODES, START, SECONDS, SEED = 64, 0.2, 4.0, 1000  # times in [s]
SHARE = 0.7
"""Of the best PID's error, that a policy may have."""
Act = Callable[[np.ndarray], np.ndarray]
MILLIMETRE = 1e-3


def reference() -> dict[str, float]:
    """Figures of the tuned PID."""
    return _figures({"id": "SeaLegs/Leg-v0"}, "silo4", _nothing)


def measure(policy: Path) -> dict[str, float]:
    """Figures of a policy with the drives that it was trained with, and of these drives without it."""
    act, description = load_policy(policy)
    alone = _figures(description["env"], description["actuators"], _nothing)
    found = _figures(description["env"], description["actuators"], act)
    return found | {"without the policy, rms error [mm]": alone["rms error [mm]"]}


def bars(rows: Sequence[dict[str, float]], reference: dict[str, float]) -> list[Bar]:
    """What is to be reached, of every seed."""
    share = np.array([row["rms error [mm]"] for row in rows]) / reference["rms error [mm]"]
    return [
        Bar(
            f"every seed: at most {SHARE:.0%} of the best PID's {reference['rms error [mm]']:.4f} mm",
            f"{share.min():.0%} to {share.max():.0%}",
            bool(share.max() <= SHARE),
        )
    ]


def _nothing(observation: np.ndarray) -> np.ndarray:
    return np.zeros((len(observation), 3))


def foot_errors(
    env: dict[str, Any], actuator: Any, act: Act, starts: int = EPISODES, seed: int | Sequence[int] = SEED
) -> tuple[np.ndarray, np.ndarray]:
    """Distance of the foot from its path at each control step after ``START`` (m, n) [mm], and rewards (n,)."""
    task, options = task_of(env)
    assert isinstance(task, LegTask)
    engine = BatchEngine(task, starts, **{**options, "actuator": actuator}, autoreset=False, threads=1)
    engine.seed(seed)
    observation, found = engine.reset(), []
    rewards = np.zeros(starts)
    for _ in range(round(SECONDS / engine.dt)):
        result = engine.step(act(observation))
        observation, rewards = result.observation, rewards + result.reward
        found.append(task.error(engine.motion(np.zeros((starts, 3)))))
    return np.array(found)[round(START / engine.dt) :] / MILLIMETRE, rewards


def _figures(env: dict[str, Any], actuator: Any, act: Act) -> dict[str, float]:
    error, rewards = foot_errors(env, actuator, act)
    each = np.sqrt(np.mean(np.square(error), axis=0))
    return {
        "rms error [mm]": float(np.sqrt(np.mean(np.square(error)))),
        "median path [mm]": float(np.median(each)),
        "largest error [mm]": float(error.max()),
        "reward": float(rewards.mean()),
    }
