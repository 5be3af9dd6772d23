"""Evaluation of a policy on another actuator than that of its training."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..envs.engine.sb3 import BatchVecEnv
from .make_env import Actuator, make_vec_env
from .policy_files import load_policy, trained_env


def mean_reward(
    policy: Path, actuator: Actuator, episodes: int = 16, seed: int = 0, task: str | None = None, trust: bool = False
) -> float:
    """Mean episode reward of a saved policy with the chain ``actuator`` in its robot.

    Args:
        policy: folder with ``policy.safetensors`` and ``policy.json``.
        actuator: name or path of a chain, or chains by joint.
        episodes: to average over; they start alike for equal seeds, whatever the policy.
        seed: of the episodes.
        task, trust: as of :func:`sealegs.agents.export.export_policy`.
    """
    act, description = load_policy(policy, trust)
    env = make_vec_env(trained_env(description, policy, task), actuator, episodes, seed)
    rewards = episode_rewards(act, env)
    env.close()
    return float(np.mean(rewards))


def episode_rewards(act: Callable[..., np.ndarray], env: BatchVecEnv) -> np.ndarray:
    """Reward of the first episode of each simulation (n,).

    Args:
        act: from observations (n, size), and whether an episode began with them (n,), to actions (n, k).
        env: seeded, to be started anew.
    """
    observation, rewards, done = env.reset(), np.full(env.num_envs, np.nan), np.ones(env.num_envs, bool)
    while np.isnan(rewards).any():
        env.step_async(act(observation, done))
        observation, _, done, infos = env.step_wait()
        assert isinstance(observation, np.ndarray)
        for number in np.flatnonzero(done & np.isnan(rewards)):
            rewards[number] = infos[number]["episode"]["r"]
    return rewards
