"""Film of a policy."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import gymnasium
import imageio.v2 as imageio
import numpy as np

from ..common.errors import SealegsError
from ..envs.engine.batch import BatchEngine

FASTEST = 30  # pictures a second; drawing in software takes longer than the physics


@dataclass(frozen=True)
class Episode:
    """An episode of a film: its length [s], the sum of its rewards, and its ending in words."""

    seconds: float
    reward: float
    ending: str


def record_video(
    file: Path, act: Callable[..., np.ndarray], env: gymnasium.Env, seconds: float, seed: int
) -> list[Episode]:
    """Film a policy in ``env`` (render mode ``rgb_array``) for ``seconds`` [s] into an mp4, episode after episode.

    Args:
        file: to write.
        act: actions (1, k) for observations (1, size), and whether an episode began with them (1,).
        env: that draws itself.
        seconds: of the film.
        seed: of the first start.

    Returns:
        The episodes in the film, in order.

    Raises:
        SealegsError: pictures cannot be drawn or written here.
    """
    engine: BatchEngine = env.get_wrapper_attr("engine")
    between = engine.dt / engine.goals_per_step
    stride = math.ceil(1.0 / (FASTEST * between) - 1e-9)
    episodes: list[Episode] = []
    goals, steps, total = itertools.count(), 0, 0.0
    observation, _ = env.reset(seed=seed)
    began = np.array([True])
    with _drawing():
        film = imageio.get_writer(file, fps=1.0 / (stride * between), macro_block_size=2)
    with film:

        def watch() -> None:
            if next(goals) % stride == 0:
                with _drawing():
                    film.append_data(np.asarray(env.render(), dtype=np.uint8))

        engine.watch = watch
        for _ in range(max(1, round(seconds / engine.dt))):
            observation, reward, terminated, truncated, _ = env.step(act(observation[None], began)[0])
            began = np.array([terminated or truncated])
            steps, total = steps + 1, total + float(reward)
            if terminated or truncated:
                episodes.append(Episode(steps * engine.dt, total, "failed" if terminated else "whole"))
                observation, _ = env.reset()
                steps, total = 0, 0.0
    return [*episodes, Episode(steps * engine.dt, total, "cut by the film's end")] if steps else episodes


@contextmanager
def _drawing() -> Iterator[None]:
    """OpenGL and ffmpeg fail in ways of their own; a full disk is no fault of theirs."""
    try:
        yield
    except OSError:
        raise
    except Exception as error:
        reason = str(error).strip().partition("\n")[0].rstrip(".") or type(error).__name__
        raise SealegsError(
            f"{reason}. Films need OpenGL (without a screen: MUJOCO_GL=egl or osmesa) and the ffmpeg of imageio-ffmpeg."
        ) from error
