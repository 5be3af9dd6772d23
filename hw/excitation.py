"""Motions of the library of excitations on all joints of a robot."""

from __future__ import annotations

import numpy as np

from ..actuators.errors import SealegsError, nearest
from .commands import Trajectory
from .robot import ServoRobot

REACH = 0.9  # [rad] of an excitation to either side of the middle of a hinge's range
SHARE = 0.8  # of half the range, where that is less or the joint slides


def library_excitation(word: str, robot: ServoRobot, reach: float | None, seed: int) -> Trajectory:
    """An excitation of the library on every joint, each about the middle of its range.

    Args:
        word: its name.
        robot: that moves.
        reach: to either side [rad or m]; None: :data:`REACH`, or a share of the range that is less than that.
        seed: of the excitation.

    Raises:
        SealegsError: there is none of that name, or ``reach`` is more than a joint has.
    """
    from ..gap.experiment import RATE as SAMPLES
    from ..gap.experiment import library

    columns, reaches = [], {}
    for k, (joint, unit) in enumerate(zip(robot.joints, robot.units, strict=True)):
        half = 0.5 * (joint.high - joint.low)
        most = min(REACH, SHARE * half) if unit == "rad" else SHARE * half
        reaches[joint.name] = own = most if reach is None else reach
        if not 0.0 < own <= half:
            raise SealegsError(
                f"reach is {own:g} {unit}; joint {joint.name} has {half:.2f} {unit} to either side: leave reach out "
                "for one that fits each joint."
            )
        shapes = {name.replace(" ", "_"): shape for name, shape in library(0.0, own, seed + k).items()}
        if word not in shapes:
            hint = nearest(word, shapes)
            raise SealegsError(
                f"there is no excitation '{word}'{hint}; give a .csv file or one of {', '.join(shapes)}."
            )
        columns.append(0.5 * (joint.low + joint.high) + shapes[word])
    said = reach if reach is not None else {name: round(own, 6) for name, own in reaches.items()}
    goals = np.stack(columns, axis=1)
    return Trajectory(word, np.arange(len(goals)) / SAMPLES, goals, {"excitation": word, "reach": said, "seed": seed})
