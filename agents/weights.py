"""Weights, optimisers and buffers on disk as safetensors: numbers with names and shapes, which cannot run code.

Stable-Baselines3's own ``model.zip`` holds pickles, and loading a pickle runs whatever its author wrote into it. So a
folder of ours is never read by way of them; a foreign one is, where its reader says ``trust=true``.
"""

from __future__ import annotations

import importlib
import itertools
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import gymnasium
import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import DummyVecEnv

from ..common.documents import parse_json, regular
from ..common.errors import SealegsError
from ..configs.check import arguments
from .algorithms import ACTIVATIONS, ALGORITHMS, algorithm, build, name_of

FILE = "policy.safetensors"
ZIP = "model.zip"
MOST = 2**36  # [B] of a file, such as the replay buffer of a large machine
_ABOUT = "sealegs"  # entry of a file's metadata, a JSON document
_NUMBERS = ("log_std_init", "n_critics", "n_quantiles", "lstm_hidden_size", "n_lstm_layers")
_FLAGS = (
    *("ortho_init", "full_std", "use_expln", "squash_output", "share_features_extractor", "with_bias", "batch_norm"),
    *("shared_lstm", "enable_critic_lstm"),
)
_POLICIES = ("MlpPolicy", "LinearPolicy", "MlpLstmPolicy")
_DEFAULT_SIZES = {"sac": (256, 256), "tqc": (256, 256), "crossq": (256, 256), "td3": (400, 300), "ddpg": (400, 300)}
"""Of hidden layers, where a config names none; (64, 64) of the others."""


Loaded = TypeVar("Loaded")


class UntrustedError(SealegsError):
    """A pickle that nobody said to trust."""


def untrusted(path: Path) -> UntrustedError:
    """The refusal of a file that could run code."""
    return UntrustedError(
        f"{path} is a pickle, which can run any code while it is loaded, and there is no {FILE} beside it: give "
        "trust=true if you trust whoever made it."
    )


# --- files of numbers ------------------------------------------------------------------------------------------------


def write_tensors(path: Path, tensors: Mapping[str, torch.Tensor], about: Mapping[str, Any]) -> None:
    """Write tensors, and what is to be known about them.

    Raises:
        OSError: the disk is full.
    """
    plain = {name: value.detach().cpu().clone().contiguous() for name, value in tensors.items()}
    path.write_bytes(save(plain, {_ABOUT: json.dumps(about)}))  # the library tells a full disk in a way of its own


def read_tensors(path: Path) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    """Tensors of a file, all of them finite, and what was written about them.

    Raises:
        SealegsError: the file is none, or is damaged.
    """
    regular(path, MOST)
    try:
        with safe_open(path, framework="pt") as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 the handle is no mapping
            about = parse_json((file.metadata() or {})[_ABOUT], path)
    except (OSError, SafetensorError, ValueError, LookupError, RuntimeError) as error:
        raise SealegsError(
            f"{path} cannot be read ({_first_line(error)}); it is damaged, or no file of ours."
        ) from None
    if not isinstance(about, dict):
        raise SealegsError(f"{path} cannot be read (its metadata are no mapping); it is damaged, or no file of ours.")
    for name, value in tensors.items():
        if value.is_floating_point() and not bool(torch.isfinite(value).all()):
            raise SealegsError(f"{path}: '{name}' holds a number that is not finite; the file is damaged.")
    return tensors, about


def check_like(tensors: Mapping[str, torch.Tensor], wanted: Mapping[str, torch.Tensor], where: Path) -> None:
    """Make sure that there are tensors of these names, shapes and types, and no others.

    Raises:
        SealegsError: there are not; the message names the first.
    """
    for name in sorted({*tensors, *wanted}):
        if name not in tensors or name not in wanted:
            raise SealegsError(f"{where} does not fit: '{name}' is {'missing' if name in wanted else 'not known'}.")
        here, there = tensors[name], wanted[name]
        if here.shape != there.shape or here.dtype != there.dtype:
            raise SealegsError(f"{where} does not fit: '{name}' is {_kind(here)}, and {_kind(there)} is needed.")


def _kind(tensor: torch.Tensor) -> str:
    return f"{str(tensor.dtype).removeprefix('torch.')} {list(tensor.shape)}"


# --- policies --------------------------------------------------------------------------------------------------------


