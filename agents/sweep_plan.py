"""What a sweep's trainings are told: the arguments of ``sealegs train``, and the code that a person named for them.

Arguments that a sweep's folder holds are data, wherever the folder came from. A task of a file, and a callback or
wrapper of another package, are code: it runs where the command line names it, when a sweep begins and when it goes on.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..common import plugins
from ..common.errors import SealegsError
from ..envs.any_robot.user import absolute, is_user_task, trained_in
from .algorithms import foreign
from .config import read_config
from .sweep_space import Space, as_arguments, choices, each_value, read_space, refuse_unread

QUIET = "video.seconds=0"
FILES, FOLDERS = ("actuator", "hyperparams", "robot"), ("extended", "from", "randomization")
"""Keys whose words may be paths; a file is told from a name by its suffix."""


@dataclass(frozen=True)
class Code:
    """The code that a person named.

    Attributes:
        tasks: each a ``path/to/task.py:MyTask``.
        trust: whether callbacks and wrappers of packages other than ours may be loaded, and pickles of a run.
    """

    tasks: tuple[str, ...] = ()
    trust: bool = False


class Plan:
    """The arguments of each training of a sweep; they run no code that nobody named.

    Attributes:
        space: what is swept.
        code: that may run.
    """

    def __init__(self, arguments: Sequence[str], code: Code, where: str) -> None:
        """Plan of the ``arguments`` that ``where`` holds.

        Raises:
            SealegsError: nothing is swept, or a task is a file's that nobody named.
        """
        self.space: Space
        self.space, self._fixed = read_space(arguments)
        if not self.space:
            refuse_unread(self._fixed)
            raise SealegsError("Nothing is swept: give a key several values, such as agent.gamma=0.9,0.95.")
        self.code = code
        self._tasks = _named(tasks_in(arguments), code.tasks, where)
        self._foreign = False

    def check(self) -> None:
        """See that a training takes what is swept.

        Raises:
            SealegsError: it does not, or it would run code that nobody trusts.
        """
        for values in each_value(self.space):
            try:
                config = read_config(self.arguments(values), self.code.trust).config
            except SealegsError as error:
                broken = [key for key, value in values.items() if isinstance(value, float) and not value.is_integer()]
                hint = " Whole numbers are swept by int(interval(a,b))." if "whole number" in str(error) else ""
                raise SealegsError(f"{error}{hint if broken else ''}") from None
            self._foreign |= config is not None and bool(foreign(config.agent))

    def arguments(self, values: Mapping[str, Any]) -> list[str]:
        """Of the training with these values."""
        pairs = [word.partition("=")[::2] for word in [*self._fixed, *as_arguments(values)]]
        rows = []
        for key, value in ((key.strip(), value.strip()) for key, value in pairs):
            if key == "trust" and not self.code.trust:
                continue
            rows.append(f"{key}={self._tasks.get(choices(key, value)[0], value) if key == 'env' else value}")
        return rows if any(row.startswith("video.seconds=") for row in rows) else [*rows, QUIET]

    def command(self, folder: Path) -> str:
        """The command by which the sweep in ``folder`` goes on."""
        tasks = [f"env={','.join(self._tasks.values())}"] if self._tasks else []
        trusts = self._foreign or any(word.partition("=")[0].strip() == "trust" for word in self._fixed)
        trust = ["trust=true"] if self.code.trust and trusts else []
        return shlex.join(["sealegs", "sweep", f"resume={folder}", *tasks, *trust, *plugins.arguments()])


def tasks_in(arguments: Sequence[str]) -> list[str]:
    """The tasks of files that arguments name."""
    return [word for word in _words("env", arguments) if is_user_task(word)]


def _words(key: str, arguments: Sequence[str]) -> list[str]:
    given = [value for name, _, value in (word.partition("=") for word in arguments) if name.strip() == key]
    return choices(key, given[-1].strip()) if given else []


def code_of(arguments: Sequence[str], trust: bool) -> Code:
    """The code that a command line names."""
    return Code(tuple(_words("env", arguments)), trust)


def _named(said: Sequence[str], tasks: Sequence[str], where: str) -> dict[str, str]:
    """For each task that was said, the one that a person named; theirs are run."""
    if tasks and not said:
        trained_in({"id": "a task that is no file's"}, where, tasks[0], "env")
    by_file = {re.split(r"[/\\]", task)[-1]: task for task in tasks}
    given = {word: by_file.get(re.split(r"[/\\]", word)[-1], tasks[0] if tasks else None) for word in said}
    return {word: str(trained_in({"id": word}, where, task, "env")["id"]) for word, task in given.items()}


def rooted(arguments: Sequence[str]) -> list[str]:
    """The same arguments with absolute paths, so that they mean the same files from any folder."""
    rows = []
    for argument in arguments:
        key, _, value = (part.strip() for part in argument.partition("="))
        words = choices(key, value) if key in ("env", *FILES, *FOLDERS) else []
        paths = [_rooted(key, word) for word in words]
        rows.append(argument if paths == words else f"{key}={','.join(map(_quoted, paths))}")
    return rows


def _rooted(key: str, word: str) -> str:
    if key == "env":
        return absolute(word) if is_user_task(word) else word
    path, colon, entry = word.partition(":") if key == "hyperparams" else (word, "", "")
    known = key in FOLDERS or bool(Path(path).suffix)
    return f"{Path(path).absolute()}{colon}{entry}" if known and Path(path).exists() else word


def _quoted(word: str) -> str:
    return "'" + word.replace("\\", "\\\\").replace("'", "\\'") + "'"
