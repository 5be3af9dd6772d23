"""What an environment can be given: the arguments of its shell, of the engine and of its task, told in one place."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, get_type_hints

import numpy as np

from ...common.errors import SealegsError, nearest
from .robot import ChainSource, Robot
from .task import Task

ENGINE: dict[str, tuple[Any, Any]] = {
    "actuator": (ChainSource | Mapping[str, ChainSource] | None, None),
    "randomization": (Mapping[str, Any] | str | None, None),
    "params": (Mapping[str, float] | None, None),
    "control_rate": (float, None),  # the task's own
    "action_delay": (float, 0.0),
    "servo": (Mapping[str, float] | None, None),
}
"""Arguments of the engine that an environment takes: type and default."""


class TaskShell:
    """What the classes for Gymnasium share: a subclass names its task, and so has the arguments of that task.

    ``class HopperEnv(SingleEnv, task=HopperTask)`` is all that a robot adds, beside its documentation; the signature
    that ``inspect`` and notebooks show is made from the task's dataclass.
    """

    task: ClassVar[type[Task]]
    __signature__: ClassVar[inspect.Signature]

    def __init_subclass__(cls, task: type[Task] | None = None, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        if task is not None:
            cls.task = task
            cls.__signature__ = signature(cls, task)


def signature(shell: type, task: type[Task]) -> inspect.Signature:
    """The engine's arguments, the task's, then those of the shell's own constructor; all by keyword."""
    parameters: dict[str, tuple[Any, Any]] = dict(ENGINE)
    parameters["control_rate"] = (float, task.control_rate)
    if task.any_robot:
        parameters = {"robot": (str | Path | Robot, task.robot.name), **parameters}
    types = get_type_hints(task)
    parameters |= {item.name: (types[item.name], item.default) for item in dataclasses.fields(task)}
    types = get_type_hints(shell.__init__)
    for name, item in inspect.signature(shell.__init__).parameters.items():
        if name != "self" and item.kind is not item.VAR_KEYWORD:
            parameters[name] = (types[name], item.default)
    return inspect.Signature(
        [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=annotation, default=default)
            for name, (annotation, default) in parameters.items()
        ]
    )


def task_arguments(kind: type[Task], keywords: Mapping[str, Any]) -> tuple[Task, dict[str, Any]]:
    """Split the keywords of an environment into the task and the engine's arguments.

    Raises:
        SealegsError: a keyword belongs to neither; the message names the nearest one.
    """
    fields = [item.name for item in dataclasses.fields(kind)]
    taken = ["robot", *ENGINE] if kind.any_robot else list(ENGINE)
    for name in keywords:
        if name not in fields and name not in taken:
            known = [*taken, *fields]
            hint = nearest(name, [*known, "render_mode", "width", "height", "num_envs", "max_episode_steps"])
            raise SealegsError(f"there is no argument '{name}'{hint}; there are {', '.join(known)}.")
    weights = {name: value for name, value in keywords.items() if name in fields}
    check_values(kind, weights)
    engine = {name: value for name, value in keywords.items() if name in ENGINE}
    if kind.any_robot and "robot" in keywords:
        kind = kind.on(keywords["robot"])
    return kind(**weights), {"control_rate": kind.control_rate, **engine}


def check_values(kind: type[Task], values: Mapping[str, Any]) -> None:
    """Make sure that values of a task's numbers, by name, are such.

    Raises:
        SealegsError: one is no number, or no range where that is taken.
    """
    unset = [item.name for item in dataclasses.fields(kind) if item.default is None]
    for name, value in values.items():
        if value is None and name in unset:
            continue
        pair = name in kind.ranges and isinstance(value, list | tuple) and len(value) == 2
        numbers: list[Any] = [*value] if pair and value is not None else [value]
        if any(isinstance(item, bool) or not isinstance(item, int | float) for item in numbers):
            wanted = "a number or a pair of numbers" if name in kind.ranges else "a number"
            raise SealegsError(f"{name} takes {wanted}, not {value!r}.")
        if not np.isfinite(numbers).all():
            raise SealegsError(f"{name} is {value!r}; it must be finite.")
        if numbers[0] > numbers[-1]:
            raise SealegsError(f"{name} is {value!r}; a range goes from its low to its high end.")
