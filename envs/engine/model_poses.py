"""Where the joints of a model stand in a keyframe of its file, by what they are called: chains move their addresses."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

Label = tuple[str, str]
"""A joint by its own name, or one without a name by that of its body: ``("elbow", "")``, ``("", "trunk")``."""
Pose = Mapping[Label, tuple[float, ...]]
"""Positions of joints [rad or m]: one of a hinge or slide, a quaternion of a ball, place and quaternion of a free
one."""
SIZES = {int(mujoco.mjtJoint.mjJNT_FREE): 7, int(mujoco.mjtJoint.mjJNT_BALL): 4}
"""Positions that a joint has, where that is not one."""


def keyframes(full: mujoco.MjSpec, model: mujoco.MjModel) -> list[mujoco.MjsKey]:
    """Keyframes of a file that hold a position for each joint: a file can hold others, for more than the robot."""
    return [key for key in full.keys if len(key.qpos) == model.nq]


def home_pose(full: mujoco.MjSpec, model: mujoco.MjModel) -> np.ndarray:
    """Positions (nq,) in the keyframe ``home``, or in the first one; without one, in the pose of the file."""
    keys = keyframes(full, model)
    pose = next((key.qpos for key in keys if key.name == "home"), keys[0].qpos if keys else model.qpos0)
    return np.array(pose, dtype=float)


def standing(model: mujoco.MjModel, qpos: np.ndarray) -> Pose:
    """The joints that stand elsewhere in ``qpos`` (nq,) than in the model's own pose, quaternions made units."""
    found = {}
    for label, number in numbers(model).items():
        at = _place(model, number)
        values = np.array(qpos[at], dtype=float)
        if len(values) > 1:
            length = float(np.linalg.norm(values[-4:]))
            values[-4:] = values[-4:] / length if length > 0.0 else model.qpos0[at][-4:]
        if not np.allclose(values, model.qpos0[at], rtol=0.0, atol=1e-12):
            found[label] = tuple(float(value) for value in values)
    return found


def stand(model: mujoco.MjModel, pose: Pose, qpos: np.ndarray) -> None:
    """Put joints in ``qpos`` (..., nq) to where they stand in a pose; those that the model lacks are passed over."""
    if not pose:
        return
    for label, number in numbers(model).items():
        at = _place(model, number)
        if len(values := pose.get(label, ())) == at.stop - at.start:
            qpos[..., at] = values


def numbers(model: mujoco.MjModel) -> dict[Label, int]:
    """Joints of a model; those that cannot be told apart are left out."""
    found: dict[Label, int] = {}
    twice = {("", "")}
    for number in range(model.njnt):
        name = model.joint(number).name
        label = (name, "") if name else ("", model.body(int(model.jnt_bodyid[number])).name)
        twice |= {label} & found.keys()
        found[label] = number
    return {label: number for label, number in found.items() if label not in twice}


def _place(model: mujoco.MjModel, number: int) -> slice:
    """Addresses of the positions of a joint."""
    first = int(model.jnt_qposadr[number])
    return slice(first, first + SIZES.get(int(model.jnt_type[number]), 1))
