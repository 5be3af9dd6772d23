"""Masses that a model file does not give body by body: a total mass, and those that come from shapes."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np


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


def plain_copy(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """A copy without a total mass, of which MuJoCo warns, and without keys: of another size than the model, they would
    stop the compiler.
    """
    plain = spec.copy()
    plain.compiler.settotalmass = -1.0
    for key in list(plain.keys):
        plain.delete(key)
    return plain
