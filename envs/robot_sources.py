"""The files that a robot is read from: its YAML, its model with all that this includes and shows, chains of its own."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import yaml

from ..actuators.published import PREFIX
from .model_file import SUFFIXES
from .robot_entries import YAML_SUFFIXES
from .urdf_text import mesh_folder, urdf_mesh, urdf_root

ENDINGS = (*YAML_SUFFIXES, *SUFFIXES, ".json", ".npz")
"""Of what a YAML names: chains, models, fits that others published, actuator nets."""
FOLDERS = ("meshdir", "texturedir", "assetdir")
"""Where a model says that its files are, from its own folder."""


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
    if path in found or not _is_file(path):
        return
    found[path] = None
    kind = path.suffix.lower()
    for other in _of_yaml(path) if kind in YAML_SUFFIXES else _of_model(path) if kind in SUFFIXES else ():
        _collect(other, found)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a sentence is no path
        return False


def _named(document: Any, folder: Path) -> Iterator[Path]:
    """Paths in a plain document, those that are relative from a folder on."""
    if isinstance(document, dict | list):
        for entry in document.values() if isinstance(document, dict) else document:
            yield from _named(entry, folder)
    elif isinstance(document, str) and Path(document).suffix.lower() in ENDINGS:
        yield folder / document.removeprefix(PREFIX)


def _of_yaml(path: Path) -> Iterator[Path]:
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError):  # reading the robot says it
        return
    yield from _named(document, path.parent)


def _of_model(path: Path) -> Iterator[Path]:
    """Includes, meshes, textures and all else that a model names, where MuJoCo may look for it."""
    roots = list(_roots(path, path.parent, set()))
    compilers = [item for root in roots for item in root.iter("compiler")]
    folders = {"", *(item.get(key, "") for item in compilers for key in FOLDERS)}
    for root in roots:
        for item in root.iter():
            for key, name in item.attrib.items():
                if key == "filename":
                    yield urdf_mesh(path, name, mesh_folder(root))
                elif key.startswith("file") and name:
                    yield from (path.parent / folder / one for folder in folders for one in (name, Path(name).name))


def _roots(path: Path, folder: Path, seen: set[Path]) -> Iterator[ElementTree.Element]:
    """The root of a model, and those of what it includes."""
    if path in seen:
        return
    seen.add(path)
    try:
        root = urdf_root(path) if path.suffix.lower() == ".urdf" else ElementTree.parse(path).getroot()
    except (OSError, ValueError, ElementTree.ParseError):  # reading the robot says it
        return
    yield root
    for item in root.iter("include"):
        yield from _roots(folder / item.get("file", ""), folder, seen)
