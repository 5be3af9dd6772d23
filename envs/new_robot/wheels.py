"""Whether a robot whose base hangs in the air has wheels to stand on, and the height at which they touch the ground."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from ..described.as_robot import bare_model
from ..described.robot_described import RobotFile
from ..described.robot_entries import FloorEntry

LEVEL = 0.6  # sine of the angle between an axle and the vertical, from which a wheel rolls; assumed


def on_wheels(robot: RobotFile) -> RobotFile:
    """The robot with a free base on a floor that its wheels touch, and a sentence that says so.

    Left as it is one that has no two wheels with a round shape, or a place to stand of its own.
    """
    model = robot.model
    if robot.height is not None or not model.root or model.floor or model.free:
        return robot
    if any(joint.body == model.root for joint in model.joints.values()):
        return robot
    wheels = [joint.joint for joint in robot.joints if joint.by_speed and model.wheels.get(joint.joint, 0.0) > 0.0]
    if len(wheels) < 2:
        return robot
    compiled = bare_model(replace(robot, base="free"))
    data = mujoco.MjData(compiled)
    mujoco.mj_kinematics(compiled, data)
    numbers = {name: compiled.joint(name).id for name in wheels}
    rolling = [name for name, k in numbers.items() if np.hypot(*data.xaxis[k][:2]) > LEVEL]
    if len(rolling) < 2:
        return robot
    base = float(data.xpos[compiled.body(model.root).id][2])
    lowest = min(float(data.xanchor[numbers[name]][2]) - model.wheels[name] for name in rolling)
    height = float(f"{base - lowest:.4g}")
    sentence = (
        f"{model.path.name}: it stands on wheels ({', '.join(rolling)}): base is free, with a floor, at a height of "
        f"{height:g} m, where they touch it."
    )
    return replace(robot, base="free", floor=FloorEntry(), height=height, said=(*robot.said, sentence))
