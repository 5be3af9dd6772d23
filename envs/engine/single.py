"""The single Gymnasium environment: a batch of one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium import spaces

from .arguments import TaskShell, task_arguments
from .batch import BatchEngine
from .render import Scene, check_render_mode


class Sized(Protocol):
    """What has actions and observations."""

    @property
    def action_names(self) -> Sequence[str]: ...
    @property
    def observation_size(self) -> int: ...


def action_space(engine: Sized) -> spaces.Box:
    """Goals, or what else the task's actions mean, scaled to [-1, 1]."""
    return spaces.Box(-1.0, 1.0, (len(engine.action_names),), np.float32)


def observation_space(engine: Sized) -> spaces.Box:
    """Unbounded float32."""
    return spaces.Box(-np.inf, np.inf, (engine.observation_size,), np.float32)


class SingleEnv(TaskShell, gym.Env[np.ndarray, np.ndarray], gym.utils.EzPickle):
    """What single environments share; a subclass names its task and documents itself.

    The time limit is Gymnasium's ``TimeLimit``, which ``gymnasium.make`` adds.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 as in Gymnasium
        "render_modes": ["rgb_array", "human"],
        "render_fps": 50,
    }

    def __init__(self, *, render_mode: str | None = None, width: int = 640, height: int = 480, **keywords: Any) -> None:
        """Build the batch of one; ``keywords`` are the task's and the engine's."""
        gym.utils.EzPickle.__init__(self, render_mode=render_mode, width=width, height=height, **keywords)
        check_render_mode(render_mode, self.metadata["render_modes"])
        task, engine = task_arguments(self.task, keywords)
        self.engine = BatchEngine(task, 1, autoreset=False, **engine)
        self.metadata = {**self.metadata, "render_fps": round(1.0 / self.engine.dt)}
        self.action_space, self.observation_space = action_space(self.engine), observation_space(self.engine)
        self.render_mode = render_mode
        self._scene = Scene(self.engine, render_mode, width, height) if render_mode else None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Start an episode; the same ``seed`` starts the same one. ``options`` are ignored."""
        del options
        if seed is not None or self._np_random is None:
            super().reset(seed=seed)
            self.engine.seed(seed)
            self._np_random = self.engine.generators[0]
        observation = self.engine.reset()[0]
        if self.render_mode == "human":
            self.render()
        return observation, {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One control step; ``info`` holds the terms of the reward and the actuators' flags."""
        result = self.engine.step(np.asarray(action)[None])
        info = {name: value[0].item() for name, value in (*result.terms.items(), *result.flags.items())}
        if self.render_mode == "human":
            self.render()
        return result.observation[0], float(result.reward[0]), bool(result.terminated[0]), False, info

    def render(self) -> Any:
        """The picture (height, width, 3), uint8, in mode ``rgb_array``; a window in mode ``human``."""
        if self._scene is None:
            gym.logger.warn("render() needs a render_mode, given to gymnasium.make.")
            return None
        return self._scene.draw(0)

    @property
    def model(self) -> mujoco.MjModel:
        """The robot with its actuators as MuJoCo knows it; to be read. Randomised values are not in it but in
        ``engine.batch``."""
        return self.engine.drivetrain.model

    @property
    def data(self) -> mujoco.MjData:
        """The state at this moment with what follows from its positions; a copy, so writing to it moves nothing."""
        return self.engine.look(0, mujoco.MjData(self.model))

    def close(self) -> None:
        """Close window and renderer."""
        if self._scene is not None:
            self._scene.close()
