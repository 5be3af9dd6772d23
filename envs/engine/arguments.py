"""What an environment can be given: the arguments of its shell, of the engine and of its task, told in one place."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, get_args, get_origin, get_type_hints

import numpy as np

from ...common.errors import SealegsError, nearest
from .robot import ChainSource, Robot
from .task import Task


@dataclass(frozen=True)
class Argument:
    """What an environment can be given.

    Attributes:
        kind: type of its value.
        default: value where none is given.
        doc: what it means.
    """

    kind: Any
    default: Any
    doc: str = ""


CHAIN = "chain: {words}a name in `configs/actuator`, a path or stages, or one of these by coordinate; `None`: {default}"
ROBOT = Argument(str | Path | Robot, None, "a name, or the robot's `.yaml`, `.xml` or `.urdf`")
ENGINE: dict[str, Argument] = {
    "actuator": Argument(ChainSource | Mapping[str, ChainSource] | None, None, CHAIN),
    "randomization": Argument(
        Mapping[str, Any] | str | None, None, "what every episode draws anew, see `envs/engine/randomization.py`"
    ),
    "params": Argument(
        Mapping[str, float] | None, None, "numbers of the robot other than its own: `{first}` and the others"
    ),
    "control_rate": Argument(float, None, "actions per second [Hz]"),  # the task's own
    "action_delay": Argument(float, 0.0, "from an observation to its goal [s]; a whole number of physics steps"),
    "servo": Argument(
        Mapping[str, float] | None, None,
        "weights of terms that spare the servos: `goal_rate`, `saturation`, `reversals`, `heat`",
    ),
}  # fmt: skip
"""Arguments of the engine that an environment takes."""
OF_SHELLS = {"width": "of the picture [px]", "height": "of the picture [px]", "num_envs": "simulations side by side",
             "render_mode": "one of `metadata`; `None`: no pictures",
             "max_episode_steps": "control steps after which an episode ends"}  # fmt: skip
"""What the arguments of the classes for Gymnasium mean."""
HEADING = "## Arguments\n"


class TaskShell:
    """What the classes for Gymnasium share: a subclass names its task, and so has the arguments of that task.

    ``class HopperEnv(SingleEnv, task=HopperTask)`` is all that a robot adds, beside its documentation. The signature
    that ``inspect`` and notebooks show and the table of arguments are made from the task's dataclass.
    """

    task: ClassVar[type[Task]]
    __signature__: ClassVar[inspect.Signature]

    def __init_subclass__(cls, task: type[Task] | None = None, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        if task is None:
            return
        cls.task = task
        known = arguments(cls, task)
        cls.__signature__ = inspect.Signature([
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=item.kind, default=item.default)
            for name, item in known.items()
        ])  # fmt: skip
        if cls.__doc__ and HEADING in cls.__doc__:
            text = inspect.cleandoc(cls.__doc__)
            cls.__doc__ = text.replace(HEADING, f"{HEADING}\n{table(known)}", 1)


def arguments(shell: type, task: type[Task]) -> dict[str, Argument]:
    """The engine's arguments, the task's, then those of the shell's own constructor, by name."""
    known = {"robot": dataclasses.replace(ROBOT, default=task.robot.name)} if task.any_robot else {}
    known |= ENGINE
    chains = {chain if isinstance(chain, str) else "" for chain in task.robot.chains.values()}
    own = "".join(chains) if len(chains) == 1 and not task.any_robot else ""
    words = "".join(f"`{word}`, " for word in task.robot.words)
    chain = CHAIN.format(words=words, default=f"`{own}`" if own else "the robot's own")
    first = next(iter(task.robot.numbers), "")
    known["actuator"] = dataclasses.replace(ENGINE["actuator"], doc=chain)
    known["params"] = dataclasses.replace(ENGINE["params"], doc=ENGINE["params"].doc.format(first=first))
    known["control_rate"] = dataclasses.replace(ENGINE["control_rate"], default=task.control_rate)
    types = get_type_hints(task)
    known |= {
        item.name: Argument(types[item.name], item.default, _meaning(task, item.name))
        for item in dataclasses.fields(task)
    }
    types = get_type_hints(shell.__init__)
    for name, item in inspect.signature(shell.__init__).parameters.items():
        if name != "self" and item.kind is not item.VAR_KEYWORD:
            known[name] = Argument(types[name], item.default, OF_SHELLS.get(name, ""))
    return known


def _meaning(task: type[Task], name: str) -> str:
    """What a task, or the first above it that does, says of one of its numbers."""
    for kind in task.__mro__:
        item = getattr(kind, "__dataclass_fields__", {}).get(name)
        if item is not None and item.metadata:
            return item.metadata["doc"] + (f" [{item.metadata['unit']}]" if item.metadata["unit"] else "")
    return "see Rewards" if name.endswith("_weight") else ""


def table(known: Mapping[str, Argument]) -> str:
    """Arguments as a table in Markdown."""
    rows = [f"| `{name}` | {_kind(item.kind)} | `{item.default!r}` | {item.doc} |\n" for name, item in known.items()]
    return "| Parameter | Type | Default | Description |\n|---|---|---|---|\n" + "".join(rows)


def _kind(kind: Any) -> str:
    """A type in words that a table can hold."""
    parts = [part for part in (get_args(kind) or (kind,)) if part is not type(None)]
    names = [str(getattr(get_origin(part) or part, "__name__", part)) for part in parts]
    words = {"Sequence": "(low, high)", "tuple": "(low, high)", "Mapping": "dict"}
    return " or ".join(dict.fromkeys(words.get(name, name) for name in names))


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
        SealegsError: one is no number, range, or true or false, where that is taken.
    """
    open_to_none = [name for name, annotation in get_type_hints(kind).items() if type(None) in get_args(annotation)]
    switches = [item.name for item in dataclasses.fields(kind) if isinstance(item.default, bool)]
    for name, value in values.items():
        if value is None and name in open_to_none:
            continue
        if name in switches:
            if not isinstance(value, bool):
                raise SealegsError(f"{name} takes true or false, not {value!r}.")
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


def steps_of_delay(action_delay: float, timestep: float) -> int:
    """Physics steps in a delay [s].

    Raises:
        SealegsError: they are no whole number.
    """
    check_number("action_delay", action_delay)
    count = action_delay / timestep
    if action_delay < 0.0 or abs(count - round(count)) > 1e-6 * max(count, 1.0):
        raise SealegsError(
            f"action_delay is {action_delay:g} s; it must be a whole number of steps of {timestep:g} s, or 0."
        )
    return round(count)


def steps_of_rate(control_rate: float, timestep: float) -> int:
    """Physics steps of a control step at a rate [Hz].

    Raises:
        SealegsError: they are no whole number.
    """
    check_number("control_rate", control_rate)
    count = 1.0 / (control_rate * timestep) if control_rate > 0.0 else 0.0
    if round(count) < 1 or abs(count - round(count)) > 1e-6 * max(count, 1.0):
        raise SealegsError(
            f"control_rate is {control_rate:g} Hz; its period must be a whole number of steps of {timestep:g} s."
        )
    return round(count)


def check_number(name: str, value: Any) -> None:
    """Make sure that a value is a finite number.

    Raises:
        SealegsError: it is not.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not np.isfinite(value):
        raise SealegsError(f"{name} is {value!r}; it must be a finite number.")