def write_weights(folder: Path, model: BaseAlgorithm) -> None:
    """Write the weights of a policy, and which network they are of.

    Raises:
        OSError: the disk is full.
        SealegsError: the network is none that can be built from plain data.
    """
    write_tensors(folder / FILE, model.policy.state_dict(), _network(model))


def read_weights(folder: Path, description: Mapping[str, Any]) -> BaseAlgorithm:
    """The model of a folder, for acting only: it has no simulations to learn in.

    Args:
        folder: with :data:`FILE`.
        description: of ``policy.json``: what goes in and comes out.

    Raises:
        SealegsError: weights, network and description do not fit one another.
    """
    path = folder / FILE
    tensors, about = read_tensors(path)
    name = _checked_network(about, path)
    spaces = _spaces(description, folder, sum(value.numel() for value in tensors.values()), about)
    model = for_acting({**about, "algorithm": name}, *spaces)
    check_like(tensors, model.policy.state_dict(), path)
    model.policy.load_state_dict(tensors)
    return model


def for_acting(about: Mapping[str, Any], observations: gymnasium.Space, actions: gymnasium.Space) -> BaseAlgorithm:
    """A model of a network, with whatever weights, and without simulations to learn in.

    Args:
        about: the network: ``algorithm``, ``policy``, ``use_sde``, ``policy_kwargs``.
        observations, actions: what goes in and comes out.
    """
    taken = arguments(algorithm(about["algorithm"]).__init__)
    sizes = {"buffer_size": 1} if "buffer_size" in taken else {"n_steps": 2, "batch_size": 2}  # nothing is learnt
    small = {key: value for key, value in {**sizes, "use_sde": about["use_sde"]}.items() if key in taken}
    network = {"policy": about.get("policy", "MlpPolicy"), "policy_kwargs": about["policy_kwargs"]}
    env = DummyVecEnv([lambda: _Nothing(observations, actions)])
    return build({"algorithm": about["algorithm"], **network, **small, "device": "cpu"}, env, None)


class _Nothing(gymnasium.Env):
    """What goes in and comes out of a policy, without a simulation between."""

    def __init__(self, observation_space: gymnasium.Space, action_space: gymnasium.Space) -> None:
        self.observation_space, self.action_space = observation_space, action_space


def _network(model: BaseAlgorithm) -> dict[str, Any]:
    """What a policy's network is made of, as plain data."""
    names, activation = {kind: name for name, kind in ACTIVATIONS.items()}, model.policy_kwargs.get("activation_fn")
    given = {key: value for key, value in model.policy_kwargs.items() if key in ("net_arch", *_NUMBERS, *_FLAGS)}
    if activation is not None:
        if activation not in names:
            raise SealegsError(
                f"weights behind the activation {activation.__name__} cannot be saved; take one of "
                f"{', '.join(ACTIVATIONS)}."
            )
        given["activation_fn"] = names[activation]
    policy = next((name for name in _POLICIES if model.policy_aliases.get(name) is type(model.policy)), None)
    if policy is None:
        raise SealegsError(f"weights of a {type(model.policy).__name__} cannot be saved; take {', '.join(_POLICIES)}.")
    use_sde = bool(getattr(model, "use_sde", False))
    return {"algorithm": name_of(model), "policy": policy, "use_sde": use_sde, "policy_kwargs": given}


def _checked_network(about: Mapping[str, Any], where: Path) -> str:
    """The algorithm's name, once all that names the network is of its type.

    Raises:
        SealegsError: it is not.
    """
    name, keywords = about.get("algorithm"), about.get("policy_kwargs")
    known = isinstance(name, str) and name in ALGORITHMS and about.get("policy", "MlpPolicy") in _POLICIES
    if not (known and isinstance(about.get("use_sde"), bool) and isinstance(keywords, dict)):
        raise SealegsError(f"{where} names no network that can be built here; export the policy again.")
    for key, value in keywords.items():
        sizes = value.values() if isinstance(value, dict) else [value]
        good = (
            (key in _FLAGS and isinstance(value, bool))
            or (key in _NUMBERS and _is_number(value))
            or (key == "activation_fn" and value in list(ACTIVATIONS))
            or (key == "net_arch" and all(map(_are_sizes, sizes)))
        )
        if not good:
            raise SealegsError(f"{where}: the network's '{key}' is {str(value)[:60]!r}, which cannot be built here.")
    return str(name)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _are_sizes(value: Any) -> bool:
    return isinstance(value, list) and all(type(size) is int and size > 0 for size in value)


