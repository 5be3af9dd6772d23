"""Environments for a learner: many in parallel, or one to render; and their independent seeds."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import load_env_creator

from ..common.errors import SealegsError, nearest
from ..configs.check import arguments, checked
from ..envs import known_id
from ..envs.described.robot_file import is_robot_file
from ..envs.engine.randomization import read_randomization
from ..envs.engine.sb3 import BatchVecEnv

Actuator = str | list[Any] | dict[str, Any] | None
"""Chain of all coordinates (name, path or stages), or chains by coordinate; None: the robot's own."""

# Arguments of an environment that other keys of the config set.
_TAKEN = {"render_mode", "actuator", "width", "height"}


def env_keys(env: Mapping[str, Any]) -> list[str]:
    """Keys that the config group ``env`` accepts: ``id`` and the environment's own arguments."""
    return ["id", *_env_arguments(env)]


def checked_env(env: Mapping[str, Any]) -> dict[str, Any]:
    """The config group ``env`` with every value in the type of the environment's argument, files read.

    Raises:
        SealegsError: an unknown environment or key, a value of the wrong type, or a file that cannot be read.
    """
    types = {"id": str} | _env_arguments(env)
    for key in env:
        if key == "robot" and key not in types:
            raise SealegsError(
                f"{env['id']} has a robot of its own and takes no robot={env[key]}; env=track, env=reach and env=walk "
                f"take any: sealegs train env=track robot={env[key]}."
            )
        if key not in types:
            raise SealegsError(f"env.{key} is not an argument of {env['id']}{nearest(key, types)}.")
    values = {key: checked(f"env.{key}", value, types[key]) for key, value in env.items()}
    if isinstance(source := values.get("randomization"), str):  # a run keeps what it draws from, as it does its chains
        values["randomization"] = dict(read_randomization(source))
    if is_robot_file(word := str(values.get("robot", ""))):  # the same file from any folder
        values["robot"] = str(Path(word).absolute())
    return values


def make_vec_env(env: Mapping[str, Any], actuator: Actuator, num_envs: int, seed: int) -> BatchVecEnv:
    """``num_envs`` simulations of a checked ``env`` config, with the chain ``actuator``."""
    return BatchVecEnv(known_id(env["id"]), num_envs, seed=seed, actuator=actuator, **_keywords(env))


def make_single_env(env: Mapping[str, Any], actuator: Actuator, width: int, height: int) -> gymnasium.Env:
    """One simulation that draws itself into arrays of ``height`` x ``width`` x 3."""
    size = {"width": width, "height": height}
    return gymnasium.make(known_id(env["id"]), render_mode="rgb_array", actuator=actuator, **size, **_keywords(env))


def stream_seed(seed: int, *stream: int) -> int:
    """Seed of one use of randomness in a run: uses, and runs with neighbouring seeds, share no random numbers.

    Simulation i gets this seed plus i, which stays below 2**32.
    """
    return int(np.random.SeedSequence([seed, *stream]).generate_state(1)[0]) >> 1


def _keywords(env: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in env.items() if key != "id"}


def _env_arguments(env: Mapping[str, Any]) -> dict[str, Any]:
    entry = gymnasium.spec(known_id(str(env["id"]))).entry_point
    creator: Any = load_env_creator(entry) if isinstance(entry, str) else entry
    return arguments(creator, _TAKEN)
