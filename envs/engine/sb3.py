"""What steps a batch, such as the batch engine, as a Stable-Baselines3 ``VecEnv``."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import load_env_creator

from ...common.errors import SealegsError
from ...common.extras import needed_for
from .. import registered_id
from .batch import BatchEngine
from .task import Step, Task
from .vector import BatchVectorEnv, action_space, observation_space

with needed_for("A vector environment for Stable-Baselines3"):
    from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvStepReturn

__all__ = ["BatchVecEnv", "EngineVecEnv"]


class SteppedBatch(Protocol):
    """What resets and steps n copies of a robot side by side: simulations, or machines."""

    @property
    def task(self) -> Task: ...

    @property
    def num_envs(self) -> int: ...
    @property
    def action_names(self) -> Sequence[str]: ...
    @property
    def observation_size(self) -> int: ...
    def seed(self, seed: int | Sequence[int | None] | None) -> None: ...
    def reset(self) -> np.ndarray: ...
    def step(self, action: np.ndarray) -> Step: ...
    def set_number(self, name: str, value: Any) -> None: ...


class EngineVecEnv(VecEnv):
    """Whatever steps a batch, as Stable-Baselines3 learns on it.

    Attributes:
        engine: the batch.

    ``infos[i]`` is empty but in the step that ends an episode, where it holds ``terminal_observation``,
    ``TimeLimit.truncated``, the last step's flags, and ``episode``: ``r``, ``l``, ``t`` as ``Monitor`` writes them, the
    sum of each term of the reward, and the mean of each measure of :mod:`~sealegs.envs.engine.servo_use` and of each
    error of the task. So no ``VecMonitor`` is needed.
    """

    def __init__(self, engine: SteppedBatch, owner: object | None = None) -> None:
        """Wrap a batch.

        Args:
            engine: the batch.
            owner: whose attributes and methods SB3 asks for; None: of the engine.
        """
        self.engine, self._owner = engine, engine if owner is None else owner
        self.render_mode: str | None = getattr(owner, "render_mode", None)
        super().__init__(engine.num_envs, observation_space(engine), action_space(engine))
        self._actions = np.zeros((self.num_envs, *self.action_space.shape))  # type: ignore[misc]
        self._started = time.time()
        self._returns, self._lengths = np.zeros(self.num_envs), np.zeros(self.num_envs, dtype=np.int64)
        self._sums: dict[str, np.ndarray] = {}

    def reset(self) -> np.ndarray:  # type: ignore[override]
        """Start episodes everywhere."""
        if any(value is not None for value in self._seeds):
            self.engine.seed(self._seeds)
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = [{} for _ in range(self.num_envs)]
        self._returns[:], self._lengths[:] = 0.0, 0
        self._sums = {}
        return self.engine.reset()

    def step_async(self, actions: np.ndarray) -> None:
        """Remember the actions; :meth:`step_wait` does the work."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """One control step of the whole batch."""
        result = self.engine.step(self._actions)
        self._returns += result.reward
        self._lengths += 1
        used = {f"servo_{key}": value for key, value in result.servo.items()}
        off = {f"error_{key}": value for key, value in result.errors.items()}
        for name, term in (result.terms | used | off).items():
            if name in self._sums:
                self._sums[name] += term
            else:
                self._sums[name] = term.copy()
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for row, number in enumerate(result.done):
            episode = {
                "r": round(float(self._returns[number]), 6),
                "l": int(self._lengths[number]),
                "t": round(time.time() - self._started, 6),
            }
            infos[number] = {
                "terminal_observation": result.final_observation[row],
                "TimeLimit.truncated": bool(result.truncated[number] and not result.terminated[number]),
                "episode": episode | self._summed(number),
                **{name: flag[number].item() for name, flag in result.flags.items()},
            }
        if len(result.done):
            self._returns[result.done], self._lengths[result.done] = 0.0, 0
            for total in self._sums.values():
                total[result.done] = 0.0
        dones = result.terminated | result.truncated
        return result.observation, result.reward.astype(np.float32), dones, infos

    def _summed(self, number: int) -> dict[str, float]:
        """Sums of the reward's terms over an episode, and means of its errors and of how hard it drove the servos."""
        length = self._lengths[number]
        sums = {name: float(total[number]) for name, total in self._sums.items()}
        means = ("servo_", "error_")
        return {name: value / length if name.startswith(means) else value for name, value in sums.items()}

    def close(self) -> None:
        """Nothing is open."""

    # What SB3 asks of single environments is asked of the batch, which all of them share.

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of the batch or a number of its task, once for each simulation."""
        owner: object = self if attr_name in ("render_mode", "spec", "metadata") else self._owner
        if attr_name in self._numbers:
            owner = self.engine.task
        return [getattr(owner, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the batch, or a number of its task, such as ``tracking_weight`` in a curriculum.

        Raises:
            SealegsError: ``indices`` are not all simulations, which share it, or the value is none for a number of the
                task.
        """
        self._check_all(indices, "an attribute")
        if attr_name in self._numbers:
            self.engine.set_number(attr_name, value)
        else:
            setattr(self._owner, attr_name, value)

    @property
    def _numbers(self) -> list[str]:
        """Names of the task's numbers."""
        return [item.name for item in dataclasses.fields(self.engine.task)]

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list:
        """Call a method of the batch once.

        Raises:
            SealegsError: ``indices`` are not all simulations, on which it acts.
        """
        self._check_all(indices, "a method")
        answer = getattr(self._owner, method_name)(*method_args, **method_kwargs)
        return [answer] * len(list(self._get_indices(indices)))

    def _check_all(self, indices: VecEnvIndices, what: str) -> None:
        chosen = set(self._get_indices(indices))
        if len(chosen) < self.num_envs:
            raise SealegsError(
                f"indices={indices} are {len(chosen)} of {self.num_envs} simulations, but all of them share {what} of "
                "the batch: leave indices out."
            )

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """Whether episodes are monitored: ``Monitor`` counts as there, because its infos are."""
        from stable_baselines3.common.monitor import Monitor

        return [wrapper_class is Monitor] * len(list(self._get_indices(indices)))


