"""A policy as one ONNX file that needs neither torch nor Stable-Baselines3 to run.

    sealegs export runs/first/final            writes runs/first/final/policy.onnx
    sealegs export runs/first/best leg.onnx

The graph is the normaliser, the network and the scaling of actions to goals; its metadata holds the contract with the
robot (:mod:`envs.contract`). It is written node by node: a network of dense layers is a dozen of them, and a file
written by hand does not change with the exporter that a torch version happens to have.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from onnx.reference import ReferenceEvaluator
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.sac.policies import SACPolicy

from ..actuators.errors import SealegsError
from ..configs.script import run
from ..envs.contract import KEY, Contract, ContractError, make_contract
from .algorithms import algorithm

FILE = "policy.onnx"
OPSET, IR_VERSION = 17, 8  # read by every onnxruntime since 1.12
PARITY = 1e-5
"""Largest difference of an action, of 1, that an exported policy may have from the one in memory."""


class ExportError(SealegsError):
    """A policy that cannot be written as ONNX."""


def export_policy(folder: Path, out: Path | None = None) -> Path:
    """Write a saved policy as ONNX.

    Args:
        folder: with ``model.zip`` and ``policy.json``, as ``train.py`` writes them.
        out: file to write; None: ``policy.onnx`` in the folder.

    Raises:
        ExportError: there is no policy in the folder, its network has parts that are no dense layers, or the file
            exists.
    """
    out = folder / FILE if out is None else out
    try:
        description = json.loads((folder / "policy.json").read_text())
        model = algorithm(description["algorithm"]).load(folder / "model.zip", device="cpu")
    except (OSError, ValueError, LookupError) as error:
        raise ExportError(
            f"{folder} holds no policy that can be read ({error}); give a run's best/ or final/."
        ) from error
    return write_onnx(out, model, description)


def write_onnx(out: Path, model: BaseAlgorithm, description: Mapping[str, Any]) -> Path:
    """Write the policy of ``model`` as ONNX.

    Args:
        out: file to write.
        model: PPO or SAC with a policy of dense layers.
        description: as in ``policy.json``: ``env``, ``actuators``, ``control_rate``, and ``observation`` with the
            normaliser.

    Raises:
        ExportError: the network has parts that are no dense layers, its actions correct a gait, or the file exists.
    """
    try:
        contract = make_contract(description["env"], description["actuators"], description["control_rate"])
    except ContractError as error:
        raise ExportError(str(error)) from None
    graph = _Graph(contract, description["observation"])
    graph.network(model)
    document = graph.finished(contract)
    _compare(document, model, description["observation"])
    try:
        with open(out, "xb") as file:
            file.write(document.SerializeToString())
            file.flush()
            os.fsync(file.fileno())
    except FileExistsError:
        raise ExportError(f"{out} exists, and a policy is never overwritten: give another file.") from None
    return out


class _Graph:
    """Nodes and constants of the file, in the order of execution."""

    def __init__(self, contract: Contract, observation: Mapping[str, Any]) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []
        self.size, self.actions = len(contract.observation_names), len(contract.joints)
        if "mean" in observation:  # in double precision, as VecNormalize
            scale = np.sqrt(np.asarray(observation["variance"]) + observation["epsilon"])
            clip = float(observation["clip"])
            value = self.add("Cast", "observation", to=TensorProto.DOUBLE)
            value = self.add("Sub", value, self.constant(np.asarray(observation["mean"], np.float64)))
            value = self.add("Div", value, self.constant(scale))
            value = self.add("Clip", value, self.constant(np.float64(-clip)), self.constant(np.float64(clip)))
            self.value = self.add("Cast", value, to=TensorProto.FLOAT)
        else:
            self.value = "observation"

    def constant(self, values: Any) -> str:
        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.ascontiguousarray(values), name))
        return name

    def add(self, operator: str, *inputs: str, output: str | None = None, **attributes: Any) -> str:
        output = output or f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, list(inputs), [output], **attributes))
        return output

    def network(self, model: BaseAlgorithm) -> None:
        """The deterministic action, as ``model.predict`` gives it."""
        layers, squash = _layers(model)
        for layer in layers:
            self.value = self._layer(layer)
        if squash:  # low and high are -1 and 1 in every environment of ours
            self.value = self.add("Tanh", self.value)
        one = self.constant(np.float32(1.0))
        self.value = self.add("Clip", self.value, self.constant(np.float32(-1.0)), one, output="action")

    def _layer(self, layer: torch.nn.Module) -> str:
        if isinstance(layer, torch.nn.Linear):
            weight, bias = (self.constant(p.detach().cpu().numpy()) for p in (layer.weight, layer.bias))
            return self.add("Gemm", self.value, weight, bias, transB=1)
        if isinstance(layer, torch.nn.Tanh):
            return self.add("Tanh", self.value)
        if isinstance(layer, torch.nn.ReLU):
            return self.add("Relu", self.value)
        if isinstance(layer, torch.nn.ELU):
            return self.add("Elu", self.value, alpha=layer.alpha)
        raise ExportError(
            f"the policy has a layer {type(layer).__name__}, which cannot be exported; dense layers with tanh, relu "
            "or elu can."
        )

    def finished(self, contract: Contract) -> onnx.ModelProto:
        """The file: actions, and the goals that they stand for."""
        action = self.add("Cast", "action", to=TensorProto.DOUBLE)
        scaled = self.add("Mul", action, self.constant(np.asarray(contract.goal_per_action, np.float64)))
        self.add("Add", scaled, self.constant(np.asarray(contract.goal_at_zero, np.float64)), output="goal")
        graph = helper.make_graph(
            self.nodes,
            "policy",
            [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["n", self.size])],
            [
                helper.make_tensor_value_info("action", TensorProto.FLOAT, ["n", self.actions]),
                helper.make_tensor_value_info("goal", TensorProto.DOUBLE, ["n", self.actions]),
            ],
            self.constants,
        )
        opset = [helper.make_operatorsetid("", OPSET)]
        document = helper.make_model(graph, opset_imports=opset, ir_version=IR_VERSION, producer_name="sealegs")
        helper.set_model_props(document, {KEY: contract.to_json()})
        onnx.checker.check_model(document, full_check=True)
        return document


def _layers(model: BaseAlgorithm) -> tuple[list[torch.nn.Module], bool]:
    """Layers from observation to action, and whether a tanh follows them."""
    policy = model.policy
    if not isinstance(
        getattr(policy, "features_extractor", None) or getattr(policy, "actor", policy).features_extractor,
        FlattenExtractor,
    ):
        raise ExportError(
            "the policy looks at its observation through a network of its own; only MlpPolicy can be exported."
        )
    if isinstance(policy, ActorCriticPolicy):
        layers = [*policy.mlp_extractor.policy_net, policy.action_net]
        return layers, bool(policy.squash_output)
    if isinstance(policy, SACPolicy) and isinstance(policy.actor.mu, torch.nn.Linear):
        return [*policy.actor.latent_pi, policy.actor.mu], True
    raise ExportError(
        f"a policy of the kind {type(policy).__name__} cannot be exported; PPO's and SAC's MlpPolicy can."
    )


def _compare(document: onnx.ModelProto, model: BaseAlgorithm, observation: Mapping[str, Any]) -> None:
    """Refuse a file that does not do what the policy does: a robot is no place to find out."""
    size = int(observation["shape"][0])
    random = np.random.default_rng(0)
    normal = random.normal(0.0, 2.0, (64, size))
    seen = normal.astype(np.float32)
    raw = seen
    if "mean" in observation:
        scale = np.sqrt(np.asarray(observation["variance"]) + observation["epsilon"])
        raw = (normal * scale + np.asarray(observation["mean"])).astype(np.float32)
        clip = observation["clip"]
        seen = np.clip((raw - np.asarray(observation["mean"])) / scale, -clip, clip).astype(np.float32)
    wanted, _ = model.predict(seen, deterministic=True)
    got: Any = next(iter(ReferenceEvaluator(document).run(["action"], {"observation": raw})))
    difference = float(np.abs(np.asarray(got) - wanted).max())
    if not difference < PARITY:
        raise ExportError(
            f"the exported policy differs from the trained one by {difference:.2g} of an action: not written."
        )


def main(arguments: list[str]) -> None:
    """Export the policy that the command line names."""
    if not 1 <= len(arguments) <= 2:
        raise ExportError("give the folder of a policy, such as runs/first/final, and perhaps a file to write.")
    print(export_policy(Path(arguments[0]), Path(arguments[1]) if len(arguments) == 2 else None))


if __name__ == "__main__":
    if {"-h", "--help"} & set(sys.argv[1:]):
        sys.exit(print((__doc__ or "").strip()))
    sys.exit(run(main, "", "", sys.argv[1:]))
