"""Simulations for a learner: many side by side, or one to look at."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
from gymnasium.envs.registration import load_env_creator
from stable_baselines3.common.env_util import make_vec_env as make_dummy_vec_env
from stable_baselines3.common.vec_env import VecEnv

from actuators.errors import SealegsError, nearest
from configs.check import arguments, checked

# Arguments of an environment that are not the config group's business.
_TAKEN = {"self", "render_mode", "actuator", "num_envs", "width", "height"}


def _creator(env_id: str) -> Any:
    try:
        entry = gymnasium.spec(env_id).entry_point
    except gymnasium.error.Error as error:
        known = list(gymnasium.registry)
        raise SealegsError(f"env.id '{env_id}' is not a registered environment{nearest(env_id, known)}.") from error
    return load_env_creator(entry) if isinstance(entry, str) else entry


def _env_arguments(env: Mapping[str, Any]) -> dict[str, Any]:
    creator = _creator(str(env["id"]))
    return arguments(creator.__init__ if isinstance(creator, type) else creator, _TAKEN)


def env_keys(env: Mapping[str, Any]) -> list[str]:
    """Keys that the config group ``env`` accepts: ``id`` and the environment's own arguments."""
    return ["id", *_env_arguments(env)]


def checked_env(env: Mapping[str, Any]) -> dict[str, Any]:
    """The config group ``env`` with every value in the type of the environment's argument.

    Raises:
        SealegsError: an unknown environment or key, or a value of the wrong type.
    """
    types = {"id": str} | _env_arguments(env)
    for key in env:
        if key not in types:
            raise SealegsError(f"env.{key} is not an argument of {env['id']}{nearest(key, types)}.")
    return {key: checked(f"env.{key}", value, types[key]) for key, value in env.items()}


def make_vec_env(env: Mapping[str, Any], actuator: Any, num_envs: int, seed: int) -> VecEnv:
    """``num_envs`` simulations of a checked ``env`` config with the chain ``actuator``; episodes are monitored."""
    keywords = {key: value for key, value in env.items() if key != "id"}
    return make_dummy_vec_env(env["id"], num_envs, seed=seed, env_kwargs=keywords)


def make_single_env(env: Mapping[str, Any], actuator: Any, width: int, height: int) -> gymnasium.Env:
    """One simulation that draws itself into arrays of ``height`` x ``width``."""
    keywords = {key: value for key, value in env.items() if key != "id"}
    return gymnasium.make(env["id"], render_mode="rgb_array", **keywords)
