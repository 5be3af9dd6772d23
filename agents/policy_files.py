"""Policies on disk: the model, its normaliser, and the description that another program needs to run it."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecFrameStack, VecNormalize, unwrap_vec_wrapper

from ..common.documents import read_json
from ..common.errors import SealegsError
from ..configs.check import checked
from ..envs.any_robot.user import trained_in
from ..envs.engine.sb3 import BatchVecEnv
from .make_env import Actuator, checked_env, make_vec_env
from .weights import FILE, ZIP, UntrustedError, is_jax, read_weights, read_zip, twin, write_weights


def save_policy(folder: Path, model: BaseAlgorithm, description: dict[str, Any]) -> None:
    """Write ``policy.safetensors`` and ``policy.json``, which hold all of a policy.

    Raises:
        OSError: the disk is full.
    """
    write_weights(folder, twin(model) if is_jax(model) else model)
    (folder / "policy.json").write_text(
        json.dumps(describe(model, model.get_vec_normalize_env()) | description, indent=2)
    )


def save_for_sb3(folder: Path, model: BaseAlgorithm) -> None:
    """Write ``model.zip`` and ``vecnormalize.pkl`` for users of Stable-Baselines3; nothing here reads them.

    Raises:
        OSError: the disk is full.
    """
    if is_jax(model):  # which Stable-Baselines3 cannot read
        return
    archive = (
        io.BytesIO()
    )  # torch reports a full disk as a RuntimeError without a reason; a plain write says what it is
    model.save(archive)
    (folder / ZIP).write_bytes(archive.getvalue())
    if (normalizer := model.get_vec_normalize_env()) is not None:
        normalizer.save(str(folder / "vecnormalize.pkl"))


def describe(model: BaseAlgorithm, normalizer: VecNormalize | None, env: Any = None) -> dict[str, Any]:
    """Observation and action as numbers: shapes, limits, and the normaliser.

    A policy sees ``clip((x - mean) / sqrt(variance + epsilon), -clip, clip)`` of an observation ``x``, which is
    ``history`` observations of the environment, the newest last.

    Args:
        model: the policy's.
        normalizer: of its observations.
        env: that it learned in; None: the model's own.
    """
    observation: dict[str, Any] = {"shape": list(model.observation_space.shape or ())}
    around: Any = env or model.get_env()
    if (stack := unwrap_vec_wrapper(around, VecFrameStack)) is not None:
        observation["history"] = int(stack.stacked_obs.n_stack)
    if normalizer is not None and normalizer.norm_obs and not isinstance(normalizer.obs_rms, dict):
        observation |= {
            "mean": normalizer.obs_rms.mean.tolist(),
            "variance": normalizer.obs_rms.var.tolist(),
            "epsilon": normalizer.epsilon,
            "clip": normalizer.clip_obs,
        }
    space: Any = model.action_space
    action = {"shape": list(space.shape), "low": space.low.tolist(), "high": space.high.tolist()}
    return {"step": model.num_timesteps, "observation": observation, "action": action}


def load_model(folder: Path, trust: bool = False) -> tuple[BaseAlgorithm, dict[str, Any]]:
    """The model of a saved policy, for acting, and its description.

    Args:
        folder: with ``policy.json`` and ``policy.safetensors``, such as a run's ``best/``.
        trust: read ``model.zip`` of Stable-Baselines3 where there is no ``policy.safetensors``. It can run code.

    Raises:
        SealegsError: ``folder`` holds no policy that can be read, or only one that nobody said to trust.
    """
    try:
        if not (folder / "policy.json").is_file():
            raise SealegsError("it has no policy.json")
        description = read_json(folder / "policy.json")
        if not isinstance(description, dict):
            raise SealegsError("its policy.json holds no mapping")
        if (folder / FILE).is_file():
            model = read_weights(folder, description)
        else:
            model = read_zip(folder, description["algorithm"], trust, device="cpu")
        description["observation"], description["env"], description["actuators"]
    except UntrustedError:
        raise
    except (OSError, ValueError, LookupError) as error:
        why = str(error).rstrip(".") if not isinstance(error, KeyError) else f"its policy.json has no {error}"
        raise SealegsError(
            f"{folder} holds no policy that can be read ({why}); give a run's best/ or final/."
        ) from error
    return model, description


class Acting:
    """A policy as a function from observations (n, size) to deterministic actions (n, k).

    It keeps what the policy remembers of each simulation: earlier observations, and the state of a recurrent network.
    """

    def __init__(self, model: BaseAlgorithm, observation: Mapping[str, Any]) -> None:
        """``observation``: of the policy's description."""
        self._model, self._seen, self._count = model, seen_as_trained(observation), int(observation.get("history", 1))
        self._rows, self._state, self._stack = 0, None, np.empty((0, 0))

    def __call__(self, observation: np.ndarray, started: np.ndarray | None = None) -> np.ndarray:
        """Actions; ``started``: simulations (n,) in which an episode began with this observation, None: none but at
        the first call."""
        rows, size = observation.shape
        first = rows != self._rows
        began = np.full(rows, True) if first else np.zeros(rows, bool) if started is None else started
        if first:
            self._rows, self._state, self._stack = rows, None, np.zeros((rows, self._count * size), np.float32)
        self._stack[began] = 0.0
        self._stack = np.concatenate([self._stack[:, size:], observation], axis=1, dtype=np.float32)
        action, self._state = self._model.predict(self._seen(self._stack), self._state, began, deterministic=True)
        return action


