"""The robot that a log is of, from its model file: a tree of hinges and slides, without what drives and brakes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np

from ...actuators.errors import nearest
from ..log.types import LogError, MeasuredRun

MODEL_FILES = (".xml", ".mjcf", ".urdf")
KINDS = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


@dataclass(frozen=True)
class Passive:
    """What a model file gives a joint beside its bodies: damping [N.m.s/rad], armature [kg.m2], dry friction [N.m]."""

    damping: float = 0.0
    armature: float = 0.0
    friction: float = 0.0


@dataclass(frozen=True)
class Frame:
    """How the angle of a joint in the log stands to that in the model: ``model = sign (log - zero)``."""

    zero: float = 0.0
    sign: float = 1.0


@dataclass(frozen=True, eq=False)
class RobotFile:
    """A robot as its model file has it.

    Attributes:
        path: of the file.
        model: its bodies and joints without damping, armature, friction, springs of joints and actuators.
        passive: of each joint, what was taken out.
        frames: of joints whose angle in the log differs from that of the model.
    """

    path: Path
    model: mujoco.MjModel
    passive: Mapping[str, Passive]
    frames: Mapping[str, Frame] = field(default_factory=dict)

    def number(self, joint: str) -> int:
        """Number of a joint in the model.

        Raises:
            LogError: there is none of that name that turns or slides.
        """
        found = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, joint)
        if found < 0 or int(self.model.jnt_type[found]) not in KINDS:
            known = list(self.passive)
            raise LogError(
                f"{self.path}: the model has no hinge or slide '{joint}'{nearest(joint, known)}; it has "
                f"{', '.join(known) or 'none'}. Joints of log and model carry the same names."
            )
        return found

    def slides(self, joint: str) -> bool:
        """Whether a joint moves along a line."""
        return int(self.model.jnt_type[self.number(joint)]) == int(mujoco.mjtJoint.mjJNT_SLIDE)

    def felt_by(self, joint: str) -> list[int]:
        """Numbers of the joints whose motion a joint feels: those that carry it and those that it carries."""
        own = int(self.model.jnt_bodyid[self.number(joint)])
        carries = {own}
        for body in range(own + 1, self.model.nbody):
            if int(self.model.body_parentid[body]) in carries:
                carries.add(body)
        body = own
        while body > 0:
            carries.add(body)
            body = int(self.model.body_parentid[body])
        return [j for j in range(self.model.njnt) if int(self.model.jnt_bodyid[j]) in carries]

    def name(self, number: int) -> str:
        """Name of a joint by its number."""
        return mujoco.mj_id2name(self.model, mujoco.mjtObj.mjOBJ_JOINT, number) or f"joint {number}"

    def frame(self, joint: str) -> Frame:
        """How the log's angle of a joint stands to the model's."""
        return self.frames.get(joint, Frame())


def robot_of(run: MeasuredRun) -> RobotFile | None:
    """The robot of a run whose sidecar names a model file; None where it names one of the collection's own.

    Raises:
        LogError: the file cannot be read.
    """
    if not is_model_file(run.robot):
        return None
    path = Path(run.robot)
    if not path.is_file():
        raise LogError(f"{run.name}: the sidecar names the robot {run.robot}, and there is no such file.")
    return _read(path, path.stat().st_mtime_ns)


def is_model_file(robot: str) -> bool:
    """Whether the word of a sidecar for its robot is a file."""
    return Path(robot).suffix.lower() in MODEL_FILES


@lru_cache(maxsize=8)
def _read(path: Path, changed: int) -> RobotFile:
    del changed  # a file that was edited is read again
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise LogError(f"{path}: MuJoCo cannot read this model: {' '.join(str(error).split())}.") from None
    passive = {}
    for joint in range(model.njnt):
        if int(model.jnt_type[joint]) in KINDS:
            dof = int(model.jnt_dofadr[joint])
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint) or f"joint {joint}"
            passive[name] = Passive(*_numbers(model, dof))
    for values in (model.dof_damping, model.dof_armature, model.dof_frictionloss, model.jnt_stiffness):
        values[:] = 0.0
    return RobotFile(path, model, passive)


def _numbers(model: mujoco.MjModel, dof: int) -> tuple[float, float, float]:
    found = (model.dof_damping, model.dof_armature, model.dof_frictionloss)
    return tuple(float(np.ravel(values[dof])[0]) for values in found)  # pyright: ignore
