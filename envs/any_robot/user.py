"""A user's own task: a class in a Python file anywhere, named ``path/to/task.py:MyTask``."""

from __future__ import annotations

import hashlib
import importlib.util
import re
import sys
import types
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium as gym

from ...actuators.errors import SealegsError, nearest
from ..arguments import TaskShell
from ..single import SingleEnv
from ..task import Task
from ..vector import BatchVectorEnv

_WORD = re.compile(r"(?P<path>.+\.py):(?P<name>\w+)")


def is_user_task(word: str) -> bool:
    """Whether a word for an environment names a class in a file."""
    return _WORD.fullmatch(str(word)) is not None


def absolute(word: str) -> str:
    """The same with an absolute path, so that a run means the same file from any folder."""
    match = _WORD.fullmatch(word)
    assert match is not None
    return f"{Path(match['path']).absolute()}:{match['name']}"


def file_of(word: str) -> Path:
    """The file of a task that :func:`is_user_task`."""
    return Path(absolute(word).rpartition(":")[0])


def user_id(word: str) -> str:
    """Register the task with Gymnasium and return its id; again does no harm.

    Raises:
        SealegsError: there is no such file or class, the file cannot be run, or the class is no task.
    """
    match = _WORD.fullmatch(absolute(word))
    assert match is not None
    path, name = Path(match["path"]), match["name"]
    if not path.is_file():
        raise SealegsError(f"there is no file {path} with a task.")
    content = path.read_bytes()
    number = hashlib.sha256(str(path).encode() + content).hexdigest()[:8]
    identity = f"file-{number}/{name}-v0"
    if identity in gym.registry:
        return identity
    module = _module(path, number)
    task = getattr(module, name, None)
    if task is None:
        known = [key for key, item in vars(module).items() if _is_task(item) and item.__module__ == module.__name__]
        raise SealegsError(f"{path} has no {name}{nearest(name, known)}; its tasks are {', '.join(known) or 'none'}.")
    if not _is_task(task):
        raise SealegsError(
            f"{path}: {name} is no task; make it a dataclass(frozen=True) from sealegs.envs.task.Task, or from "
            "sealegs.envs.any_robot.task.AnyRobotTask, with all of their methods."
        )
    shells = {kind: _shell(kind, task, name, module) for kind in (SingleEnv, BatchVectorEnv)}
    gym.register(
        id=identity,
        entry_point=shells[SingleEnv],
        vector_entry_point=shells[BatchVectorEnv],
        max_episode_steps=task.episode_steps,
    )
    return identity


def _shell(kind: type[TaskShell], task: type[Task], name: str, module: ModuleType) -> Any:
    """The environment of a task, in the task's own module, where pickle looks for it."""
    label = f"{name}{'Env' if kind is SingleEnv else 'VectorEnv'}"
    body: dict[str, Any] = {"__doc__": task.__doc__, "__module__": module.__name__, "__qualname__": label}
    shell = types.new_class(label, (kind,), {"task": task}, lambda namespace: namespace.update(body))
    setattr(module, label, shell)
    return shell


def _is_task(value: object) -> bool:
    return isinstance(value, type) and issubclass(value, Task) and not getattr(value, "__abstractmethods__", None)


def _module(path: Path, number: str) -> ModuleType:
    """The file as a module; what it prints or raises is the user's."""
    name = f"sealegs_task_{number}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except SealegsError:
        raise
    except Exception as error:
        del sys.modules[name]
        raise SealegsError(f"{path} cannot be run: {type(error).__name__}: {error}.") from error
    return module
