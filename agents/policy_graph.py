"""The graph of an exported policy: from measured observation and its own state to goals and its next state.

    observation (n, size) float32   what is measured; elements that the policy knows itself are ignored
    command     (n, c)              what the task asks for
    state       (n, s)              as Contract.state at the start, then ``next_state`` of the call before

    action      (n, a) float32      in force, within [-1, 1]
    goal        (n, k)              of the joints until the next call [rad or m]
    next_state  (n, s)

It is asked once for each goal. A policy that acts less often than its gait gives goals looks at its observation in the
first call of each action's time alone. What it knows itself are the clock, the gait's memory, its latest actions and
the command: the task's own code says how, traced (:mod:`agents.traced`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper

from ..envs.contract import Contract, goal_scale, random_motion, task_of
from ..envs.engine.task import ModulatedTask, Motion, Task
from .onnx_graph import OnnxGraph
from .traced import ROWS, MixingError, Traced, TracingError, traced

TICKS = 0  # goals given so far, in the state


class PolicyGraph:
    """Puts the graph together."""

    def __init__(self, contract: Contract, observation: Mapping[str, Any]) -> None:
        """Prepare.

        Args:
            contract: of the policy.
            observation: of its description, with the normaliser.
        """
        self.contract, self._observation = contract, observation
        self.task, engine = task_of(contract.env)
        self.numbers = self.task.robot.parameters(engine.get("params"))
        self.graph = OnnxGraph()
        shape = self.graph.add("Shape", "state", start=0, end=1)
        self.graph.add("Identity", shape, output="rows")
        self._random = np.random.default_rng(0)
        samples = np.tile(np.asarray(contract.state), (ROWS, 1))
        self._state = Traced(self.graph, "state", samples + 1e-3 * self._random.random(samples.shape))
        command = self.task.commands(self._random.random((ROWS, self.task.draws)))
        self._command = Traced(self.graph, "command", command)
        actions = len(contract.actions)
        self._action = self._state[:, 1 : 1 + actions]
        self._previous = self._state[:, 1 + actions : 1 + 2 * actions]
        self._memory = self._state[:, 1 + 2 * actions :]
        self._time = self._state[:, TICKS] / contract.goal_rate

    def document(self, layers: Sequence[torch.nn.Module], squash: bool) -> onnx.ModelProto:
        """The file of a policy with these layers, its contract left out.

        Raises:
            TracingError: the task does what a file cannot say.
        """
        graph, contract = self.graph, self.contract
        new = network(graph, self._normalised(self._seen()), layers, squash)
        held = graph.add("Cast", self._action.name, to=TensorProto.FLOAT)
        turn = self._state[:, TICKS, None] / float(contract.goals_per_action)
        fresh = turn - np.floor(turn) < 0.5 / contract.goals_per_action
        action = graph.add("Where", fresh.name, new, held, output="action")
        taken = Traced(graph, graph.add("Cast", action, to=TensorProto.DOUBLE), np.zeros(self._action.shape))
        before = np.where(fresh, self._action, self._previous)
        goal, memory = self._goal(taken)
        low, high = np.asarray(contract.goal_low), np.asarray(contract.goal_high)
        graph.add("Identity", traced(np.clip(goal, low, high)).full().name, output="goal")
        parts = [self._state[:, TICKS, None] + 1.0, taken, before, *([memory] if memory.shape[1] else [])]
        graph.add("Identity", traced(np.concatenate(parts, axis=1)).name, output="next_state")
        size, state = len(contract.observation_names), len(contract.state)
        double, single = TensorProto.DOUBLE, TensorProto.FLOAT
        return graph.document(
            [
                helper.make_tensor_value_info("observation", single, ["n", size]),
                helper.make_tensor_value_info("command", double, ["n", contract.commands]),
                helper.make_tensor_value_info("state", double, ["n", state]),
            ],
            [
                helper.make_tensor_value_info("action", single, ["n", len(contract.actions)]),
                helper.make_tensor_value_info("goal", double, ["n", len(contract.joints)]),
                helper.make_tensor_value_info("next_state", double, ["n", state]),
            ],
        )

    # --- parts -------------------------------------------------------------------------------------------------

    def _seen(self) -> str:
        """The observation: measured elements as they come, the others from the state (n, size) float32."""
        known: Any = {
            "action": self._action, "previous_action": self._previous, "memory": self._memory, "time": self._time,
            "command": self._command,
        }  # fmt: skip
        motion = random_motion(self.task, self.numbers, self._random, ROWS)
        fields = {name: getattr(motion, name) for name in Motion.__slots__}
        try:
            with np.errstate(invalid="ignore", divide="ignore"):
                try:
                    parts: Sequence[Any] = self.task.observe(Motion(**{**fields, **known}))
                except MixingError:  # such as a reading less its reference: that element is the host's
                    measured = {name: self._measured(name, value) for name, value in fields.items()}
                    parts = self.task.observe(Motion(**{**measured, **known}))
        except TracingError as error:
            raise TracingError(f"{type(self.task).__name__}.observe cannot be exported: {error}") from None
        names, at = [], 0
        for part in parts:
            width = 1 if part.ndim == 1 else part.shape[1]
            if isinstance(part, Traced) and not part.measured:
                column = traced(part[:, None] if part.ndim == 1 else part)
                names.append(self.graph.add("Cast", column.full().name, to=TensorProto.FLOAT))
            else:
                ends = [self.graph.constant(np.array([n], np.int64)) for n in (at, at + width, 1)]
                names.append(self.graph.add("Slice", "observation", *ends))
            at += width
        return self.graph.add("Concat", *names, axis=1)

    def _measured(self, name: str, value: Any) -> Any:
        """A field of the motion that marks whatever it goes into as measured; the graph has no such input."""
        if not isinstance(value, np.ndarray):
            return value
        return Traced(self.graph, f"measured {name}", value, measured=True)

    def _normalised(self, value: str) -> str:
        if "mean" not in self._observation:
            return value
        graph, seen = self.graph, self._observation
        scale = np.sqrt(np.asarray(seen["variance"]) + seen["epsilon"])  # in double precision, as VecNormalize
        clip = float(seen["clip"])
        value = graph.add("Cast", value, to=TensorProto.DOUBLE)
        value = graph.add("Sub", value, graph.constant(np.asarray(seen["mean"], np.float64)))
        value = graph.add("Div", value, graph.constant(scale))
        value = graph.add("Clip", value, graph.constant(np.float64(-clip)), graph.constant(np.float64(clip)))
        return graph.add("Cast", value, to=TensorProto.FLOAT)

    def _goal(self, action: Traced) -> tuple[Traced, Traced]:
        """Goals of the action, and the memory behind them."""
        task: Task = self.task
        name = type(task).__name__
        memory = self._memory.copy()
        arrays: Any = action, self._command, memory
        try:
            with np.errstate(invalid="ignore", divide="ignore"):
                if isinstance(task, ModulatedTask):
                    return traced(task.generate(self.numbers, arrays[0], arrays[1], arrays[2])), memory
                zero, per_action = goal_scale(task, self.numbers, self._time, self._command)
                return traced(zero + np.asarray(per_action) * task.on_joints(self._time, arrays[0])), memory
        except TracingError as error:
            raise TracingError(f"the gait of {name} cannot be exported: {error}") from None


def network(graph: OnnxGraph, value: str, layers: Sequence[torch.nn.Module], squash: bool) -> str:
    """The deterministic action, as ``model.predict`` gives it.

    Raises:
        TracingError: a layer is not dense.
    """
    for layer in layers:
        value = _layer(graph, value, layer)
    if squash:  # low and high are -1 and 1 in every environment of ours
        value = graph.add("Tanh", value)
    return graph.add("Clip", value, graph.constant(np.float32(-1.0)), graph.constant(np.float32(1.0)))


def _layer(graph: OnnxGraph, value: str, layer: torch.nn.Module) -> str:
    if isinstance(layer, torch.nn.Linear):
        weight, bias = (graph.constant(p.detach().cpu().numpy()) for p in (layer.weight, layer.bias))
        return graph.add("Gemm", value, weight, bias, transB=1)
    if isinstance(layer, torch.nn.Tanh):
        return graph.add("Tanh", value)
    if isinstance(layer, torch.nn.ReLU):
        return graph.add("Relu", value)
    if isinstance(layer, torch.nn.ELU):
        return graph.add("Elu", value, alpha=layer.alpha)
    raise TracingError(
        f"the policy has a layer {type(layer).__name__}, which cannot be exported; dense layers with tanh, relu or elu "
        "can."
    )
