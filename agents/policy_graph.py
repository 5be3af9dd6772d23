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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper

from ..envs.contract import Contract, goal_scale, random_motion, task_of
from ..envs.engine.task import ModulatedTask, Motion, Task
from .traced import ROWS, MixingError, OnnxGraph, Traced, TracingError, traced

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
        own = len(contract.state) - contract.policy_memory
        self._memory, self._remembered = self._state[:, 1 + 2 * actions : own], self._state[:, own:]
        self._time = self._state[:, TICKS] / contract.goal_rate

    def document(self, actor: Actor) -> onnx.ModelProto:
        """The file of a policy with this network, its contract left out.

        Raises:
            TracingError: the task does what a file cannot say.
        """
        graph, contract = self.graph, self.contract
        new, remembered = self._acted(actor)
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
        if remembered is not None:
            parts.append(np.where(fresh, remembered, self._remembered))
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

    def _acted(self, actor: Actor) -> tuple[str, Traced | None]:
        """The action of the network (n, a) float32, and what the policy remembers after it; None: nothing."""
        graph, seen, kept = self.graph, self._seen(), []
        earlier = (self.contract.history - 1) * len(self.contract.observation_names)
        memory = graph.add("Cast", self._remembered.name, to=TensorProto.FLOAT) if self.contract.policy_memory else ""
        if earlier:
            seen = graph.add("Concat", graph.columns(memory, 0, earlier), seen, axis=1)
            kept.append(graph.columns(seen, len(self.contract.observation_names), None))
        value = self._normalised(seen)
        if actor.lstm is not None:
            value, after = lstm(graph, value, graph.columns(memory, earlier, None), actor.lstm)
            kept += after
        action = network(graph, value, actor)
        if not kept:
            return action, None
        name = graph.add("Cast", graph.add("Concat", *kept, axis=1), to=TensorProto.DOUBLE)
        return action, Traced(graph, name, np.zeros(self._remembered.shape))

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
                names.append(self.graph.columns("observation", at, at + width))
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


@dataclass(frozen=True)
class Actor:
    """The network of a deterministic policy.

    Attributes:
        layers: from observation to action.
        squash: whether a tanh follows them.
        lstm: before them; None: they look at the observation itself.
    """

    layers: Sequence[torch.nn.Module]
    squash: bool
    lstm: torch.nn.LSTM | None = None

    @property
    def remembers(self) -> int:
        """Numbers that it keeps from action to action."""
        return 0 if self.lstm is None else 2 * self.lstm.num_layers * self.lstm.hidden_size


def lstm(graph: OnnxGraph, value: str, memory: str, cells: torch.nn.LSTM) -> tuple[str, list[str]]:
    """What an LSTM gives after one more step, and its memory thereafter: output and cell of each layer.

    Args:
        graph: to add to.
        value: what it sees (n, size).
        memory: output and cell of each layer, one after the other (n, 2 layers hidden).
        cells: the LSTM.

    Raises:
        TracingError: it is of another kind than sb3-contrib's.
    """
    if cells.bidirectional or cells.proj_size or not cells.bias:
        raise TracingError("the policy has a bidirectional, projected or unbiased LSTM, which cannot be exported.")
    size, after = cells.hidden_size, []
    for layer in range(cells.num_layers):
        at = 2 * size * layer
        output, cell = graph.columns(memory, at, at + size), graph.columns(memory, at + size, at + 2 * size)
        sums = []
        for source, kind in ((value, "ih"), (output, "hh")):
            weights = (getattr(cells, f"{part}_{kind}_l{layer}") for part in ("weight", "bias"))
            constants = (graph.constant(item.detach().cpu().numpy()) for item in weights)
            sums.append(graph.add("Gemm", source, *constants, transB=1))
        total = graph.add("Add", *sums)
        admit, keep, new, show = (  # torch's order of the gates
            graph.add(operator, graph.columns(total, k * size, (k + 1) * size))
            for k, operator in enumerate(("Sigmoid", "Sigmoid", "Tanh", "Sigmoid"))
        )
        cell = graph.add("Add", graph.add("Mul", keep, cell), graph.add("Mul", admit, new))
        value = graph.add("Mul", show, graph.add("Tanh", cell))
        after += [value, cell]
    return value, after


def network(graph: OnnxGraph, value: str, actor: Actor) -> str:
    """The deterministic action, as ``model.predict`` gives it.

    Raises:
        TracingError: a layer is not dense.
    """
    for layer in actor.layers:
        value = _layer(graph, value, layer)
    if actor.squash:  # low and high are -1 and 1 in every environment of ours
        value = graph.add("Tanh", value)
    return graph.add("Clip", value, graph.constant(np.float32(-1.0)), graph.constant(np.float32(1.0)))