def _least_weights(about: Mapping[str, Any], inputs: int, outputs: int) -> float:
    """Fewest numbers that such a network can have."""
    keywords = about["policy_kwargs"]
    default = [] if about.get("policy") == "LinearPolicy" else _DEFAULT_SIZES.get(about["algorithm"], (64, 64))
    sizes = keywords.get("net_arch", default)
    chains = list(sizes.values()) if isinstance(sizes, dict) else [sizes]
    hidden, layers = (
        keywords.get("lstm_hidden_size", 256 * (about["algorithm"] == "recurrent_ppo")),
        keywords.get("n_lstm_layers", 1),
    )
    recurrent = 4 * hidden * (inputs + hidden + 2 * hidden * (layers - 1)) if hidden else layers - 1
    each = [sum(a * b for a, b in itertools.pairwise([hidden or inputs, *chain])) for chain in chains] or [0]
    critics = keywords.get("n_critics", 1)
    quantiles = keywords.get("n_quantiles", 0) * critics
    return max(each) + max(1, min(each)) * (critics - 1) + recurrent + quantiles + max(inputs, outputs)


def _spaces(
    description: Mapping[str, Any], folder: Path, weights: int, about: Mapping[str, Any]
) -> tuple[gymnasium.spaces.Box, gymnasium.spaces.Box]:
    """Observations and actions of a ``policy.json``, once there are ``weights`` enough for them.

    Raises:
        SealegsError: they are not described as it describes them, or a file would have memory asked for at will.
    """
    try:
        seen, done = (tuple(description[key]["shape"]) for key in ("observation", "action"))
        low, high = (np.asarray(description["action"][key], np.float32) for key in ("low", "high"))
        sound = _are_sizes(list(seen)) and low.shape == high.shape == done and bool((low < high).all())
        if not (sound and seen and done):
            raise ValueError("its shapes or limits are none")
    except (LookupError, TypeError, ValueError, OverflowError) as error:
        raise SealegsError(f"{folder / 'policy.json'} does not say what goes in and comes out ({error}).") from None
    if _least_weights(about, math.prod(seen), math.prod(done)) > weights:
        raise SealegsError(f"{folder / FILE} does not fit: the network that it names has more weights than it holds.")
    return gymnasium.spaces.Box(-np.inf, np.inf, seen, np.float32), gymnasium.spaces.Box(low, high, done, np.float32)


def _first_line(error: Exception) -> str:
    return str(error).strip().partition("\n")[0].rstrip(".") or type(error).__name__


# --- files of Stable-Baselines3 --------------------------------------------------------------------------------------


def read_zip(folder: Path, name: Any, trust: bool, **arguments: Any) -> BaseAlgorithm:
    """The model of Stable-Baselines3's ``model.zip``, whose author can run code here.

    Args:
        folder: that holds it.
        name: of the algorithm.
        trust: whether the person at the keyboard, or the caller, said that they trust its author.
        arguments: of Stable-Baselines3's ``load``.

    Raises:
        UntrustedError: nobody said so.
        SealegsError: it cannot be read.
    """
    path, kind = folder / ZIP, algorithm(name)
    if not path.is_file():
        raise SealegsError(f"{folder} has neither {FILE} nor {ZIP}.")
    if not trust:
        raise untrusted(path)
    return loaded(path, lambda: kind.load(path, **arguments))


def loaded(path: Path, load: Callable[[], Loaded]) -> Loaded:
    """What a reader of a trusted pickle makes of a file.

    Raises:
        SealegsError: it cannot be read.
    """
    try:
        return load()
    except Exception as error:  # torch, zip, pickle and its content have classes of their own for each kind of damage
        raise SealegsError(f"{path} cannot be read ({_first_line(error)}).") from error


# --- learners of SBX, whose networks are JAX's: their policies become those of Stable-Baselines3, layer by layer -----
#
# So a run folder, an ONNX file and whoever acts with them need no JAX. What the next update depends on is kept as
# numbers with names, as for other learners (:mod:`agents.checkpoint`).

TWINS = {"PPO": "ppo", "SAC": "sac", "TQC": "sac", "TD3": "td3", "DDPG": "td3"}
"""By class of SBX, an algorithm of Stable-Baselines3 whose actor has the same layers."""
_STATE = "jax."


