"""Reads an MJCF or URDF into specifications, and mends URDF dialects that MuJoCo refuses.

Mended are a parent ``world`` that no link declares, and meshes that are not there. A mesh that is missing changes no
motion where the body's inertia is written down; the geoms that show it are left out.
"""

from __future__ import annotations

import functools
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mujoco

from .robot import RobotError


@functools.lru_cache(maxsize=64)
def read_specs(path: Path, changed: int) -> tuple[mujoco.MjSpec, mujoco.MjSpec, tuple[str, ...]]:
    """The specification without actuators, the same with them, and what was mended."""
    del changed  # a part of the key: a file that was edited is read again
    said: list[str] = []
    missing: list[str] = []
    try:
        if path.suffix.lower() == ".urdf":
            full = mujoco.MjSpec.from_string(_mended_urdf(path, said, missing))
            full.modelfiledir = str(path.parent)
        else:
            full = mujoco.MjSpec.from_file(str(path))
    except (ValueError, OSError, ElementTree.ParseError) as error:
        raise RobotError(f"{path} cannot be read as a model: {line_of(error)}.") from None
    full.compiler.fusestatic = False  # bodies keep their names, masses and sensors
    _without_missing_meshes(full, path, missing)
    if missing:
        files = ", ".join(dict.fromkeys(Path(name).name for name in missing))
        said.append(f"{path.name}: these meshes are not there: {files}; bodies move without them, and are not drawn.")
    bare = full.copy()
    for kind in ("keys", "sensors", "actuators"):
        for item in list(getattr(bare, kind)):
            if kind != "sensors" or item.objtype == mujoco.mjtObj.mjOBJ_ACTUATOR:
                bare.delete(item)
    return bare, full, tuple(said)


def _mended_urdf(path: Path, said: list[str], missing: list[str]) -> str:
    """The URDF with a link ``world`` where joints need one, and paths of meshes that can be opened.

    Meshes that are not there are added to ``missing``: MuJoCo passes over those that are only looked at.
    """
    root = ElementTree.parse(path).getroot()
    links = {link.get("name") for link in root.iter("link")}
    parents = {item.get("link") for item in root.iter("parent")}
    if "world" in parents and "world" not in links:
        root.insert(0, ElementTree.Element("link", {"name": "world"}))
        said.append(f"{path.name} names a parent 'world' that it does not declare; it is taken for the ground.")
    for mesh in root.iter("mesh"):
        file = urdf_mesh(path, mesh.get("filename", ""))
        if not file.is_file():
            missing.append(file.name)
        mesh.set("filename", str(file))
    extension = root.find("mujoco")
    extension = ElementTree.SubElement(root, "mujoco") if extension is None else extension
    compiler = extension.find("compiler")
    compiler = ElementTree.SubElement(extension, "compiler") if compiler is None else compiler
    for key, value in (("strippath", "false"), ("fusestatic", "false")):
        compiler.set(key, value)
    return ElementTree.tostring(root, encoding="unicode")


def urdf_mesh(path: Path, name: str) -> Path:
    """Where a file lies that a URDF names; of a package, in one of the folders that the URDF lies in."""
    name = name.removeprefix("file://")
    if name.startswith("package://"):
        inner = Path(name.removeprefix("package://"))
        tried = [folder / part for folder in path.parents for part in (inner, Path(*inner.parts[1:]))]
        name = str(next((place for place in tried if place.is_file()), inner))
    return path.parent / name


def _without_missing_meshes(spec: mujoco.MjSpec, path: Path, names: list[str]) -> None:
    """Leave out geoms whose mesh is not there, and add the files of those meshes to ``names``.

    Raises:
        RobotError: the mass of a body comes from such a mesh.
    """
    folder = Path(spec.modelfiledir or path.parent) / (spec.meshdir or "")
    missing = {
        mesh.name or Path(mesh.file).stem: mesh for mesh in spec.meshes if mesh.file and not _found(mesh, folder)
    }
    for geom in list(spec.geoms):
        if geom.type == mujoco.mjtGeom.mjGEOM_MESH and geom.meshname in missing:
            if not geom.parent.explicitinertial and _moves(geom.parent):
                raise RobotError(
                    f"{path}: body '{geom.parent.name}' takes its mass from {missing[geom.meshname].file}, which is "
                    "not there; put the file beside the model, or write an inertial."
                )
            spec.delete(geom)
    for mesh in missing.values():
        names.append(mesh.file)
        spec.delete(mesh)


def _moves(body: mujoco.MjsBody) -> bool:
    """Whether a joint moves a body."""
    while body.name != "world":
        if body.joints:
            return True
        body = body.parent
    return False


def _found(mesh: mujoco.MjsMesh, folder: Path) -> bool:
    return (folder / mesh.file).is_file() or (folder / Path(mesh.file).name).is_file()


def line_of(error: Exception) -> str:
    """What an error says, in one line."""
    return " ".join(str(error).split()).rstrip(".")
