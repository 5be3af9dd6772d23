"""Conversion of actions to goals without the physics: reference, generator, memory and limits of goals."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..envs.contract import Contract, goal_scale, random_motion, task_of
from ..envs.engine.task import ModulatedTask


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
