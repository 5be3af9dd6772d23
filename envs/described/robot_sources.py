"""The files that a robot is read from: its YAML, its model with all that this includes and shows, chains of its own."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from ...actuators.published import PREFIX
from ...common.documents import DocumentError, read_yaml
from .model_sources import SUFFIXES, named_files
from .robot_entries import YAML_SUFFIXES

ENDINGS = (*YAML_SUFFIXES, *SUFFIXES, ".json", ".npz")
"""Of what a YAML names: chains, models, fits that others published, actuator nets."""


def files_read(words: Iterable[str]) -> tuple[Path, ...]:
    """The files of robots and chains, with all that these read in turn, as far as they are there.

    Args:
        words: paths of files; any other word, such as the name of a built-in robot, is passed over.
    """
    found: dict[Path, None] = {}
    for word in words:
        for path in _named(word, Path.cwd()):
            _collect(path, found)
    return tuple(found)


def _collect(path: Path, found: dict[Path, None]) -> None:
    path = path.resolve()
    if path in found or not os.path.isfile(path):  # a sentence is no path
        return
    found[path] = None
    kind = path.suffix.lower()
    for other in _of_yaml(path) if kind in YAML_SUFFIXES else _of_model(path) if kind in SUFFIXES else ():
        _collect(other, found)


def _named(document: Any, folder: Path) -> Iterator[Path]:
    """Paths in a plain document, those that are relative from a folder on."""
    if isinstance(document, dict | list):
        for entry in document.values() if isinstance(document, dict) else document:
            yield from _named(entry, folder)
    elif isinstance(document, str) and Path(document).suffix.lower() in ENDINGS:
        yield folder / document.removeprefix(PREFIX)


def _of_yaml(path: Path) -> Iterator[Path]:
    try:
        document = read_yaml(path)
    except DocumentError:  # reading the robot says it
        return
    yield from _named(document, path.parent)


def _of_model(path: Path) -> Iterator[Path]:
    try:
        yield from named_files(path)
    except DocumentError:  # reading the robot says it
        return
