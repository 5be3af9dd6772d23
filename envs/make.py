"""Robots and environments by name, as believed or as a diagnosis found them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium

from ..common.errors import SealegsError, nearest
from . import register_environments, registered_id
from .any_robot.user import is_user_task
from .engine.robot import ChainSource, Robot
from .extended import Extended, extended_arguments, names_diagnosis, with_machines
from .robots import get_robot


def load_robot(name: str | Path) -> Robot:
    """A robot by its name or its file (a YAML, or an MJCF or URDF): its numbers, driven coordinates and model.

    Raises:
        SealegsError: there is no such robot.
    """
    return get_robot(name)


def environment_id(name: str) -> str:
    """The Gymnasium id of an environment that is given by its id, its robot's name in any case, or
    ``path/to/task.py:MyTask``.

    Raises:
        SealegsError: there is no such environment.
    """
    register_environments()
    if not isinstance(name, str):
        raise SealegsError(f"an environment is a name such as 'hopper' or 'path/to/task.py:MyTask', not {name!r}.")
    if is_user_task(name):
        return registered_id(name)
    known = [key for key in gymnasium.registry if key.startswith("SeaLegs/")]
    words = {key.rpartition("/")[2].rpartition("-")[0].lower(): key for key in known}
    found = words.get(name.lower().replace("_", ""), name)
    if found not in known:
        raise SealegsError(f"there is no environment '{name}'{nearest(name, [*words, *known])}: {', '.join(words)}.")
    return found


def make_env(
    name: str,
    num_envs: int | None = None,
    *,
    extended: Extended | str | Path | None = None,
    actuator: ChainSource | Mapping[str, ChainSource] | None = None,
    params: Mapping[str, float] | None = None,
    sb3: bool = False,
    **arguments: Any,
) -> Any:
    """A Gymnasium environment of a robot, as believed or as a diagnosis found it.

    Args:
        name: id such as ``SeaLegs/Hopper-v0``, the robot's or the task's name, or ``path/to/task.py:MyTask``.
        num_envs: number of environments in a vector environment; None: a single environment.
        extended: ``extended`` of a diagnosis, or the folder of one: chains and numbers of the robot.
        actuator: chain of all joints, or chains by joint, in place of the robot's own; not with ``extended``.
        params: numbers of the robot that differ from its own.
        sb3: for Stable-Baselines3, whose vector environments are others than Gymnasium's.
        arguments: further ones of the environment, such as ``robot`` (of ``track`` and ``reach``: a name or a file),
            ``render_mode``, or weights of its reward. ``randomization`` may be a diagnosis as well: each episode draws
            one of the machines that its log does not tell apart, and ``extended`` is that diagnosis where no other
            model is given.

    Returns:
        A ``gymnasium.Env``, or a ``gymnasium.vector.VectorEnv`` where ``num_envs`` is given; with ``sb3`` a
        :class:`sealegs.envs.engine.sb3.BatchVecEnv`.

    Raises:
        SealegsError: there is no such environment, an argument is wrong, or the environment's robot cannot take what
            the diagnosis found.
    """
    found = environment_id(name)
    randomization, believed = arguments.get("randomization"), params
    if extended is None and actuator is None and names_diagnosis(randomization):
        extended = randomization
    if extended is not None:
        actuator, params = extended_arguments(found, extended, actuator, params, arguments.get("robot"))
    keywords = {"actuator": actuator, "params": params, **arguments}
    if randomization is not None:
        keywords["randomization"] = with_machines(randomization, found, believed, arguments.get("robot"))
    if sb3:
        from .engine.sb3 import BatchVecEnv

        return BatchVecEnv(found, num_envs or 1, **keywords)
    if num_envs is None:
        return gymnasium.make(found, **keywords)
    return gymnasium.make_vec(found, num_envs=num_envs, **keywords)
