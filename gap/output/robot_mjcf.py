"""A robot of one's own as diagnosed, for plain MuJoCo: its model file with what MuJoCo itself can simulate of it."""

from __future__ import annotations

from pathlib import Path

import mujoco

from ...actuators.errors import SealegsError
from ...envs.extended import Extended
from ..load.robot import robot_of
from ..log.types import MeasuredSet
from .mjcf import native_text, not_native

FILE = "extended.xml"


def write_robot(extended: Extended, data: MeasuredSet, folder: Path) -> Path | None:
    """Write the model with friction, damping, armature, masses, inertias, stops and actuators as they were found.

    Returns:
        The path; None for the collection's own robots, and where what was found does not go into the model.
    """
    robot = robot_of(data.runs[0])
    if robot is None:
        return None
    machine = robot.file.robot()
    try:
        chains = extended.chains_on(machine)
        drivetrain = machine.drivetrain(chains, extended.params_on(machine))
    except SealegsError:  # the folder's own message says so where it is applied
        return None
    spec = drivetrain.spec
    source = robot.file.model.path
    _name_whole_paths(spec, drivetrain.model, source.parent)
    missing = {name: left for name, chain in drivetrain.chains.items() if (left := not_native(chain))}
    said = "; ".join(f"{name}: {', '.join(left)}" for name, left in missing.items()) or "nothing"
    note = (
        f"<!-- {source.name} as diagnosed, for plain MuJoCo; controls are position goals, or torques where the log "
        f"commands torques. Left out: {said}. -->"
    )
    path = folder / FILE
    path.write_text(f"{note}\n{native_text(spec.to_xml(), drivetrain.chains)}", encoding="utf-8")
    return path


def _name_whole_paths(spec: mujoco.MjSpec, model: mujoco.MjModel, folder: Path) -> None:
    """Name files of meshes, height fields, skins and textures by whole paths: they stay where they are.

    Args:
        spec: of the model; it is changed.
        model: compiled from it, which knows where each file was found, those of attached models too.
        folder: of the model.
    """
    for key in ("meshdir", "texturedir"):  # for the six files of a cube's texture, which the compiled model forgets
        setattr(spec, key, str((folder / (getattr(spec, key) or "")).resolve()))
    for items, addresses in (
        (spec.meshes, model.mesh_pathadr),
        (spec.hfields, model.hfield_pathadr),
        (spec.skins, model.skin_pathadr),
        (spec.textures, model.tex_pathadr),
    ):
        for item in items:
            if (start := int(addresses[item.id])) >= 0:
                name = model.paths[start:].split(b"\0", 1)[0].decode()
                item.file = str((folder / name).resolve())
