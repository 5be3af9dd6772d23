"""The Gymnasium vector environment, as ``gymnasium.make_vec`` makes it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import batch_space

from .arguments import TaskShell, task_arguments
from .batch import BatchEngine
from .render import Scene, check_render_mode
from .task import Step


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


class _Told(type):
    """Class of classes whose name tells where a learner that refuses them finds what it takes."""

    def __repr__(cls) -> str:
        return f"{super().__repr__()} (of Gymnasium; Stable-Baselines3 takes BatchVecEnv: make_env(..., sb3=True))"


class BatchVectorEnv(TaskShell, gym.vector.VectorEnv, metaclass=_Told):
    """n simulations on all cores; a finished episode's successor starts in the same step (``SAME_STEP``).

    Its observations, rewards and infos are those of ``gymnasium.vector.SyncVectorEnv`` over single environments in that
    mode.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 as in Gymnasium
        "render_modes": ["rgb_array"],
        "render_fps": 50,
        "autoreset_mode": gym.vector.AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        *,
        num_envs: int = 1,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        width: int = 640,
        height: int = 480,
        **keywords: Any,
    ) -> None:
        """Build the batch; ``keywords`` are the task's and the engine's."""
        check_render_mode(render_mode, self.metadata["render_modes"])
        task, engine = task_arguments(self.task, keywords)
        self.engine = BatchEngine(task, num_envs, max_episode_steps=max_episode_steps, **engine)
        self.metadata = {**self.metadata, "render_fps": round(1.0 / self.engine.dt)}
        self.num_envs = num_envs
        self.single_action_space, self.single_observation_space = (
            action_space(self.engine),
            observation_space(self.engine),
        )
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.render_mode = render_mode
        self._scene = Scene(self.engine, render_mode, width, height) if render_mode else None

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start episodes everywhere; a number s seeds them with s, s + 1, ... ``options`` are ignored."""
        del options
        if seed is not None:
            self.engine.seed(seed)
        return self.engine.reset(), {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One control step of all simulations."""
        result = self.engine.step(actions)
        return result.observation, result.reward, result.terminated, result.truncated, self._infos(result)

    def _infos(self, result: Step) -> dict[str, Any]:
        values = {**result.terms, **result.flags}
        going = np.ones(self.num_envs, dtype=bool)
        if not len(result.done):
            return _masked(values, going)
        going[result.done] = False
        ended = ~going
        final = np.full(self.num_envs, None, dtype=object)
        for row, number in enumerate(result.done):
            final[number] = result.final_observation[row]
        last = {name: np.where(ended, value, np.zeros_like(value)) for name, value in values.items()}
        infos = {"final_obs": final, "_final_obs": ended, "final_info": _masked(last, ended), "_final_info": ended}
        if going.any():
            infos |= _masked(
                {name: np.where(going, value, np.zeros_like(value)) for name, value in values.items()}, going
            )
        return infos

    def render(self) -> Any:
        """Pictures of all simulations."""
        if self._scene is None:
            return None
        return tuple(self._scene.draw(number) for number in range(self.num_envs))

    @property
    def model(self) -> mujoco.MjModel:
        """The robot that all simulations share; to be read. Randomised values are not in it but in ``engine.batch``."""
        return self.engine.drivetrain.model

    def data(self, simulation: int = 0) -> mujoco.MjData:
        """A copy of one simulation's state, as :attr:`sealegs.envs.engine.vector.SingleEnv.data` has it."""
        return self.engine.look(simulation, mujoco.MjData(self.model))

    def close_extras(self, **kwargs: Any) -> None:
        """Close the renderer."""
        del kwargs
        if self._scene is not None:
            self._scene.close()


def _masked(values: dict[str, np.ndarray], mask: np.ndarray) -> dict[str, np.ndarray]:
    infos: dict[str, np.ndarray] = {}
    for name, value in values.items():
        infos[name], infos[f"_{name}"] = value, mask.copy()
    return infos
