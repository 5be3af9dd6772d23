"""Film of a policy."""

from __future__ import annotations

import math
from pathlib import Path

import gymnasium
import imageio.v2 as imageio
import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm

FASTEST = 30  # pictures a second; drawing in software takes longer than the physics


def record_video(file: Path, model: BaseAlgorithm, env: gymnasium.Env, seconds: float, seed: int) -> None:
    """Film ``model`` in ``env`` (render mode ``rgb_array``) for ``seconds`` [s] into an mp4, episode after episode."""
    normalizer = model.get_vec_normalize_env()
    rate = int(env.metadata["render_fps"])
    stride = math.ceil(rate / FASTEST)
    observation, _ = env.reset(seed=seed)
    with imageio.get_writer(file, fps=rate / stride, macro_block_size=2) as film:
        for step in range(max(1, round(seconds * rate))):
            if step % stride == 0:
                film.append_data(np.asarray(env.render(), dtype=np.uint8))  # type: ignore[attr-defined]
            seen = np.asarray(normalizer.normalize_obs(observation) if normalizer else observation)
            action, _ = model.predict(seen, deterministic=True)
            observation, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                observation, _ = env.reset()
