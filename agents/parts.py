"""Callbacks and wrappers that a config names by their class, such as those of rl-zoo's files.

    agent.callbacks=[stable_baselines3.common.callbacks.StopTrainingOnMaxEpisodes: {max_episodes: 100}]
    agent.wrappers=[stable_baselines3.common.vec_env.VecCheckNan]

A class is code. Those of the packages that sealegs stands on may be named by any config; others only by the person who
starts the run, and again by whoever resumes it (``trust=true``).
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any

from gymnasium import Wrapper
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecCheckNan, VecEnv, VecEnvWrapper, VecFrameStack, VecMonitor, VecNormalize

from ..common.errors import SealegsError
from ..configs.check import checked

KNOWN = ("stable_baselines3", "sb3_contrib", "sealegs")
TRANSPARENT = (VecCheckNan, VecFrameStack, VecMonitor, VecNormalize)
"""Wrappers that leave actions as they are, and observations but for what an exported policy does itself."""
_BASES: dict[str, type] = {"callbacks": BaseCallback, "wrappers": VecEnvWrapper}


def made(kind: str, item: Any) -> tuple[type, dict[str, Any]]:
    """Class and arguments that an item of ``callbacks`` or ``wrappers`` names.

    Args:
        kind: ``callbacks`` or ``wrappers``.
        item: ``package.module.Class``, or a mapping from it to its arguments.

    Raises:
        SealegsError: there is no such class, or it is none of that kind.
    """
    word, keywords = next(iter(item.items())) if isinstance(item, Mapping) and len(item) == 1 else (item, None)
    word = checked(f"agent.{kind}", word, str, f"agent.{kind} takes package.module.Class, or one with its arguments.")
    keywords = checked(f"agent.{kind}.{word}", {} if keywords is None else keywords, dict[str, Any])
    module, _, name = word.rpartition(".")
    try:
        found = getattr(importlib.import_module(module), name)
    except (ImportError, ValueError, AttributeError) as error:
        raise SealegsError(f"agent.{kind} names {word}, which there is not ({error}).") from None
    if isinstance(found, type) and issubclass(found, Wrapper):
        raise SealegsError(
            f"agent.{kind} names {word}, which wraps one simulation; the simulations of a run are one batch: give a "
            "VecEnvWrapper, agent.history=<n> for earlier observations, or your own script."
        )
    if not (isinstance(found, type) and issubclass(found, _BASES[kind])):
        raise SealegsError(f"agent.{kind} names {word}, which is no {_BASES[kind].__name__}.")
    return found, keywords


def callback(item: Any) -> BaseCallback:
    """The callback that an item of the config names."""
    return _called("callbacks", item)


def wrapper(item: Any, env: VecEnv) -> VecEnv:
    """``env`` in the wrapper that an item of the config names."""
    return _called("wrappers", item, env)


def foreign(agent: Mapping[str, Any]) -> list[str]:
    """Classes that a config names of packages that are not :data:`KNOWN`."""
    words = [next(iter(item)) if isinstance(item, Mapping) and item else item for item in _items(agent)]
    return [str(word) for word in words if str(word).partition(".")[0] not in KNOWN]


def _items(agent: Mapping[str, Any]) -> list[Any]:
    return [item for kind in _BASES for item in agent.get(kind) or ()]


def _called(kind: str, item: Any, *given: Any) -> Any:
    found, keywords = made(kind, item)
    try:
        return found(*given, **keywords)
    except (TypeError, ValueError, AssertionError) as error:
        raise SealegsError(f"agent.{kind}: {found.__name__} refuses its arguments: {error}.") from None
