"""A user's own task: a class in a Python file anywhere, named ``path/to/task.py:MyTask``, or one that an installed
distribution adds, named ``plugins/<name of its entry point>``.

Its file is run where a person or a caller names it (:func:`user_id`), and nowhere else. A policy, a contract and a run
folder are data: the task that they name is looked up among those that were run already (:func:`known_user_id`), or
compared with the one that the command line names (:func:`trained_in`).
"""

from __future__ import annotations

import hashlib
import inspect
import re
import shlex
import sys
import types
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium as gym

from ...common import plugins
from ...common.errors import SealegsError, nearest
from ..engine.arguments import TaskShell
from ..engine.task import Task
from ..engine.vector import BatchVectorEnv, SingleEnv

_WORD = re.compile(r"(?P<path>.+\.py):(?P<name>\w+)")
INSTALLED = "plugins/"
"""Before the name of an installed task."""


def is_user_task(word: str) -> bool:
    """Whether a word for an environment names a class in a file, or an installed task."""
    return _WORD.fullmatch(str(word)) is not None or str(word).startswith(INSTALLED)


def absolute(word: str) -> str:
    """The same with an absolute path, so that a run means the same file from any folder."""
    if word.startswith(INSTALLED):
        return word
    match = _WORD.fullmatch(word)
    assert match is not None
    return f"{Path(match['path']).absolute()}:{match['name']}"


def file_of(word: str) -> Path:
    """The file of a task that :func:`is_user_task`."""
    if word.startswith(INSTALLED):
        return Path(inspect.getfile(_installed(word)))
    return Path(absolute(word).rpartition(":")[0])


def user_id(word: str) -> str:
    """Run the task's file, register the task with Gymnasium and return its id; again does no harm.

    Raises:
        SealegsError: there is no such file, class or installed task, the file cannot be run, or the class is no task.
    """
    if word.startswith(INSTALLED):
        identity = f"{word.removesuffix('-v0')}-v0"
        if identity not in gym.registry:
            _register(identity, _installed(word))
        return identity
    match = _WORD.fullmatch(absolute(word))
    assert match is not None
    path, name = Path(match["path"]), match["name"]
    if not path.is_file():
        raise SealegsError(f"there is no file {path} with a task.")
    number = f"{_number(str(path).encode())}-{_number(path.read_bytes())}"
    identity = f"file-{number}/{name}-v0"
    if identity in gym.registry:
        gym.registry[identity] = gym.registry.pop(identity)  # the one that was named last
        return identity
    module = plugins.run_file(path, f"sealegs_task_{number}")
    task = getattr(module, name, None)
    if task is None:
        known = [key for key, item in vars(module).items() if _is_task(item) and item.__module__ == module.__name__]
        raise SealegsError(f"{path} has no {name}{nearest(name, known)}; its tasks are {', '.join(known) or 'none'}.")
    if not _is_task(task):
        raise SealegsError(
            f"{path}: {name} is no task; make it a dataclass(frozen=True) from sealegs.envs.engine.task.Task, or from "
            "sealegs.envs.any_robot.task.AnyRobotTask, with all of their methods."
        )
    _register(identity, task)
    return identity


def _installed(word: str) -> type[Task]:
    """The class of an installed task, by its word or its id."""
    name, known = word.removeprefix(INSTALLED).removesuffix("-v0"), plugins.installed("tasks")
    if name not in known:
        raise SealegsError(
            f"no installed package adds a task '{name}'{nearest(name, known)}; there are {', '.join(known) or 'none'}."
        )
    task = plugins.entry("tasks", name)
    if not _is_task(task):
        raise SealegsError(
            f"{word}: {known[name].value} is no task; make it a dataclass from sealegs.envs.engine.task.Task."
        )
    return task


def _register(identity: str, task: type[Task]) -> None:
    module = sys.modules[task.__module__]
    shells = {kind: _shell(kind, task, task.__name__, module) for kind in (SingleEnv, BatchVectorEnv)}
    gym.register(
        id=identity,
        entry_point=shells[SingleEnv],
        vector_entry_point=shells[BatchVectorEnv],
        max_episode_steps=task.episode_steps,
    )


def known_user_id(word: str) -> str | None:
    """The id of a task whose file was run in this process, as it was when it was named last; None where it was not."""
    if word.startswith(INSTALLED):
        identity = f"{word.removesuffix('-v0')}-v0"
        return identity if identity in gym.registry else None
    path, _, name = absolute(word).rpartition(":")
    start, end = f"file-{_number(path.encode())}-", f"/{name}-v0"
    return next((key for key in reversed(gym.registry) if key.startswith(start) and key.endswith(end)), None)


def trained_in(env: Mapping[str, Any], where: str, task: str | None, key: str = "task") -> dict[str, Any]:
    """The environment that a policy or a run says it was trained in, with the task's file where the person has it.

    Args:
        env: id and arguments of the environment, as the file has them.
        where: the file, for the message.
        task: what the person named as ``path/to/task.py:MyTask``; its file is run. None: nothing.
        key: by which the command line names it.

    Raises:
        SealegsError: the environment is a file's, which nobody named; or another one than the person named.
    """
    said = str(env.get("id"))
    if task is not None and not is_user_task(task):
        raise SealegsError(
            f"{key}={task} is no task of your own, which is path/to/task.py:MyTask; leave {key}= out for any other."
        )
    if not is_user_task(said):
        if task is not None:
            raise SealegsError(f"{where} was trained in {said}, which comes with sealegs: leave {key}= out.")
        return dict(env)
    if task is None:
        if known_user_id(said) is not None:  # this process was told of it
            return dict(env)
        raise SealegsError(
            f"{where} was trained in {said}, and code is not run because a file names it: give "
            f"{shlex.quote(f'{key}={said}')}, or where you have that file, if you trust it."
        )
    file, name = (re.split(r"[/\\]", word)[-1] for word in (said, task))
    if file != name:
        raise SealegsError(f"{where} was trained in {file}, and {key}={task} is another task: give the path of {file}.")
    user_id(task)
    return {**env, "id": absolute(task)}


def _number(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:8]


def _shell(kind: type[TaskShell], task: type[Task], name: str, module: ModuleType) -> Any:
    """The environment of a task, in the task's own module, where pickle looks for it."""
    label = f"{name}{'Env' if kind is SingleEnv else 'VectorEnv'}"
    body: dict[str, Any] = {"__doc__": task.__doc__, "__module__": module.__name__, "__qualname__": label}
    shell = types.new_class(label, (kind,), {"task": task}, lambda namespace: namespace.update(body))
    setattr(module, label, shell)
    return shell


def _is_task(value: object) -> bool:
    return isinstance(value, type) and issubclass(value, Task) and not getattr(value, "__abstractmethods__", None)
