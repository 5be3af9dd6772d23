"""Meshes that are not there, or that MuJoCo cannot read: the geoms that show them are left out.

Such a mesh changes no motion where the body's inertia is written down.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import mujoco

from .model_errors import line_of
from .model_mass import plain_copy
from .robot import RobotError


def without_meshes_that_fail(spec: mujoco.MjSpec, path: Path, missing: list[str], said: list[str]) -> None:
    """Leave out geoms whose mesh cannot be had, and say which meshes these are.

    Args:
        spec: of the model; it is changed.
        path: of the model.
        missing: names of files that are known not to be there.
        said: where a sentence is added for those that are not there, and one for those that cannot be read.

    Raises:
        RobotError: the mass of a body comes from such a mesh.
    """
    folder = Path(spec.modelfiledir or path.parent) / (spec.meshdir or "")
    absent = [mesh for mesh in spec.meshes if mesh.file and _place(mesh, folder) is None]
    missing = [*missing, *(mesh.file for mesh in absent)]
    _without(spec, path, {_name(mesh): "is not there; put the file beside the model" for mesh in absent})
    if missing:
        said.append(f"{path.name}: these meshes are not there: {_files(missing)}; bodies move without them, and are "
                    "not drawn.")  # fmt: skip
    if not spec.meshes or not _meshes_stop(spec):
        return
    damaged = {_name(mesh): mesh.file for mesh in spec.meshes if not _readable(mesh, folder, _touches(spec, mesh))}
    _without(spec, path, dict.fromkeys(damaged, "MuJoCo cannot read; give it as STL or OBJ"))
    if damaged:
        said.append(
            f"{path.name}: MuJoCo cannot read these meshes: {_files(damaged.values())}; bodies move without them, are "
            "not drawn, and touch nothing with them. Give them as STL or OBJ, with a volume."
        )


def _files(names: Iterable[str]) -> str:
    return ", ".join(dict.fromkeys(Path(name).name for name in names))


def _name(mesh: mujoco.MjsMesh) -> str:
    return mesh.name or Path(mesh.file).stem


def _place(mesh: mujoco.MjsMesh, folder: Path) -> Path | None:
    """Where the file of a mesh is."""
    tried = (folder / mesh.file, folder / Path(mesh.file).name)
    return next((place for place in tried if place.is_file()), None)


def _meshes_stop(spec: mujoco.MjSpec) -> bool:
    """Whether the model does not compile because of a mesh."""
    try:
        plain_copy(spec).compile()
    except ValueError as error:
        sentence = line_of(error)
        return any(word in sentence.lower() for word in ("mesh", "stl", "obj file", "decoder", ".obj"))
    return False


def _touches(spec: mujoco.MjSpec, mesh: mujoco.MjsMesh) -> bool:
    """Whether a geom of this mesh is there to touch others."""
    return any(geom.meshname == _name(mesh) and (geom.contype or geom.conaffinity) for geom in spec.geoms)


def _readable(mesh: mujoco.MjsMesh, folder: Path, touches: bool) -> bool:
    """Whether a model of this mesh alone compiles."""
    if not mesh.file or (place := _place(mesh, folder)) is None:
        return True
    alone = mujoco.MjSpec()
    alone.add_mesh(name="mesh", file=str(place), scale=mesh.scale, inertia=mesh.inertia, maxhullvert=mesh.maxhullvert)
    body = alone.worldbody.add_body(mass=1.0, inertia=[1.0, 1.0, 1.0], explicitinertial=True)
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh", contype=int(touches), conaffinity=int(touches))
    try:
        alone.compile()
    except ValueError:
        return False
    return True


def _without(spec: mujoco.MjSpec, path: Path, meshes: Mapping[str, str]) -> None:
    """Leave out meshes, by name with the reason, and the geoms that show them.

    Raises:
        RobotError: the mass of a body comes from one of them.
    """
    for geom in list(spec.geoms):
        if geom.type == mujoco.mjtGeom.mjGEOM_MESH and geom.meshname in meshes:
            if not geom.parent.explicitinertial and _moves(geom.parent):
                file = next(mesh.file for mesh in spec.meshes if _name(mesh) == geom.meshname)
                raise RobotError(
                    f"{path}: body '{geom.parent.name}' takes its mass from {Path(file).name}, which "
                    f"{meshes[geom.meshname]}, or write an inertial."
                )
            spec.delete(geom)
    for mesh in list(spec.meshes):
        if _name(mesh) in meshes:
            spec.delete(mesh)


def _moves(body: mujoco.MjsBody) -> bool:
    """Whether a joint moves a body."""
    while body.name != "world":
        if body.joints:
            return True
        body = body.parent
    return False
