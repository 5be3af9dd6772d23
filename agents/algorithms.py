"""The learning algorithms, and their construction from a config whose keys are the algorithm's own arguments."""

from __future__ import annotations

import importlib
import logging
import warnings
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
import torch
from annotated_types import Ge, Gt, Le
from gymnasium import Wrapper
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.noise import NormalActionNoise, OrnsteinUhlenbeckActionNoise
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecCheckNan, VecEnv, VecEnvWrapper, VecFrameStack, VecMonitor, VecNormalize

from ..common.errors import SealegsError, nearest
from ..common.extras import needed_for
from ..configs.check import Count, Natural, NotNegative, Positive, arguments, checked

LOGGER = logging.getLogger("sealegs")
ALGORITHMS = {
    **{name: ("stable_baselines3", name.upper()) for name in ("a2c", "ddpg", "ppo", "sac", "td3")},
    **{name: ("sb3_contrib", name.upper()) for name in ("ars", "tqc", "trpo")},
    "crossq": ("sb3_contrib", "CrossQ"),
    "recurrent_ppo": ("sb3_contrib", "RecurrentPPO"),
    **{f"sbx_{name}": ("sbx", name.upper()) for name in ("ddpg", "ppo", "sac", "td3", "tqc")},
}
"""Package and class of each algorithm for continuous actions, by its name in the config."""
ALSO_CALLED = {"ppo_lstm": "recurrent_ppo"}
"""By rl-zoo."""
DISCRETE = ("dqn", "qrdqn", "ppo_mask", "maskable_ppo")
ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU, "elu": torch.nn.ELU}

_PART = Annotated[float, Ge(0), Le(1)]
_SB3_ALL = Annotated[int, Ge(-1)]  # -1: as many as there were steps, or never
BOUNDS: dict[str, Any] = {
    **dict.fromkeys(("n_steps", "batch_size", "n_epochs", "buffer_size", "train_freq"), Count),
    **dict.fromkeys(("target_update_interval", "stats_window_size"), Count),
    **dict.fromkeys(("gradient_steps", "sde_sample_freq"), _SB3_ALL),
    **dict.fromkeys(("gamma", "gae_lambda"), _PART),
    **dict.fromkeys(("learning_rate", "ent_coef", "vf_coef", "noise_std"), NotNegative),
    **dict.fromkeys(("clip_range", "clip_range_vf", "max_grad_norm", "target_kl"), Positive),
    **dict.fromkeys(("clip_obs", "clip_reward", "epsilon"), Positive),
    "learning_starts": Natural,
    "tau": Annotated[float, Gt(0), Le(1)],
}
"""Of numbers that Stable-Baselines3 takes and cannot learn with otherwise, or refuses by a traceback."""

# Arguments that the run itself decides.
_TAKEN = {"self", "env", "seed", "tensorboard_log", "verbose", "_init_setup_model", "action_noise"}
_NOISES = {"normal": NormalActionNoise, "ornstein-uhlenbeck": OrnsteinUhlenbeckActionNoise}
_OURS: dict[str, Any] = {
    "algorithm": str,
    "normalize": dict | bool,
    "history": Count,
    "wrappers": list,
    "callbacks": list,
    "noise_type": Literal["normal", "ornstein-uhlenbeck"] | None,
    "noise_std": float,
}
"""Keys of the group ``agent`` that are no arguments of the algorithm: what is around it."""


def algorithm(name: Any) -> type[BaseAlgorithm]:
    """Class of the algorithm ``name``.

    Raises:
        SealegsError: the name is unknown, or the package that has the algorithm is not installed.
    """
    if name in DISCRETE:
        raise SealegsError(f"agent.algorithm '{name}' chooses among discrete actions, and a robot's are continuous.")
    if ALSO_CALLED.get(name, name) not in ALGORITHMS:
        known = ", ".join(ALGORITHMS)
        raise SealegsError(f"agent.algorithm '{name}' is not known{nearest(str(name), ALGORITHMS)}: there are {known}.")
    package, kind = ALGORITHMS[ALSO_CALLED.get(str(name), str(name))]
    with needed_for(f"agent.algorithm={name}"):
        return getattr(importlib.import_module(package), kind)


def name_of(model: BaseAlgorithm) -> str:
    """Name of the algorithm of a model, which may be of a class of the user's own that builds on one.

    Raises:
        SealegsError: it builds on none of :data:`ALGORITHMS`.
    """
    names = {of: name for name, of in ALGORITHMS.items()}
    classes = [(kind.__module__.partition(".")[0], kind.__name__) for kind in type(model).__mro__]
    found = next((names[of] for of in classes if of in names), None)
    if found is None:
        raise SealegsError(f"{type(model).__name__} is none of the algorithms {', '.join(ALGORITHMS)}.")
    return found


def agent_keys(agent: Mapping[str, Any]) -> list[str]:
    """Keys that the config group ``agent`` accepts, given its algorithm."""
    normalize = [f"normalize.{name}" for name in _normalize_arguments()]
    return [*_OURS, *normalize, *arguments(algorithm(agent.get("algorithm")).__init__, _TAKEN)]


def checked_agent(agent: Mapping[str, Any]) -> dict[str, Any]:
    """The config group ``agent`` with every value in the type of its argument.

    Raises:
        SealegsError: an unknown key, or a value of the wrong type or beyond its bounds.
    """
    types = arguments(algorithm(agent.get("algorithm")).__init__, _TAKEN)
    types |= _OURS
    result: dict[str, Any] = {}
    for key, value in agent.items():
        if key not in types:
            raise SealegsError(f"agent.{key} is not an argument of {agent['algorithm']}{nearest(key, types)}.")
        start = schedule_start(value)
        result[key] = checked(f"agent.{key}", value, types[key]) if start is None else value
        _check_bounds(f"agent.{key}", key, result[key] if start is None else start)
    if isinstance(normalize := result.get("normalize"), dict):
        names = _normalize_arguments()
        for key, value in normalize.items():
            if key not in names:
                raise SealegsError(f"agent.normalize.{key} is not an argument of VecNormalize{nearest(key, names)}.")
            normalize[key] = checked(f"agent.normalize.{key}", value, names[key])
            _check_bounds(f"agent.normalize.{key}", key, normalize[key])
    for kind in ("wrappers", "callbacks"):
        for item in result.get(kind, ()):
            made(kind, item)
    return result