class BatchVecEnv(EngineVecEnv):
    """n simulations of a registered environment on all cores.

    Attributes:
        engine: the simulations.
        keywords: arguments of the environment that were given.
    """

    engine: BatchEngine

    def __init__(self, env_id: str, num_envs: int, seed: int | None = None, **env_kwargs: Any) -> None:
        """Build the batch.

        Args:
            env_id: registered name, such as ``SeaLegs/Hopper-v0``, or ``path/to/task.py:MyTask``.
            num_envs: simulations side by side.
            seed: simulation i is seeded with ``seed + i``.
            env_kwargs: arguments of the environment; and ``max_episode_steps``, ``render_mode``, ``width``, ``height``.

        Raises:
            SealegsError: unknown environment or argument, or one that does not fit the robot.
        """
        env_id = registered_id(env_id)
        self._vector, self.keywords = _build(env_id, num_envs, env_kwargs), dict(env_kwargs)
        super().__init__(self._vector.engine, self._vector)
        self.metadata = self._vector.metadata
        self.spec = gym.spec(env_id)
        if seed is not None:
            self.seed(seed)

    def close(self) -> None:
        """Close the renderer."""
        self._vector.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Pictures of all simulations."""
        pictures = self._vector.render()
        return list(pictures) if pictures is not None else [None] * self.num_envs


def _build(env_id: str, num_envs: int, env_kwargs: dict[str, Any]) -> BatchVectorEnv:
    spec = gym.spec(env_id)
    entry = spec.vector_entry_point
    creator = load_env_creator(entry) if isinstance(entry, str) else entry
    if not (isinstance(creator, type) and issubclass(creator, BatchVectorEnv)):
        raise SealegsError(f"environment '{env_id}' is none of this project's; wrap it with SB3's make_vec_env.")
    return creator(**{"max_episode_steps": spec.max_episode_steps, **spec.kwargs, **env_kwargs, "num_envs": num_envs})
