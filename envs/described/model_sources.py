"""The files that a model names, and the check that comes before MuJoCo's own reader opens any of them.

A model may name files outside of its folder, as many do (``../meshes``). Each must be a regular file of a size that can
be read, and each text of it must be one that :func:`sealegs.common.documents.read_xml` reads.
"""

from __future__ import annotations

import contextlib
import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ...actuators.published import PREFIX
from ...common.documents import DocumentError, read_xml, read_yaml, regular
from .robot_entries import YAML_SUFFIXES
from .urdf_text import mesh_folder, urdf_mesh, urdf_root

SUFFIXES = (".xml", ".mjcf", ".urdf")
FOLDERS = ("meshdir", "texturedir", "assetdir")
"""Where a model says that its files are, from its own folder."""
PARTS = ("include", "model")
"""Elements that name a file of the same kind."""
MOST_PARTS = 200
ASSET = 2**28  # [B] of a mesh or a texture
MOST_ELEMENTS = 50_000
"""Of a model once what it repeats and attaches is written out."""
JOINT = 20
"""Elements that one joint counts for: the mass matrix grows with their square."""
GRID = ("width", "height", "nrow", "ncol")
MOST_CELLS = 2**24
"""Of a texture or a height field that the text describes."""
USER = ("nkey", "nuserdata", "nuser_")
MOST_USER = 10_000
"""Of keyframes, or of user's numbers of an element."""


def check_files(path: Path) -> None:
    """Refuse a model, before MuJoCo opens it, whose text or files are not what they must be.

    Raises:
        DocumentError: a text is no XML or beyond the bounds, includes itself, repeats too much, or names a device, a
            pipe or a file that is too large.
    """
    for file in named_files(path):
        if file.suffix.lower() not in SUFFIXES and os.path.exists(file) and not os.path.isdir(file):
            regular(file, ASSET)


def named_files(path: Path) -> Iterator[Path]:
    """Parts, meshes, textures and all else that a model names, where MuJoCo may look for it; some are not there.

    Raises:
        DocumentError: a text of it cannot be read.
    """
    parts: dict[Path, ElementTree.Element] = {}
    _collect(path.resolve(), path.resolve().parent, parts, {}, ())
    compilers = [item for root in parts.values() for item in root.iter("compiler")]
    folders = {"", *(item.get(key, "") for item in compilers for key in FOLDERS)}
    for place, root in parts.items():
        for item in root.iter():
            for key, name in item.attrib.items():
                if key == "filename":
                    yield urdf_mesh(place, name, mesh_folder(root))
                elif key.startswith("file") and name:
                    homes = dict.fromkeys((path.parent, place.parent))
                    words = (name, Path(name).name)
                    yield from (home / folder / word for home in homes for folder in folders for word in words)


def _collect(
    path: Path, folder: Path, parts: dict[Path, ElementTree.Element], sizes: dict[Path, int], within: tuple[Path, ...]
) -> int:
    """Read a model and its parts.

    Args:
        path: of the model, or of a part.
        folder: of the whole model.
        parts: takes the root of each file.
        sizes: takes the elements of each file, written out.
        within: the files that include this one.

    Returns:
        The elements of this one.
    """
    if path in within:
        raise DocumentError(path, "includes itself; take that line out")
    if path in sizes:
        return sizes[path]
    if path.suffix.lower() not in SUFFIXES:  # whatever else it is, nothing of it is told
        raise DocumentError(path, f"is no part of a model; its name must end in {', '.join(SUFFIXES)}")
    if len(parts) == MOST_PARTS:
        raise DocumentError(path, f"is one of more than {MOST_PARTS} files that include each other")
    parts[path] = root = urdf_root(path) if path.suffix.lower() == ".urdf" else read_xml(path)
    named: dict[ElementTree.Element, int] = {}
    for item in root.iter():
        if item.tag in PARTS and (name := item.get("file")):
            places = [place for place in dict.fromkeys((folder / name, path.parent / name)) if os.path.exists(place)]
            found = [_collect(place.resolve(), folder, parts, sizes, (*within, path)) for place in places]
            named[item] = max(found, default=0)
    attached = max((size for item, size in named.items() if item.tag == "model"), default=0)
    sizes[path] = size = _elements(root, {item: named[item] for item in named if item.tag == "include"}, attached, path)
    return size


def _elements(root: ElementTree.Element, included: Mapping[ElementTree.Element, int], attached: int, path: Path) -> int:
    """Elements of a file once what it repeats, includes and attaches is written out.

    Raises:
        DocumentError: there are more than MuJoCo makes in a few seconds.
    """
    total, left = 0.0, [(root, 1.0)]
    while left:
        item, times = left.pop()
        times *= _product(item, ("count",))
        total += times * (JOINT if item.tag in ("joint", "freejoint") else 1)
        total += times * (included.get(item, 0) + (attached if item.tag == "attach" else 0))
        if total > MOST_ELEMENTS:
            raise DocumentError(path, f"stands for more than {MOST_ELEMENTS} elements, a joint counted as {JOINT}")
        if _product(item, GRID) > MOST_CELLS:
            raise DocumentError(path, f"has a <{item.tag}> of more than {MOST_CELLS} cells; give it as a file")
        if any(_product(item, (key,)) > MOST_USER for key in item.attrib if key.startswith(USER)):
            raise DocumentError(path, f"has a <{item.tag}> of more than {MOST_USER} numbers or keyframes")
        left += [(child, times) for child in item]
    return int(total)


def _product(item: ElementTree.Element, keys: Iterable[str]) -> float:
    """Product of the whole numbers in some attributes; those below 1, and what is no number, count as 1."""
    found = 1.0
    for word in " ".join(item.get(key, "") for key in keys).split():
        with contextlib.suppress(ValueError):
            found *= max(float(word), 1.0)
    return found


# --- the files that a robot is read from: its YAML, its model with all that this includes and shows, chains of its
# own.

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
            _follow(path, found)
    return tuple(found)


def _follow(path: Path, found: dict[Path, None]) -> None:
    path = path.resolve()
    if path in found or not os.path.isfile(path):  # a sentence is no path
        return
    found[path] = None
    kind = path.suffix.lower()
    for other in _of_yaml(path) if kind in YAML_SUFFIXES else _of_model(path) if kind in SUFFIXES else ():
        _follow(other, found)


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
