"""Evaluation of a policy on another actuator than that of its training."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from ..common.documents import read_json
from .algorithms import algorithm
from .make_env import Actuator, make_vec_env


def mean_reward(policy: Path, actuator: Actuator, episodes: int = 16, seed: int = 0) -> float:
    """Mean episode reward of a saved policy with the chain ``actuator`` in its robot.

    Args:
        policy: folder with ``model.zip``, ``policy.json`` and, where there was a normaliser, ``vecnormalize.pkl``.
        actuator: name or path of a chain, or chains by joint.
        episodes: to average over; they start alike for equal seeds, whatever the policy.
        seed: of the episodes.
    """
    description = read_json(policy / "policy.json")
    env: VecEnv = make_vec_env(description["env"], actuator, episodes, seed)
    if (policy / "vecnormalize.pkl").is_file():
        env = VecNormalize.load(str(policy / "vecnormalize.pkl"), env)
        env.training = env.norm_reward = False
    model = algorithm(description["algorithm"]).load(policy / "model.zip")
    rewards, _ = evaluate_policy(model, env, n_eval_episodes=episodes, return_episode_rewards=True)
    env.close()
    return float(np.mean(rewards))
