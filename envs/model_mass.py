"""A total mass that a model asks for, worked into the masses of its bodies: MuJoCo drops the attribute some day."""

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


def plain_copy(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """A copy without a total mass, of which MuJoCo warns, and without keys: of another size than the model, they would
    stop the compiler.
    """
    plain = spec.copy()
    plain.compiler.settotalmass = -1.0
    for key in list(plain.keys):
        plain.delete(key)
    return plain
