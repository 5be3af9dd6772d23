"""Learners of SBX, whose networks are JAX's: their policies become those of Stable-Baselines3, layer by layer.

So a run folder, an ONNX file and whoever acts with them need no JAX. What the next update depends on is kept as numbers
with names, as for other learners (:mod:`agents.checkpoint`).
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy

from ..common.errors import SealegsError
from .weights import check_like, for_acting

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
