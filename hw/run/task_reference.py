"""The reference of a task on servos: the gait or the lead that a policy of the task would correct, and no policy."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from omegaconf import OmegaConf

from ...common.errors import SealegsError, nearest
from ...configs.compose import FOLDER, choices
from ...envs.contract import task_of
from ...envs.engine.base import BaseLayout
from ...envs.engine.batch import BatchEngine
from ...envs.engine.task import Task
from ..machine.limits import SHARE, ByJoint, by_pattern, usual_reach
from ..machine.robot import Reading, ServoRobot
from .asked import asked_for
from .commands import Trajectory

FORM = "a word such as walk, or one with numbers of its task: {walk: {cadence: 2.0}}"


class TaskReference:
    """Goals of a task's reference, as a policy whose actions are all 0 would give them.

    Attributes:
        task: with numbers that fit the robot.
        fitted: those of them that follow from robot and chains, by name.
        asked: what it is asked for over time; None: the middle of what the task draws.
    """

    def __init__(self, given: Any, robot: ServoRobot, command: Any = None) -> None:
        """Prepare.

        Args:
            given: name of a file of ``configs/env``, or a mapping from it to numbers of its task.
            robot: that it runs on.
            command: as in :func:`sealegs.hw.run.asked.asked_for`.

        Raises:
            SealegsError: there is no such task, it has no reference, or it is for another robot.
        """
        word, numbers = next(iter(given.items())) if isinstance(given, Mapping) and len(given) == 1 else (given, {})
        known = choices("env")
        if not isinstance(word, str) or not isinstance(numbers, Mapping):
            raise SealegsError(f"reference is {given!r}; it is {FORM}.")
        if word not in known:
            raise SealegsError(f"there is no task '{word}'{nearest(word, known)}; reference= takes {FORM}.")
        self.task, self.fitted = _fitted(word, numbers, robot)
        self.name, self.rate, self.duration = f"reference-{word}", self.task.control_rate, math.inf
        self._robot, self._numbers = robot, robot.robot.parameters(robot.params)
        self._middle = np.full((1, self.task.draws), 0.5)
        self._command = self.task.commands(self._middle)[0]
        self.asked = None if command is None else asked_for(command, self.task)
        told = self._command.tolist() if self.asked is None else self.asked.description
        self.description = {
            "reference": given,
            "fitted": {k: np.asarray(v).tolist() for k, v in self.fitted.items()},
            "command": told,
        }
        if self.task.reference(np.zeros(1), self._command[None], self._numbers) is None:
            raise SealegsError(f"the task '{word}' has no reference; walk and track have one.")

    @cached_property
    def pose(self) -> dict[str, float]:
        """The whole robot at the start, by joint [rad or m]: how a person holds it up."""
        drivetrain = self.task.robot.drivetrain(None, self._numbers)
        qpos = np.array(drivetrain.model.qpos0)[None].copy()
        self.task.place(drivetrain, self._numbers, self._middle, qpos, np.zeros((1, drivetrain.model.nv)))
        found = BaseLayout(self.task.robot, self._robot.params).values_of(drivetrain.model, qpos[0])
        start = dict(zip(self._robot.names, self.start().tolist(), strict=True))
        return {name: start.get(name, value) for name, value in found.items()}

    def deciding(self) -> dict[str, float]:
        """Those of :attr:`fitted` that the goals depend on: others are of the reward, or ranges of commands."""
        time = np.linspace(0.05, 1.25, 7)  # no whole number of steps of a usual gait apart
        command = self.task.commands(np.random.default_rng(0).random((len(time), self.task.draws)))

        def goals(task: Task) -> np.ndarray:
            found = task.reference(time, command, self._numbers)
            assert found is not None
            return found[0]

        plain, said = goals(self.task), {}
        for name, value in self.fitted.items():
            if isinstance(value, int | float) and np.any(
                goals(replace(self.task, **{name: 1.1 * value + 0.01})) != plain
            ):
                said[name] = value
        return said

    def start(self) -> np.ndarray:
        return self._at(0.0, None if self.asked is None else self.asked.still())

    def goals(self, time: float, reading: Reading) -> np.ndarray:
        del reading
        return self._at(time, self.asked)

    def _at(self, time: float, asked: Any) -> np.ndarray:
        command = self._command if asked is None else self.task.command_at(time, asked)
        found = self.task.reference(np.array([time]), command[None], self._numbers)
        assert found is not None
        return np.clip(np.asarray(found[0])[0], self._robot.low, self._robot.high)


def _fitted(word: str, numbers: Mapping[str, Any], robot: ServoRobot) -> tuple[Task, dict[str, Any]]:
    """The task of a file of ``configs/env`` on a robot, and its numbers that follow from robot and chains."""
    env: Any = OmegaConf.to_container(OmegaConf.load(FOLDER / "env" / f"{word}.yaml"))
    env = {key: value for key, value in env.items() if key not in ("params", "randomization")}
    own = robot.robot.source
    if "robot" not in env:
        raise SealegsError(f"the task '{word}' has a robot of its own; reference= takes tasks of any robot, as walk.")
    task = task_of({**env, **{str(key): value for key, value in numbers.items()}, "robot": own})[0]
    engine = BatchEngine(task, 1, actuator=robot.chains, params=robot.params)
    return engine.task, engine.fitted


# --- motions of the library of excitations on all joints of a robot --------------------------------------------------


def library_excitation(word: str, robot: ServoRobot, reach: ByJoint | None, seed: int) -> Trajectory:
    """An excitation of the library on every joint, each about the middle of its range.

    Args:
        word: its name.
        robot: that moves.
        reach: to either side [rad or m], a number or numbers by pattern of names; None, and joints that no pattern
            fits: :func:`usual_reach`.
        seed: of the excitation.

    Raises:
        SealegsError: there is none of that name, or ``reach`` is more than a joint has.
    """
    from ...gap.experiment import GOAL_RATE as SAMPLES
    from ...gap.experiment import library

    columns, reaches = [], _reaches(robot, reach)
    for k, joint in enumerate(robot.joints):
        # seed + k would give joint k what joint k - 1 has under the next seed
        found = library(0.0, reaches[joint.name], [seed, k])
        shapes = {name.replace(" ", "_"): shape for name, shape in found.items()}
        if word not in shapes:
            hint = nearest(word, shapes)
            raise SealegsError(
                f"there is no excitation '{word}'{hint}; give a .csv file or one of {', '.join(shapes)}."
            )
        columns.append(0.5 * (joint.low + joint.high) + shapes[word])
    plain = reach is not None and all(own == reach for own in reaches.values())
    said = reach if plain else {name: round(own, 6) for name, own in reaches.items()}
    goals = np.stack(columns, axis=1)
    return Trajectory(word, np.arange(len(goals)) / SAMPLES, goals, {"excitation": word, "reach": said, "seed": seed})


def _reaches(robot: ServoRobot, reach: ByJoint | None) -> dict[str, float]:
    """How far each joint goes to either side [rad or m]."""
    given: list[float | None] = [None] * len(robot.joints)
    if isinstance(reach, Mapping):
        given = by_pattern("reach", reach, robot)
    elif reach is not None:
        given = [reach] * len(robot.joints)
    found = {}
    for joint, unit, own in zip(robot.joints, robot.units, given, strict=True):
        half = 0.5 * (joint.high - joint.low)
        # a plain number is meant for hinges where no slide could go so far
        far = own is not None and own > half and unit == "m" and "rad" in robot.units
        if own is None or (far and not isinstance(reach, Mapping)):
            own = SHARE * half if joint.turning else usual_reach(half, unit)
        if not 0.0 < own <= half:
            raise SealegsError(
                f"reach is {own:g} {unit}; joint {joint.name} has {half:.2f} {unit} to either side: leave reach out "
                f"for one that fits each joint, or give numbers by pattern of names, such as "
                f"'reach={{\"{joint.name}\": {usual_reach(half, unit):.3g}}}'."
            )
        found[joint.name] = own
    return found
