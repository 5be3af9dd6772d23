"""Motions of the library of excitations on all joints of a robot."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...common.errors import SealegsError, nearest
from ..machine.limits import SHARE, ByJoint, by_pattern, usual_reach
from ..machine.robot import ServoRobot
from .commands import Trajectory


def library_excitation(word: str, robot: ServoRobot, reach: ByJoint | None, seed: int) -> Trajectory:
    """An excitation of the library on every joint, each about the middle of its range.

    Args:
        word: its name.
        robot: that moves.
        reach: to either side [rad or m], a number or numbers by pattern of names; None, and joints that no pattern
            fits: :func:`usual_reach`.
        seed: of the excitation.

    Raises:
        SealegsError: there is none of that name, or ``reach`` is more than a joint has.
    """
    from ...gap.experiment import GOAL_RATE as SAMPLES
    from ...gap.experiment import library

    columns, reaches = [], _reaches(robot, reach)
    for k, joint in enumerate(robot.joints):
        # seed + k would give joint k what joint k - 1 has under the next seed
        found = library(0.0, reaches[joint.name], [seed, k])
        shapes = {name.replace(" ", "_"): shape for name, shape in found.items()}
        if word not in shapes:
            hint = nearest(word, shapes)
            raise SealegsError(
                f"there is no excitation '{word}'{hint}; give a .csv file or one of {', '.join(shapes)}."
            )
        columns.append(0.5 * (joint.low + joint.high) + shapes[word])
    plain = reach is not None and all(own == reach for own in reaches.values())
    said = reach if plain else {name: round(own, 6) for name, own in reaches.items()}
    goals = np.stack(columns, axis=1)
    return Trajectory(word, np.arange(len(goals)) / SAMPLES, goals, {"excitation": word, "reach": said, "seed": seed})


def _reaches(robot: ServoRobot, reach: ByJoint | None) -> dict[str, float]:
    """How far each joint goes to either side [rad or m]."""
    given: list[float | None] = [None] * len(robot.joints)
    if isinstance(reach, Mapping):
        given = by_pattern("reach", reach, robot)
    elif reach is not None:
        given = [reach] * len(robot.joints)
    found = {}
    for joint, unit, own in zip(robot.joints, robot.units, given, strict=True):
        half = 0.5 * (joint.high - joint.low)
        # a plain number is meant for hinges where no slide could go so far
        far = own is not None and own > half and unit == "m" and "rad" in robot.units
        if own is None or (far and not isinstance(reach, Mapping)):
            own = SHARE * half if joint.turning else usual_reach(half, unit)
        if not 0.0 < own <= half:
            raise SealegsError(
                f"reach is {own:g} {unit}; joint {joint.name} has {half:.2f} {unit} to either side: leave reach out "
                f"for one that fits each joint, or give numbers by pattern of names, such as "
                f"'reach={{\"{joint.name}\": {usual_reach(half, unit):.3g}}}'."
            )
        found[joint.name] = own
    return found
