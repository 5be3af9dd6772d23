"""What others add without editing sealegs: distributions that are installed, and files that a person names.

A distribution says in its ``[project.entry-points."sealegs.stages"]`` which modules hold stages, and likewise for the
other :data:`GROUPS`. They are imported when somebody asks for what they add. A file of a person's own is run where the
command line names it (``plugins=cogging.py``), or a program does (:func:`add`); never because a log, a policy or
anything else that came from elsewhere names it.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from .errors import SealegsError

GROUPS = ("stages", "causes", "robots", "tasks", "servos")
"""What can be added; a distribution's entry points are of the group ``sealegs.<one of these>``."""
TO_CHILDREN = "SEALEGS_PLUGINS"
"""Variable of the environment in which the processes that this one starts find the files that a person named."""


def add(*files: str | Path) -> None:
    """Run files of a person's own that add stages, causes, robots, tasks or servos; again does no harm.

    Raises:
        SealegsError: there is no such file, or it cannot be run.
    """
    for file in files:
        path = Path(file).absolute()
        known = _named()
        module(path)
        if str(path) not in known:
            os.environ[TO_CHILDREN] = os.pathsep.join([*known, str(path)])


def environment() -> dict[str, str]:
    """What a process that does not take over this one's environment needs of it."""
    return {TO_CHILDREN: os.environ[TO_CHILDREN]} if _named() else {}


def arguments() -> list[str]:
    """What a command that is told to a person needs to load the same files."""
    named = ",".join(_named())
    return [f"{KEY}={f'[{named}]' if ',' in named else named}"] if named else []


def load(group: str) -> None:
    """Import what adds to a group, once.

    Raises:
        SealegsError: a distribution or file cannot be loaded.
    """
    if group not in _LOADED:
        _LOADED.add(group)  # first: what it imports may ask again
        try:
            for path in _named():  # of the process that started this one
                module(Path(path))
            for name in installed(group):
                entry(group, name)
        except BaseException:
            _LOADED.discard(group)
            raise


def installed(group: str) -> Mapping[str, EntryPoint]:
    """What installed distributions add to a group, by name."""
    assert group in GROUPS
    return {item.name: item for item in entry_points(group=f"sealegs.{group}")}


def entry(group: str, name: str) -> Any:
    """What an installed distribution adds under a name.

    Raises:
        SealegsError: it cannot be imported.
    """
    item = installed(group)[name]
    try:
        return item.load()
    except SealegsError as error:
        raise SealegsError(f"{_origin(item)} cannot be used: {error}") from error
    except Exception as error:
        raise SealegsError(
            f"{_origin(item)} cannot be imported: {type(error).__name__}: {error}; mend it or uninstall it."
        ) from error


def module(path: Path) -> ModuleType:
    """A Python file as a module, run once; it has the same name in every process, by which pickle finds it.

    Raises:
        SealegsError: there is no such file, it cannot be run, or another of its name is there.
    """
    path = path.absolute()
    name = f"sealegs_plugin_{path.stem}"
    if (known := sys.modules.get(name)) is not None:
        if known.__file__ != str(path):
            raise SealegsError(f"plugins={path}: {known.__file__} is there under that name; give one another name.")
        return known
    if path.suffix != ".py" or not path.is_file():
        raise SealegsError(f"plugins={path}: there is no Python file of that name.")
    return run_file(path, name)


def run_file(path: Path, name: str) -> ModuleType:
    """A Python file, which a person named, as the module ``name``.

    Raises:
        SealegsError: it cannot be run; no module of that name is left.
    """
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    sys.modules[name] = made
    try:
        spec.loader.exec_module(made)
    except SealegsError as error:
        del sys.modules[name]
        raise SealegsError(f"{path}: {error}") from error
    except Exception as error:
        del sys.modules[name]
        raise SealegsError(f"{path} cannot be run: {type(error).__name__}: {error}.") from error
    return made


def named_by(arguments: Iterable[str]) -> list[str]:
    """Files that the arguments of a command name: ``plugins=a.py`` or ``plugins=[a.py,b.py]``."""
    given = [item.partition("=")[2] for item in arguments if item.partition("=")[0].strip() == KEY]
    words = given[-1].strip().removeprefix("[").removesuffix("]").split(",") if given else []
    return [word.strip().strip("'\"") for word in words if word.strip() not in ("", "null")]


KEY = "plugins"
"""The argument that any command takes."""
_LOADED: set[str] = set()


def _named() -> list[str]:
    return [path for path in os.environ.get(TO_CHILDREN, "").split(os.pathsep) if path]


@cache
def _origin(item: EntryPoint) -> str:
    return f"what the installed {item.dist.name if item.dist else 'package'} adds as '{item.name}' ({item.value})"
