"""A robot of one's own as diagnosed, for plain MuJoCo: its model file with what MuJoCo itself can simulate of it."""

from __future__ import annotations

from pathlib import Path

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
    if list(spec.meshes) or list(spec.textures):  # which stay where they are
        for kind in ("meshdir", "texturedir"):
            setattr(spec, kind, str((source.parent / (getattr(spec, kind) or "")).resolve()))
    missing = {name: left for name, chain in drivetrain.chains.items() if (left := not_native(chain))}
    said = "; ".join(f"{name}: {', '.join(left)}" for name, left in missing.items()) or "nothing"
    note = (
        f"<!-- {source.name} as diagnosed, for plain MuJoCo; controls are position goals, or torques where the log "
        f"commands torques. Left out: {said}. -->"
    )
    path = folder / FILE
    path.write_text(f"{note}\n{native_text(spec.to_xml(), drivetrain.chains)}", encoding="utf-8")
    return path
