"""Meshes that are not there, or that MuJoCo cannot read: the geoms that show them are left out.

Such a mesh changes no motion where the body's inertia is written down.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

import mujoco
import numpy as np

from ...common.errors import WARNING
from ..engine.numbers import RobotError
from .model_errors import line_of


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
    places = _places(spec, path) if _meshes_stop(spec) else {}  # MuJoCo itself knows best what it finds
    absent = {_name(mesh): mesh.file for mesh in spec.meshes if mesh.file and places.get(_name(mesh), path) is None}
    missing = [*missing, *absent.values()]
    _without(spec, path, dict.fromkeys(absent, "is not there; put the file beside the model"))
    if missing:
        said.append(f"{path.name}: these meshes are not there: {_files(missing)}; bodies move without them, and are "
                    "not drawn.")  # fmt: skip
    if not places or not _meshes_stop(spec):
        return
    damaged = {
        _name(mesh): mesh.file for mesh in spec.meshes if not _readable(mesh, places[_name(mesh)], _touches(spec, mesh))
    }
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


def _places(spec: mujoco.MjSpec, path: Path) -> dict[str, Path | None]:
    """Where the file of each mesh is, by name of the mesh: those of an attached model lie in that model's folders."""
    home = Path(spec.modelfiledir or path.parent)
    named = [] if path.suffix.lower() == ".urdf" else [Path(name) for name in mujoco.mju_getXMLDependencies(str(path))]
    found = {}
    for mesh in spec.meshes:
        folder = Path(mesh.compiler.meshdir or "")
        inside = folder / mesh.file
        tried = [home / inside, home / folder / Path(mesh.file).name]
        tried += [place for place in named if place.parts[-len(inside.parts) :] == inside.parts]
        found[_name(mesh)] = next((place for place in tried if mesh.file and os.path.isfile(place)), None)
    return found


def _meshes_stop(spec: mujoco.MjSpec) -> bool:
    """Whether the model does not compile because of a mesh."""
    if not spec.meshes:
        return False
    try:
        plain_copy(spec).compile()
    except ValueError as error:
        files = [Path(mesh.file).name.lower() for mesh in spec.meshes if mesh.file]
        return any(word in line_of(error).lower() for word in ("mesh", "stl", "obj file", "decoder", ".obj", *files))
    return False


def _touches(spec: mujoco.MjSpec, mesh: mujoco.MjsMesh) -> bool:
    """Whether a geom of this mesh is there to touch others."""
    return any(geom.meshname == _name(mesh) and (geom.contype or geom.conaffinity) for geom in spec.geoms)


def _readable(mesh: mujoco.MjsMesh, place: Path | None, touches: bool) -> bool:
    """Whether a model of this mesh alone compiles."""
    if place is None:
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


# --- masses that a model file does not give body by body: a total mass, and those that come from shapes --------------


def with_total_mass(spec: mujoco.MjSpec, path: Path, said: list[str]) -> None:
    """Scale masses and densities of a model that has ``settotalmass``, and say so.

    MuJoCo would do the same, but warn of it each time that the model is compiled.

    Args:
        spec: of the model; it is changed.
        path: of the model.
        said: where a sentence is added.
    """
    total = float(spec.compiler.settotalmass)
    if total <= 0.0:
        return
    try:
        before = float(np.sum(plain_copy(spec).compile().body_mass))
    except ValueError:  # surveying the model says it
        return
    if before <= 0.0:
        return
    factor = total / before
    spec.compiler.settotalmass = -1.0
    for geom in spec.geoms:
        geom.density, geom.mass = factor * geom.density, factor * geom.mass
    for body in spec.bodies:
        if body.explicitinertial:
            body.mass, body.inertia = factor * body.mass, factor * body.inertia
            body.fullinertia = factor * body.fullinertia
    said.append(f"{path.name} asks for a total mass of {total:g} kg; its masses are multiplied by {factor:.4g}.")


def without_masses_of_shapes(spec: mujoco.MjSpec, path: Path) -> None:
    """Take their masses from links of a URDF that have no inertial and are fixed to one that has: there they have none.

    MuJoCo would take their shapes for solid.

    Args:
        spec: of the model; it is changed.
        path: of the model.
    """
    if path.suffix.lower() != ".urdf":
        return
    groups: dict[str, list[mujoco.MjsBody]] = {}
    for body in spec.bodies[1:]:
        first = body
        while not first.joints and first.parent.name != "world":
            first = first.parent
        groups.setdefault(first.name, []).append(body)
    for group in groups.values():
        if any(body.explicitinertial and body.mass > 0.0 for body in group):
            for geom in [geom for body in group if not body.explicitinertial for geom in body.geoms]:
                geom.mass = 0.0


def told_guessed_masses(spec: mujoco.MjSpec, path: Path, said: list[str]) -> None:
    """Say which links of a URDF have no mass of their own, and which mass MuJoCo gives them from their shapes.

    Args:
        spec: of the model.
        path: of the model.
        said: where a sentence is added.
    """
    bare = [body.name for body in spec.bodies[1:] if not body.explicitinertial and body.name]
    if path.suffix.lower() != ".urdf" or not bare:
        return
    try:
        model = plain_copy(spec).compile()
    except ValueError:  # surveying the model says it
        return
    masses = {name: float(model.body(name).mass[0]) for name in bare}
    if given := [f"{name} {mass:.3g} kg" for name, mass in masses.items() if mass > 0.0]:
        said.append(
            f"{path.name} gives no <inertial> for {len(given)} of its links; MuJoCo takes their shapes for solid, of "
            f"1000 kg/m3: {', '.join(given)}. Write their masses into the file."
        )


LARGEST, HEAVIEST = 20.0, 500.0  # [m], [kg] of a robot, beyond which its file may have other units; assumed


def told_sizes(model: mujoco.MjModel, path: Path) -> list[str]:
    """Ask for the units of a URDF's robot that is larger or heavier than robots are, and name massless moving links.

    Args:
        model: compiled.
        path: of the model.
    """
    if path.suffix.lower() != ".urdf":
        return []
    said, size, mass = [], float(model.stat.extent), float(mujoco.mj_getTotalmass(model))
    if size > LARGEST:
        said.append(
            f"{WARNING}{path.name}: the robot is {size:.3g} m across; are its lengths millimetres? A URDF has metres."
        )
    if mass > HEAVIEST:
        said.append(
            f"{WARNING}{path.name}: the robot weighs {mass:.4g} kg; are its masses grams? A URDF has kilograms."
        )
    moved = (k for k in range(1, model.nbody) if model.body_jntnum[k])
    if bare := [model.body(k).name for k in moved if model.body_mass[k] <= 0.0]:
        said.append(
            f"{path.name}: links that move without a mass of their own: {', '.join(bare)}; what is fixed to each "
            "counts alone. Write their masses (<inertial>) into the file."
        )
    return said


def plain_copy(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """A copy without a total mass, of which MuJoCo warns, and without keys: of another size than the model, they would
    stop the compiler.
    """
    plain = spec.copy()
    plain.compiler.settotalmass = -1.0
    for key in list(plain.keys):
        plain.delete(key)
    return plain