def _check_bounds(where: str, key: str, value: Any) -> None:
    """Refuse a number beyond :data:`BOUNDS`; words such as ``auto`` pass."""
    if key in BOUNDS and isinstance(value, int | float):
        checked(where, value, BOUNDS[key])


def wrapped(env: VecEnv, agent: Mapping[str, Any], training: bool) -> VecEnv:
    """``env`` in what the config puts around it: history, wrappers, normaliser.

    Rewards are normalised in training only.
    """
    if agent.get("history", 1) > 1:
        env = VecFrameStack(env, agent["history"])
    for item in agent.get("wrappers", ()):
        env = wrapper(item, env)
    options = agent.get("normalize", False)
    if not options:
        return env
    options = {"gamma": agent.get("gamma", 0.99)} | (options if isinstance(options, dict) else {})
    normalizer = VecNormalize(env, training=training, **options)
    normalizer.norm_reward &= training
    return normalizer


def build(agent: Mapping[str, Any], env: VecEnv, seed: int | None) -> BaseAlgorithm:
    """New learner for ``env`` with the arguments of a checked ``agent`` config; without a ``seed`` none is set.

    Raises:
        SealegsError: Stable-Baselines3 refuses the arguments.
    """
    keywords = {key: value for key, value in agent.items() if key not in _OURS}
    for key, value in keywords.items():
        if (start := schedule_start(value)) is not None:
            keywords[key] = LinearSchedule(start, 0.0, 1.0)
    if keywords.get("policy_kwargs"):
        keywords["policy_kwargs"] = _policy_keywords(keywords["policy_kwargs"], agent["algorithm"])
    if (kind := agent.get("noise_type")) is not None:
        shape = env.action_space.shape or ()
        noise = np.full(shape, float(agent.get("noise_std", 0.1)), np.float32)
        keywords["action_noise"] = _NOISES[kind](np.zeros(shape, np.float32), noise)
    if isinstance(every := keywords.get("train_freq"), list):  # [1, episode], as rl-zoo writes it
        keywords["train_freq"] = tuple(every)
    _fit_batches(keywords, agent["algorithm"], env.num_envs)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "You have specified a mini-batch size", UserWarning)  # said above
            return algorithm(agent["algorithm"])(env=env, seed=seed, **keywords)
    except (AssertionError, TypeError, ValueError, RuntimeError) as error:
        reason = str(error).strip().splitlines() or [type(error).__name__]
        raise SealegsError(f"Stable-Baselines3 refuses the agent's arguments: {reason[0]}") from error


def _fit_batches(keywords: dict[str, Any], name: str, num_envs: int) -> None:
    """Limit minibatches of PPO to what is collected between updates, and say if they do not divide it.

    A larger one is what was collected: nothing changes but Stable-Baselines3's warning, which speaks of keys that no
    config has.
    """
    size, steps = keywords.get("batch_size"), keywords.get("n_steps")
    if (
        name not in ("ppo", "recurrent_ppo", "sbx_ppo")
        or not isinstance(size, int)
        or not isinstance(steps, int)
        or size < 2
        or steps * num_envs < 2
    ):
        return  # which is refused
    collected = steps * num_envs
    keywords["batch_size"] = min(size, collected)
    if rest := collected % keywords["batch_size"]:
        near = max(part for part in range(1, size + 1) if collected % part == 0)
        LOGGER.warning(
            "agent.batch_size=%d leaves a minibatch of %d of the %d steps between updates (agent.n_steps=%d times "
            "n_envs=%d); agent.batch_size=%d divides them.",
            size, rest, collected, steps, num_envs, near,
        )  # fmt: skip


def _normalize_arguments() -> dict[str, Any]:
    return arguments(VecNormalize.__init__, {"self", "venv", "training", "gamma"})


def schedule_start(value: Any) -> float | None:
    """Start of the linear schedule that rl-zoo writes ``lin_3e-4``; None where a value is none."""
    if not isinstance(value, str) or not value.startswith("lin_"):
        return None
    try:
        return float(value.removeprefix("lin_"))
    except ValueError:
        return None


def _policy_keywords(keywords: Mapping[str, Any], algorithm_name: str) -> dict[str, Any]:
    result = dict(keywords)
    name = result.get("activation_fn")
    if name is not None:
        if name not in ACTIVATIONS:
            known = ", ".join(ACTIVATIONS)
            raise SealegsError(f"agent.policy_kwargs.activation_fn '{name}' is not known: there are {known}.")
        jax = algorithm_name.startswith("sbx_")
        result["activation_fn"] = getattr(importlib.import_module("jax.nn"), name) if jax else ACTIVATIONS[name]
    return result


# --- callbacks and wrappers that a config names by their class, such as those of rl-zoo's files ----------------------
#
#     agent.callbacks=[stable_baselines3.common.callbacks.StopTrainingOnMaxEpisodes: {max_episodes: 100}]
#     agent.wrappers=[stable_baselines3.common.vec_env.VecCheckNan]
#
# A class is code. Those of the packages that sealegs stands on may be named by any config; others only by the person
# who starts the run, and again by whoever resumes it (``trust=true``).

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