def load_policy(folder: Path, trust: bool = False) -> tuple[Acting, dict[str, Any]]:
    """A saved policy, ready to act, and its description.

    Arguments and errors as of :func:`load_model`.
    """
    model, description = load_model(folder, trust)
    return Acting(model, description["observation"]), description


def trained_env(description: Mapping[str, Any], folder: Path, task: str | None) -> dict[str, Any]:
    """The environment of a saved policy, checked.

    Args:
        description: of its ``policy.json``.
        folder: that holds it.
        task: as of :func:`sealegs.envs.any_robot.user.trained_in`.

    Raises:
        SealegsError: it is none, has no such argument, or is one of a file that nobody named.
    """
    where = folder / "policy.json"
    try:
        env = trained_in(checked("env", description["env"], dict), str(folder), task)
        checked_env({**env, "id": checked("env.id", env.get("id"), str)})
    except SealegsError as error:
        said = str(error)
        raise SealegsError(said if said.startswith(str(folder)) else f"{where}: {said}") from None
    return env


def seen_as_trained(description: Mapping[str, Any]) -> Callable[[np.ndarray], np.ndarray]:
    """The normaliser in ``observation`` of a policy's description, as a function of observations."""
    if "mean" not in description:
        return lambda observation: observation
    mean, scale = np.asarray(description["mean"]), np.sqrt(np.asarray(description["variance"]) + description["epsilon"])
    clip = description["clip"]
    return lambda observation: np.clip((observation - mean) / scale, -clip, clip).astype(np.float32)


def policy_of(model: BaseAlgorithm) -> Acting:
    """A model in memory as :func:`load_policy` returns it, with the normaliser as it is now."""
    return Acting(model, describe(model, model.get_vec_normalize_env())["observation"])


def policy_step(folder: Path) -> int | None:
    """Step at which the policy in ``folder`` was saved; None if there is no readable policy."""
    return _described(folder, "step")


def policy_reward(folder: Path) -> float:
    """Mean reward with which the policy in ``folder`` was saved; minus infinity if there is no readable policy."""
    reward = _described(folder, "mean_reward")
    return float(reward) if isinstance(reward, int | float) else -math.inf


def _described(folder: Path, key: str) -> Any:
    try:
        return read_json(folder / "policy.json")[key]
    except (OSError, ValueError, LookupError, TypeError):
        return None


# --- evaluation of a policy on another actuator than that of its training --------------------------------------------


def mean_reward(
    policy: Path, actuator: Actuator, episodes: int = 16, seed: int = 0, task: str | None = None, trust: bool = False
) -> float:
    """Mean episode reward of a saved policy with the chain ``actuator`` in its robot.

    Args:
        policy: folder with ``policy.safetensors`` and ``policy.json``.
        actuator: name or path of a chain, or chains by joint.
        episodes: to average over; they start alike for equal seeds, whatever the policy.
        seed: of the episodes.
        task: as of :func:`sealegs.agents.export.export_policy`.
        trust: likewise.
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
