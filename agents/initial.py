"""What a new run begins with where another one has learnt, so that a policy is fitted to another model in fewer steps.

    sealegs train from=runs/first extended=diagnosis     on the machine that a diagnosis found

It takes over what a policy is: the weights of actor and critic, and the normaliser of observations. All that belongs to
learning begins anew: steps, learning rate, optimiser, exploration, the normaliser of rewards and the replay buffer.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.running_mean_std import RunningMeanStd

from ..common.atomic import folder_written, write_text
from ..common.documents import DocumentError, read_json, read_mapping
from ..common.errors import SealegsError
from ..envs.engine.batch import BatchEngine
from .policy_files import save_policy
from .weights import FILE, check_like, is_jax, read_tensors

CONFIG = "config.yaml"
EXPLORATION = "log_std"  # of a policy's weights, where it is none that the observation decides


def stored_config(folder: Path) -> dict[str, Any]:
    """The config by which the policy in a folder was learnt: of the folder, or of the run that it is part of.

    Raises:
        SealegsError: there is none.
    """
    file = next((part / CONFIG for part in (folder, *folder.parents[:2]) if (part / CONFIG).is_file()), None)
    if file is None:
        raise SealegsError(
            f"from={folder} holds no {CONFIG}, nor does the folder above it: give a run, or its best/ or final/."
        )
    try:
        return read_mapping(file)
    except DocumentError as error:
        raise SealegsError(f"{file} {error.problem}.") from error


def take_over(folder: Path, model: BaseAlgorithm, engine: BatchEngine) -> None:
    """Put what a policy is into a new learner.

    Args:
        folder: of the policy, or of a run, whose final policy counts.
        model: the learner, of the same algorithm and network.
        engine: the simulations that it learns in.

    Raises:
        SealegsError: there is no policy, or it sees or does something else, or has another network.
    """
    part = next((part for part in (folder, folder / "final") if (part / FILE).is_file()), None)
    if part is None:
        raise SealegsError(f"from={folder} holds no {FILE}: give a run that is finished, or its best/.")
    if is_jax(model):
        raise SealegsError(f"from={folder} was learnt by SBX, whose critic no policy has: train anew, or with ppo.")
    description = read_json(part / "policy.json")
    _check_same_task(description, engine, folder)
    weights, _ = read_tensors(part / FILE)
    own = model.policy.state_dict()
    check_like(weights, own, part / FILE)
    model.policy.load_state_dict({**weights, **{key: own[key] for key in own if key == EXPLORATION}})
    observation, normalizer = description["observation"], model.get_vec_normalize_env()
    seen = normalizer.obs_rms if normalizer is not None and normalizer.norm_obs else None
    if (seen is None) != ("mean" not in observation):
        raise SealegsError(f"from={folder} and agent.normalize differ in whether observations are normalised.")
    if isinstance(seen, RunningMeanStd):
        seen.mean, seen.var = np.array(observation["mean"]), np.array(observation["variance"])
        seen.count = float(max(description["step"], 1))  # it saw an observation of each step


def keep(folder: Path, config: Mapping[str, Any], model: BaseAlgorithm, description: Mapping[str, Any]) -> None:
    """Write a policy that another run can begin with, whole or not at all.

    Args:
        folder: to write; one that is there is replaced.
        config: of its run, as data.
        model: that learnt it.
        description: of its task, as of ``policy.json``.
    """
    with folder_written(folder, replace=True) as part:
        write_text(part / CONFIG, yaml.safe_dump(dict(config), sort_keys=False))
        save_policy(part, model, dict(description))


def _check_same_task(description: Mapping[str, Any], engine: BatchEngine, folder: Path) -> None:
    """Raises:
    SealegsError: the policy sees or does something else than the task of the simulations asks for.
    """
    there = {"observation_names": list(engine.task.observation_names()), "action_names": list(engine.action_names)}
    for key, names in there.items():
        kept = description.get(key)
        if kept is not None and list(kept) != names:
            odd = next(iter(sorted(set(names).symmetric_difference(kept))), "their order")
            raise SealegsError(
                f"from={folder} is a policy of another task: its {key.replace('_', ' ')} differ, by {odd!r} first."
            )
