"""Which joints of a model are driven where nobody says so, and which ones nothing drives."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from ...actuators.stages.friction import Friction
from .model_drives import ModelDrive
from .model_file import UNITS, ModelFile

BOUNDS = {field.name: field.metadata for field in dataclasses.fields(Friction)}
"""Of what a chain's friction takes."""


def chosen(model: ModelFile) -> tuple[list[str], list[str]]:
    """Coordinates that are driven: those of the actuators, else all joints; and those that cannot be, in words.

    A damping or a dry friction beyond what any drive has is a way to write that a joint stands still.
    """
    drives = {drive.name: drive for drive in model.drives}
    names = list(drives) or [name for name in model.joints if name not in model.followers]
    kept, held = [], []
    for name in names:
        reason = _held(model, name, drives.get(name))
        if reason:
            held.append(reason)
        else:
            kept.append(name)
    return kept, held


def _held(model: ModelFile, name: str, drive: ModelDrive | None) -> str:
    """Why a coordinate stands still; empty where it does not."""
    joint, ratio = (name, 1.0) if drive is None else drive.terms[-1]
    found = model.joints[joint]
    position, force = UNITS[found.kind]
    for key, value, bound, unit in (
        ("damping", found.damping / ratio**2, _most("viscous"), f"{force}.s/{position}"),
        ("frictionloss", found.frictionloss / abs(ratio), _most("coulomb"), force),
    ):
        if value > bound:
            return (
                f"joint '{joint}' has a {key} of {value:g} {unit} in {model.path.name}, which holds it in place; "
                f"correct it there if it should move: a drive has at most {bound:g}"
            )
    return ""


def _most(key: str) -> float:
    return float(BOUNDS[key]["high"])


def none_to_drive(model: ModelFile) -> str:
    """That a model has nothing that could be driven, and what to do, as a sentence."""
    _, held = chosen(model)
    if held:
        return f"no joint can be driven: {held[0]}."
    if model.unnamed:
        return (
            f"no joint can be driven, since there are only {', '.join(model.unnamed[:3])}; give hinges and slides a "
            'name: <joint name="elbow" .../>.'
        )
    return "there is no hinge and no slide that could be driven; give a robot with joints."


def passive(model: ModelFile, driven: Sequence[str]) -> list[str]:
    """Joints of a model that nothing drives and nothing leads, in words.

    Args:
        model: as read.
        driven: names of joints of the model.
    """
    named = [name for name in model.joints if name not in driven and name not in model.followers]
    return [*(f"the {model.joints[name].kind} {name}" for name in named), *model.unnamed]


def passive_sentence(model: ModelFile, driven: Sequence[str]) -> list[str]:
    """That joints are passive, where there are any."""
    if not (found := passive(model, driven)):
        return []
    return [
        f"{model.path.name}: nothing drives {', '.join(found)}; such joints move freely, with the springs, damping and "
        "friction of the file."
    ]