def is_jax(model: BaseAlgorithm) -> bool:
    """Whether a learner is one of SBX."""
    return any(kind.__module__.partition(".")[0] == "sbx" for kind in type(model).__mro__)


def twin(model: Any) -> BaseAlgorithm:
    """A model of Stable-Baselines3 that acts as one of SBX does; its critic knows nothing.

    Raises:
        SealegsError: its actor is none of dense layers.
    """
    name = TWINS.get(type(model).__name__)
    actor, layers = model.policy.actor, model.policy.actor_state.params["params"]
    dense = [layers[f"Dense_{k}"] for k in range(len(actor.net_arch) + 1) if f"Dense_{k}" in layers]
    if name is None or len(dense) != len(actor.net_arch) + 1:
        raise SealegsError(f"a policy of SBX's {type(model).__name__} has no counterpart in Stable-Baselines3.")
    sizes = list(actor.net_arch)
    about = {
        "algorithm": name,
        "use_sde": False,
        "policy_kwargs": {
            "net_arch": {"pi": sizes, "vf" if name == "ppo" else "qf": sizes},
            "activation_fn": str(getattr(actor.activation_fn, "__name__", actor.activation_fn)),
        },
    }
    made = for_acting(about, model.observation_space, model.action_space)
    policy: Any = made.policy
    if isinstance(policy, ActorCriticPolicy):
        linear = [*policy.mlp_extractor.policy_net, policy.action_net]
    else:
        linear = [*getattr(policy.actor, "latent_pi", ()), *_flat(policy.actor.mu)]
    with torch.no_grad():
        for layer, values in zip([item for item in linear if isinstance(item, torch.nn.Linear)], dense, strict=True):
            layer.weight.copy_(torch.from_numpy(np.array(values["kernel"]).T.copy()))
            layer.bias.copy_(torch.from_numpy(np.array(values["bias"])))
    return made


def _flat(layers: torch.nn.Module) -> list[torch.nn.Module]:
    return list(layers) if isinstance(layers, torch.nn.Sequential) else [layers]


def states(model: Any) -> dict[str, torch.Tensor]:
    """Parameters, targets and optimisers of a learner, by name."""
    return {
        f"{_STATE}{place}.{name}": torch.from_numpy(np.array(value, np.int32 if isinstance(value, int) else None))
        for place, (_, state) in _found(model).items()
        for name, value in _flattened(state).items()
    }


def restore(model: Any, tensors: Mapping[str, torch.Tensor], where: Path) -> dict[str, torch.Tensor]:
    """Put the numbers of :func:`states` into a learner; those that are not of it.

    Raises:
        SealegsError: they do not fit it.
    """
    check_like({name: value for name, value in tensors.items() if name.startswith(_STATE)}, states(model), where)
    for place, (owner, state) in _found(model).items():
        values = {name: tensors[f"{_STATE}{place}.{name}"].numpy().copy() for name in _flattened(state)}
        empty = {tuple(name.split("/")): {} for name in _emptied(state)}
        nested = _flax("traverse_util").unflatten_dict({**{tuple(k.split("/")): v for k, v in values.items()}, **empty})
        setattr(owner, place.rpartition(".")[2], _flax("serialization").from_state_dict(state, nested))
    return {name: value for name, value in tensors.items() if not name.startswith(_STATE)}


def _found(model: Any) -> dict[str, tuple[Any, Any]]:
    """Train states of a learner: by place, what holds them, and they."""
    owners = {"model": model, "policy": model.policy}
    return {
        f"{word}.{name}": (owner, value)
        for word, owner in owners.items()
        for name, value in sorted(vars(owner).items())
        if isinstance(value, _flax("training.train_state").TrainState)
    }


def _flattened(state: Any) -> dict[str, Any]:
    return _flax("traverse_util").flatten_dict(_flax("serialization").to_state_dict(state), sep="/")


def _emptied(state: Any) -> list[str]:
    """Places of a train state that hold nothing."""
    kept = _flax("traverse_util").flatten_dict(
        _flax("serialization").to_state_dict(state), sep="/", keep_empty_nodes=True
    )
    return [name for name in kept if name not in _flattened(state)]


def _flax(module: str) -> Any:
    """A module of Flax, which SBX brings."""
    return importlib.import_module(f"flax.{module}")