def _layer(graph: OnnxGraph, value: str, layer: torch.nn.Module) -> str:
    if isinstance(layer, torch.nn.Linear):
        parts = [graph.constant(p.detach().cpu().numpy()) for p in (layer.weight, layer.bias) if p is not None]
        return graph.add("Gemm", value, *parts, transB=1)
    if isinstance(layer, torch.nn.Tanh):
        return graph.add("Tanh", value)
    if isinstance(layer, torch.nn.ReLU):
        return graph.add("Relu", value)
    if isinstance(layer, torch.nn.ELU):
        return graph.add("Elu", value, alpha=layer.alpha)
    if isinstance(layer, torch.nn.Hardtanh):
        ends = (graph.constant(np.float32(end)) for end in (layer.min_val, layer.max_val))
        return graph.add("Clip", value, *ends)
    if type(layer).__name__ == "BatchRenorm1d":  # of sb3-contrib, which need not be installed
        numbers: Any = layer
        scale = numbers.scale / torch.sqrt(numbers.ra_var + numbers.eps)
        pair = (scale, numbers.bias - scale * numbers.ra_mean)
        factor, shift = (graph.constant(item.detach().cpu().numpy()) for item in pair)
        return graph.add("Add", graph.add("Mul", value, factor), shift)
    raise TracingError(
        f"the policy has a layer {type(layer).__name__}, which cannot be exported; dense layers with tanh, relu or elu "
        "can."
    )


# --- conversion of actions to goals without the physics: reference, generator, memory and limits of goals ------------


class ActionPipeline:
    """Conversion of measured observations to goals in NumPy, as in :class:`sealegs.envs.engine.batch.BatchEngine`.

    Attributes:
        command: what is asked for (n, c).
    """

    def __init__(self, contract: Contract, rows: int, seed: int = 0) -> None:
        """``rows`` robots at their start, each with a command of its own."""
        self._contract, self._rows = contract, rows
        self._task, engine = task_of(contract.env)
        self._numbers = self._task.robot.parameters(engine.get("params"))
        self._motion = random_motion(self._task, self._numbers, np.random.default_rng(seed), rows)
        state = np.tile(np.asarray(contract.state[: len(contract.state) - contract.policy_memory]), (rows, 1))
        count = len(contract.actions)
        self._ticks = 0
        self._action, self._previous = state[:, 1 : 1 + count], state[:, 1 + count : 1 + 2 * count]
        self._memory = state[:, 1 + 2 * count :].copy()
        self.command = self._task.commands(np.random.default_rng(seed).random((rows, self._task.draws)))
        self._low, self._high = np.asarray(contract.goal_low), np.asarray(contract.goal_high)

    def state(self) -> np.ndarray:
        """As the exported file counts it, without what the policy itself remembers (n, s)."""
        ticks = np.full((self._rows, 1), float(self._ticks))
        return np.concatenate([ticks, self._action, self._previous, self._memory], axis=1)

    def step(self, measured: np.ndarray, policy: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Action in force (n, a) and goals (n, k), of the next goal.

        Args:
            measured: observations (n, size); elements that the environment computes itself are replaced.
            policy: from observations to actions.
        """
        contract, task = self._contract, self._task
        time = np.full(self._rows, self._ticks / contract.goal_rate)
        if self._ticks % contract.goals_per_action == 0:
            action = np.clip(policy(self._observation(measured, time)).astype(np.float64), -1.0, 1.0)
            self._previous, self._action = self._action, action
        if isinstance(task, ModulatedTask):
            goals = task.generate(self._numbers, self._action, self.command, self._memory)
        else:
            zero, per_action = goal_scale(task, self._numbers, time, self.command)
            goals = zero + per_action * task.on_joints(time, self._action)
        self._ticks += 1
        return self._action, np.clip(goals, self._low, self._high)

    def _observation(self, measured: np.ndarray, time: np.ndarray) -> np.ndarray:
        """The observation with what the environment knows put in: elements that no measurement changes."""
        m = self._motion
        known = {"time": time, "memory": self._memory, "action": self._action, "previous_action": self._previous}
        parts = []
        for values in (1.0, 2.0):
            given = {name: getattr(m, name) for name in type(m).__slots__}
            fields = {name: values * value if isinstance(value, np.ndarray) else value for name, value in given.items()}
            motion = type(m)(**{**fields, **known, "command": self.command})
            with np.errstate(invalid="ignore"):
                seen = task_parts(self._task.observe(motion))
            parts.append(seen)
        own = [np.array_equal(a, b) for a, b in zip(*parts, strict=True)]
        columns, at = [], 0
        for part, is_own in zip(parts[0], own, strict=True):
            columns.append(part if is_own else measured[:, at : at + part.shape[1]])
            at += part.shape[1]
        return np.concatenate(columns, axis=1).astype(np.float32)


def task_parts(parts: tuple[np.ndarray, ...]) -> list[np.ndarray]:
    """Parts of an observation, (n, width) each."""
    return [part[:, None] if part.ndim == 1 else part for part in parts]
