"""Film of a policy."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import gymnasium
import imageio.v2 as imageio
import numpy as np

FASTEST = 30  # pictures a second; drawing in software takes longer than the physics


@dataclass(frozen=True)
class Episode:
    """An episode of a film: its length [s], the sum of its rewards, and its ending in words."""

    seconds: float
    reward: float
    ending: str


def record_video(
    file: Path, act: Callable[[np.ndarray], np.ndarray], env: gymnasium.Env, seconds: float, seed: int
) -> list[Episode]:
    """Film a policy in ``env`` (render mode ``rgb_array``) for ``seconds`` [s] into an mp4, episode after episode.

    Args:
        file: to write.
        act: actions (1, k) for observations (1, size).
        env: that draws itself.
        seconds: of the film.
        seed: of the first start.

    Returns:
        The episodes in the film, in order.
    """
    rate = int(env.metadata["render_fps"])
    stride = math.ceil(rate / FASTEST)
    episodes: list[Episode] = []
    observation, _ = env.reset(seed=seed)
    count, total = 0, 0.0
    with imageio.get_writer(file, fps=rate / stride, macro_block_size=2) as film:
        for step in range(max(1, round(seconds * rate))):
            if step % stride == 0:
                film.append_data(np.asarray(env.render(), dtype=np.uint8))  # type: ignore[attr-defined]
            observation, reward, terminated, truncated, _ = env.step(act(observation[None])[0])
            count, total = count + 1, total + float(reward)
            if terminated or truncated:
                episodes.append(Episode(count / rate, total, "failed" if terminated else "whole"))
                observation, _ = env.reset()
                count, total = 0, 0.0
    return [*episodes, Episode(count / rate, total, "cut by the film's end")] if count else episodes
