"""A policy as one ONNX file that needs neither torch nor Stable-Baselines3 to run.

    sealegs export runs/first/final            writes runs/first/final/policy.onnx
    sealegs export runs/first/best leg.onnx
    sealegs export runs/mine/best task=mine.py:Mine    of a task in a file of one's own: it is run, so name it
    sealegs export from-elsewhere trust=true   reads a model.zip of Stable-Baselines3, whose author can run code here,
                                               and writes policy.safetensors beside it, which cannot

The graph holds the normaliser, the network, and the conversion of actions to goals: a scale, a gait that they correct,
or a generator that they modulate, with its clock and memory. The metadata holds the contract with the robot. The graph
is written node by node, so that it does not depend on the exporter of a torch version.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import helper
from onnx.reference import ReferenceEvaluator
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.common.vec_env import VecEnvWrapper, VecNormalize

from ..common.errors import SealegsError
from ..configs.check import Count, checked
from ..configs.compose import override, split
from ..configs.script import run
from ..envs.contract import KEY, Contract, ContractError, make_contract
from ..envs.engine.batch import BatchEngine
from ..envs.engine.sb3 import BatchVecEnv
from .algorithms import TRANSPARENT, made
from .policy_files import Acting, describe, load_model, trained_env
from .policy_graph import ActionPipeline, Actor, PolicyGraph
from .run_folder import chains
from .traced import TracingError
from .weights import FILE as WEIGHTS
from .weights import is_jax, twin, write_weights

FILE = "policy.onnx"
OF_THE_SHELL = ("actuator", "num_envs", "max_episode_steps", "render_mode", "width", "height")
"""Arguments of an environment that say nothing of its policy, or that the chains say."""
PARITY = 1e-5
"""Largest difference of an action, of 1, that an exported policy may have from the one in memory."""


class ExportError(SealegsError):
    """A policy that cannot be written as ONNX."""


def export(model: BaseAlgorithm, out: str | Path, env: Any = None, normalizer: VecNormalize | None = None) -> Path:
    """Write the policy of a Stable-Baselines3 model as the ONNX file that ``sealegs deploy`` runs.

    Args:
        model: an algorithm of Stable-Baselines3 or sb3-contrib with a policy of dense layers, perhaps behind an LSTM.
        out: file to write, such as ``mine.onnx``.
        env: :class:`~sealegs.envs.engine.sb3.BatchVecEnv`, or single environments of this project, that it learned in,
            wrapped or not; None: the model's own.
        normalizer: of its observations; None: the model's own, where it has one.

    Returns:
        The file.

    Raises:
        ExportError: the environment is none of this project's, the network has other than dense layers, or the file
            exists.
    """
    env = model.get_env() if env is None else env
    place: Any = getattr(env, "unwrapped", env)
    place = getattr(place, "envs", [place])[0]  # of a DummyVecEnv
    engine, spec = getattr(place.unwrapped, "engine", None), getattr(place, "spec", None)
    if not isinstance(engine, BatchEngine) or spec is None:
        raise ExportError(
            "what a policy is for is read from its environment, and this one is none of this project's, or is in "
            "another process: give env=BatchVecEnv(...), or one of gymnasium.make('SeaLegs/...')."
        )
    given = place.keywords if isinstance(place, BatchVecEnv) else {**spec.kwargs}
    kept = {key: value for key, value in (given | engine.fitted).items() if key not in OF_THE_SHELL}
    if "robot" in kept:
        kept["robot"] = str(kept["robot"])
    description = {
        "env": {"id": spec.id, **kept},
        "actuators": chains(engine),
        "control_rate": 1.0 / engine.dt,
    }
    normalizer = model.get_vec_normalize_env() if normalizer is None else normalizer
    layers = env
    while isinstance(layers, VecEnvWrapper):
        if not isinstance(layers, TRANSPARENT):
            raise ExportError(f"what {type(layers).__name__} does is in no file: take it away, or do it in the task.")
        layers = layers.venv
    return write_onnx(Path(out), model, describe(model, normalizer, env) | description)


def export_policy(folder: Path, out: Path | None = None, task: str | None = None, trust: bool = False) -> Path:
    """Write a saved policy as ONNX.

    Args:
        folder: with ``policy.safetensors`` and ``policy.json``, as ``train.py`` writes them.
        out: file to write; None: ``policy.onnx`` in the folder.
        task: ``path/to/task.py:MyTask`` that it was trained in, where that is a file of one's own.
        trust: read Stable-Baselines3's ``model.zip``, which can run code, where the folder has no
            ``policy.safetensors``; that is written then.

    Raises:
        SealegsError: there is no policy in the folder that may be read, its network has other than dense layers, or the
            file exists.
    """
    model, description = load_model(folder, trust)
    description["env"] = trained_env(description, folder, task)
    written = write_onnx(folder / FILE if out is None else out, model, description)
    if not (folder / WEIGHTS).is_file():
        write_weights(folder, model)
    return written


def write_onnx(out: Path, model: BaseAlgorithm, description: Mapping[str, Any]) -> Path:
    """Write the policy of ``model`` as ONNX.

    Args:
        out: file to write.
        model: as of :func:`export`.
        description: as in ``policy.json``: ``env``, ``actuators``, ``control_rate``, and ``observation`` with the
            normaliser.

    Raises:
        ExportError: the network has other than dense layers, the task's code cannot be traced, or the file exists.
    """
    try:
        seen, actor = description["observation"], _actor(model)
        history = checked("observation.history", seen.get("history", 1), Count)
        wrappers = description.get("wrappers") or []
        if opaque := [item for item in wrappers if not issubclass(made("wrappers", item)[0], TRANSPARENT)]:
            raise ExportError(f"what the wrapper {opaque[0]} does is in no file: take it away, or do it in the task.")
        if history > 1 and "mean" in seen and len(seen["mean"]) != seen["shape"][0]:
            raise ExportError("the normaliser is inside the stack of observations: put VecNormalize around it.")
        contract = make_contract(
            description["env"], description["actuators"], description["control_rate"], history, actor.remembers
        )
        document = PolicyGraph(contract, seen).document(actor)
    except (ContractError, TracingError) as error:
        raise ExportError(str(error)) from None
    helper.set_model_props(document, {KEY: contract.to_json()})
    _compare(document, model, description["observation"], contract)
    try:
        with open(out, "xb") as file:
            file.write(document.SerializeToString())
            file.flush()
            os.fsync(file.fileno())
    except FileExistsError:
        raise ExportError(f"{out} exists, and a policy is never overwritten: give another file.") from None
    return out


def _actor(model: BaseAlgorithm) -> Actor:
    """The network from observation to action."""
    policy = (twin(model) if is_jax(model) else model).policy
    policy.set_training_mode(False)
    if not isinstance(
        getattr(policy, "features_extractor", None) or getattr(policy, "actor", policy).features_extractor,
        FlattenExtractor,
    ):
        raise ExportError(
            "the policy looks at its observation through a network of its own; only MlpPolicy can be exported."
        )
    if isinstance(policy, ActorCriticPolicy):
        layers = [*policy.mlp_extractor.policy_net, policy.action_net]
        return Actor(layers, bool(policy.squash_output), getattr(policy, "lstm_actor", None))
    actor: Any = getattr(policy, "actor", None)
    mean: Any = getattr(actor, "mu", None)
    if hasattr(actor, "latent_pi"):  # SAC, TQC, CrossQ; with state-dependent exploration the mean is limited as well
        return Actor([*actor.latent_pi, *(mean if isinstance(mean, torch.nn.Sequential) else [mean])], True)
    if isinstance(mean, torch.nn.Sequential) and isinstance(mean[-1], torch.nn.Tanh):  # TD3, DDPG
        return Actor(list(mean.children())[:-1], True)
    if isinstance(network := getattr(policy, "action_net", None), torch.nn.Sequential):  # ARS
        return Actor(list(network.children()), False)
    raise ExportError(
        f"a policy of the kind {type(policy).__name__} cannot be exported; MlpPolicy and MlpLstmPolicy can."
    )


def _compare(
    document: onnx.ModelProto, model: BaseAlgorithm, observation: Mapping[str, Any], contract: Contract
) -> None:
    """Refuse a file that does not act as policy and environment do: a difference must not show on the robot first."""
    pipeline = ActionPipeline(contract, rows=16)
    file = ReferenceEvaluator(document)
    random = np.random.default_rng(0)
    state = np.tile(np.asarray(contract.state), (16, 1))
    mean, scale = 0.0, 1.0
    size, known = len(contract.observation_names), len(contract.state) - contract.policy_memory
    if "mean" in observation:
        mean, scale = np.asarray(observation["mean"]), np.sqrt(np.asarray(observation["variance"]) + 1e-8)
        mean, scale = mean[-size:], scale[-size:]  # of the newest observation
    acting = Acting(model, observation)
    for _ in range(3 * contract.goals_per_action if contract.goals_per_action < 10 else contract.goals_per_action + 2):
        measured = (random.normal(0.0, 2.0, (16, size)) * scale + mean).astype(np.float32)
        wanted, goal = pipeline.step(measured, acting)
        feeds = {"observation": measured, "command": pipeline.command, "state": state}
        with np.errstate(all="ignore"):
            action, got, state = (np.asarray(value) for value in file.run(["action", "goal", "next_state"], feeds))
        memory = np.abs(state[:, :known] - pipeline.state()).max()
        difference = float(max(np.abs(action - wanted).max(), np.abs(got - goal).max(), memory))
        if not difference < PARITY:
            raise ExportError(
                f"the exported policy differs from the trained one by {difference:.2g} of an action, goal or memory: "
                "not written."
            )


def main(arguments: list[str]) -> None:
    """Export the policy that the command line names."""
    files = [word for word in arguments if not word.startswith(("task=", "trust="))]
    named = split([word for word in arguments if word not in files], plain=("task",))
    keys = override({"task": None, "trust": False}, named)
    if not 1 <= len(files) <= 2:
        raise ExportError("give the folder of a policy, such as runs/first/final, and perhaps a file to write.")
    task, trust = checked("task", keys["task"], str | None), checked("trust", keys["trust"], bool)
    print(export_policy(Path(files[0]), Path(files[1]) if len(files) == 2 else None, task, trust))


if __name__ == "__main__":
    if {"-h", "--help"} & set(sys.argv[1:]):
        sys.exit(print((__doc__ or "").strip()))
    sys.exit(run(main, "", "", sys.argv[1:]))
