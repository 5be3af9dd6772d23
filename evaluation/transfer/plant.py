"""A task on a machine that is no simulation of sealegs: what its encoders say is all that a policy sees.

Copies of the machine stand in the place of a batch of simulations, so that a policy can be judged on it, and one can
learn on it, which is the limit of what any model of it can give.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from ...envs.any_robot.task import AnyRobotTask
from ...envs.engine.arguments import check_values
from ...envs.engine.task import Motion, Step


class Plant(Protocol):
    """Copies of a machine (m of them, n joints each)."""

    @property
    def links(self) -> np.ndarray: ...
    @property
    def torques(self) -> np.ndarray: ...
    @property
    def speeds(self) -> np.ndarray: ...
    @property
    def duties(self) -> np.ndarray: ...
    def place(self, which: np.ndarray, angles: np.ndarray) -> None: ...
    def step(self, goals: np.ndarray) -> None: ...
    def read(self) -> np.ndarray: ...


class PlantEngine:
    """A task on copies of a machine, as :class:`~sealegs.envs.engine.batch.BatchEngine` is one on simulations.

    Attributes:
        task: what is asked of the machine; it has a reference.
        num_envs: copies.
        observation_size: numbers that a policy sees.
        dt: control step [s].
        steps: control steps since each copy started (m,).
    """

    def __init__(self, task: AnyRobotTask, plant: Plant, count: int, dt: float, episode: int) -> None:
        """Take the machine.

        Args:
            task: see above.
            plant: the copies.
            count: of them.
            dt: control step [s].
            episode: control steps of an episode.
        """
        self.task, self.num_envs, self.dt, self.episode = task, count, dt, episode
        self._plant, self._numbers = plant, task.robot.parameters()
        joints = len(task.names)
        self.action_names, self.observation_size = task.action_names(), len(task.observation_names())
        limits = np.array([task.robot.limits[name] for name in task.names])
        self._low, self._high = limits[:, 0], limits[:, 1]
        self._command = np.zeros((count, task.commands(np.zeros((1, task.draws))).shape[1]))
        self._action = np.zeros((count, joints))
        self._reading, self._before = np.zeros((count, joints)), np.zeros((count, joints))
        self._link_before = np.zeros((count, joints))
        self.steps = np.zeros(count, dtype=np.int64)
        self._random = np.random.default_rng(0)

    def seed(self, seed: int | Sequence[int | None] | None) -> None:
        """Of commands and starts; of several numbers, one for each copy, the first counts."""
        self._random = np.random.default_rng(seed[0] if isinstance(seed, Sequence) else seed)

    def set_number(self, name: str, value: Any) -> None:
        """Give a number of the task another value from the next step on.

        Raises:
            SealegsError: the value is none for it.
        """
        check_values(type(self.task), {name: value})
        self.task = replace(self.task, **{name: value})

    def reset(self) -> np.ndarray:
        """Start all copies; their observations (m, size)."""
        self._start(np.arange(self.num_envs))
        return self._observation(self.motion(self._action))

    def _start(self, chosen: np.ndarray) -> None:
        task = self.task
        random = self._random.random((len(chosen), task.draws))
        self._command[chosen] = task.commands(random)
        self.steps[chosen] = 0
        start, per_action = self._reference()
        noise = getattr(task, "start_noise", 0.0) * task.half * (2.0 * task.per_coordinate(random)[:, :, -1] - 1.0)
        begin = np.clip(start[chosen] + noise, self._low, self._high)
        self._plant.place(chosen, begin)
        self._action[chosen] = np.clip((begin - start[chosen]) / per_action, -1.0, 1.0)
        self._reading[chosen] = self._before[chosen] = self._plant.read()[chosen]
        self._link_before[chosen] = self._plant.links[chosen]

    def _reference(self) -> tuple[np.ndarray, np.ndarray]:
        found = self.task.reference(self.steps * self.dt, self._command, self._numbers)
        assert found is not None, "the task corrects a reference"
        return found

    def step(self, action: np.ndarray) -> Step:
        """One control step of all copies; those whose episode ends start anew."""
        previous, self._action = self._action, np.clip(np.asarray(action, np.float64), -1.0, 1.0)
        zero, per_action = self._reference()
        self._plant.step(np.clip(zero + per_action * self._action, self._low, self._high))
        self.steps = self.steps + 1
        self._before, self._reading = self._reading, self._plant.read()
        motion = self.motion(previous)
        terms = self.task.rewards(motion)
        observation = self._observation(motion)
        truncated = self.steps >= self.episode
        done = np.flatnonzero(truncated)
        final = observation[done]
        self._link_before = motion.link
        if len(done):
            self._start(done)
            observation[done] = self._observation(self.motion(self._action))[done]
        never = np.zeros(self.num_envs, bool)
        reward = np.sum(list(terms.values()), axis=0)
        return Step(
            observation, reward=reward, terminated=never, truncated=truncated, terms=terms, flags={"unstable": never},
            servo={}, done=done, final_observation=final,
        )  # fmt: skip

    def motion(self, previous: np.ndarray) -> Motion:
        """What the task sees of the machine now."""
        link, none = self._plant.links, np.zeros((self.num_envs, 0))
        return Motion(
            qpos=none, qvel=none, link=link, link_speed=(link - self._link_before) / self.dt, reading=self._reading,
            reading_speed=(self._reading - self._before) / self.dt, torque=self._plant.torques,
            motor_speed=self._plant.speeds, action=self._action, previous_action=previous, command=self._command,
            time=self.steps * self.dt, numbers=self._numbers, duty=self._plant.duties,
        )  # fmt: skip

    def _observation(self, motion: Motion) -> np.ndarray:
        return np.concatenate(self.task.observe(motion), axis=1).astype(np.float32)
