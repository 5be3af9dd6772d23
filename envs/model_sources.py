"""The files that a model names, and the check that comes before MuJoCo's own reader opens any of them.

A model may name files outside of its folder, as many do (``../meshes``). Each must be a regular file of a size that can
be read, and each text of it must be one that :func:`sealegs.common.documents.read_xml` reads.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

from ..common.documents import DocumentError, read_xml, regular
from .urdf_text import mesh_folder, urdf_mesh, urdf_root

SUFFIXES = (".xml", ".mjcf", ".urdf")
FOLDERS = ("meshdir", "texturedir", "assetdir")
"""Where a model says that its files are, from its own folder."""
PARTS = ("include", "model")
"""Elements that name a file of the same kind."""
MOST_PARTS = 200
ASSET = 2**28  # [B] of a mesh or a texture


def check_files(path: Path) -> None:
    """Refuse a model, before MuJoCo opens it, whose text or files are not what they must be.

    Raises:
        DocumentError: a text is no XML or beyond the bounds, includes itself, or names a device, a pipe, a folder or a
            file that is too large.
    """
    for file in named_files(path):
        if file.suffix.lower() not in SUFFIXES and file.exists() and not file.is_dir():
            regular(file, ASSET)


def named_files(path: Path) -> Iterator[Path]:
    """Parts, meshes, textures and all else that a model names, where MuJoCo may look for it; some are not there.

    Raises:
        DocumentError: a text of it cannot be read.
    """
    parts: dict[Path, ElementTree.Element] = {}
    _collect(path.resolve(), path.resolve().parent, parts, ())
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


def _collect(path: Path, folder: Path, parts: dict[Path, ElementTree.Element], within: tuple[Path, ...]) -> None:
    """Read a model and its parts.

    Args:
        path: of the model, or of a part.
        folder: of the whole model.
        parts: takes the root of each file.
        within: the files that include this one.
    """
    if path in within:
        raise DocumentError(path, "includes itself; take that line out")
    if path in parts:
        return
    if len(parts) == MOST_PARTS:
        raise DocumentError(path, f"is one of more than {MOST_PARTS} files that include each other")
    parts[path] = root = urdf_root(path) if path.suffix.lower() == ".urdf" else read_xml(path)
    for item in root.iter():
        if item.tag in PARTS and (name := item.get("file")):
            for place in dict.fromkeys((folder / name, path.parent / name)):
                if place.exists():
                    _collect(place.resolve(), folder, parts, (*within, path))
