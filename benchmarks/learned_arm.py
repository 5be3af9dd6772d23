"""The learned arm beside the reference that it corrects, for ``python -m benchmarks.learning arm``.

All lead the tool along the paper's line in 5 s, from the same starts that no training has seen. What counts is the
largest distance of the tool from its place, at every control step, from the true angles of the links.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from sealegs.agents.policy_files import load_policy
from sealegs.envs.arm.env import ArmTask
from sealegs.envs.arm.kinematics import tool
from sealegs.envs.arm.tables import JOINTS
from sealegs.envs.contract import task_of
from sealegs.envs.engine.batch import BatchEngine

from benchmarks.learning import Bar, asked

TRAINING = ("env=arm", "video.seconds=0")
EPISODES, STEPS, SEED = 16, 500, 10_000
MOST = 1.0  # [mm]
OTHERS = ("ideal", "regression", "net")
Act = Callable[[np.ndarray], np.ndarray]


def reference() -> dict[str, float]:
    """Figures of the goals that the policy corrects, with and without their lead over the line."""
    config = asked(TRAINING)
    found = _figures(config.env, config.actuator, _nothing)
    bare = _figures({**config.env, "lead": 0.0}, config.actuator, _nothing)
    return found | {"largest error without lead [mm]": bare["largest error [mm]"]}


def measure(policy: Path) -> dict[str, float]:
    """Figures of a policy with the flexible joints that it was trained with, and with other actuator models."""
    act, description = load_policy(policy)
    found = _figures(description["env"], description["actuators"], act)
    for word in OTHERS:
        other = _figures(description["env"], word, act)
        found[f"largest error with {word} [mm]"] = other["largest error [mm]"]
    return found


def bars(rows: Sequence[dict[str, float]], reference: dict[str, float]) -> list[Bar]:
    """Under a millimetre with flexible joints."""
    errors = np.array([row["largest error [mm]"] for row in rows])
    return [
        Bar(
            f"every seed: largest error of the tool under {MOST:g} mm, from each of {EPISODES} starts",
            f"{errors.min():.2f} to {errors.max():.2f} mm (reference {reference['largest error [mm]']:.2f} mm)",
            bool(errors.max() < MOST),
        )
    ]


def _nothing(observation: np.ndarray) -> np.ndarray:
    return np.zeros((len(observation), len(JOINTS)))


def tool_errors(
    env: dict[str, Any], actuator: Any, act: Act, starts: int = EPISODES, seed: int | Sequence[int] = SEED
) -> tuple[np.ndarray, np.ndarray]:
    """Distance of the tool from its place at each control step (m, n) [mm], and rewards (n,)."""
    kind, options = task_of(env)
    if not isinstance(kind, ArmTask):
        raise TypeError(f"{env['id']} is not the arm's environment")
    options |= {"actuator": actuator, "control_rate": options.get("control_rate", ArmTask.control_rate)}
    engine = BatchEngine(kind, starts, autoreset=False, **options)
    engine.seed(seed)
    observation = engine.reset()
    places = engine.batch.bind("qpos")
    errors, rewards = np.empty((STEPS, starts)), np.zeros(starts)
    command = np.full((1, 1), 5.0)
    for k in range(STEPS):
        step = engine.step(act(observation))
        observation = step.observation
        rewards += step.reward
        angles = np.stack([engine.drivetrain.position(name, places, "link") for name in JOINTS], axis=-1)
        wanted, _, _ = kind.wanted(np.array([(k + 1) * engine.dt]), command, engine.numbers)
        errors[k] = 1e3 * np.linalg.norm(tool(angles) - tool(wanted), axis=1)
    return errors, rewards


def _figures(env: dict[str, Any], actuator: Any, act: Act) -> dict[str, float]:
    errors, rewards = tool_errors(env, actuator, act)
    return {
        "largest error [mm]": float(errors.max()),
        "median start's largest error [mm]": float(np.median(errors.max(axis=0))),
        "rms error [mm]": float(np.sqrt(np.mean(np.square(errors)))),
        "error at the end [mm]": float(errors[-1].max()),
        "reward": float(rewards.mean()),
    }
