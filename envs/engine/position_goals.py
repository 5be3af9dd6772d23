"""Tasks and servos give position goals, and speeds to wheels: a chain of another command is refused there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ...actuators import Chain
from .robot import Robot, RobotError


def check_position_goals(robot: Robot, chains: Mapping[str, Chain], there: str, speeds: bool = True) -> None:
    """Make sure that every chain of a robot takes position goals [rad or m], or speeds where these go as well.

    A ``torque_command`` passes its command on as N.m or N, so that a goal of 0.5 rad would act as 0.5 N.m, and a torque
    would be sent to a servo as an angle. Robots with such chains can be read and diagnosed all the same.

    Args:
        robot: that the chains drive.
        chains: by coordinate.
        there: what goes between host and chain, such as ``a task gives``.
        speeds: whether a chain may be told a speed.

    Raises:
        RobotError: a chain takes torques, speeds that are not given, or other goals than the one in the robot's file.
    """
    turning = [name for name, chain in chains.items() if chain.command == "goal_velocity"]
    if turning and not speeds:
        raise RobotError(
            f"robot '{robot.name}': {', '.join(turning)} {'are' if len(turning) > 1 else 'is'} told speeds, and "
            f"{there} position goals; robots on wheels drive with env=drive, or a task of your own that takes_speeds."
        )
    driven = [name for name, chain in chains.items() if chain.command == "torque_command"]
    if not driven:
        _check_wheels(robot, chains)
        return
    force = "force [N]" if robot.unit(driven[0]) == "m" else "torque [N.m]"
    which = f"the chains of joints {', '.join(driven)} take"
    if len(driven) == 1:
        which = f"the chain of joint '{driven[0]}' takes"
    raise RobotError(
        f"robot '{robot.name}': {which} a {force} as command (torque_command), and {there} position goals; name a "
        "chain with a position controller, such as ideal or a servo of the library, in the robot's file or as "
        "actuator=: what torques drive can be diagnosed, but not trained or deployed here."
    )


def _check_wheels(robot: Robot, chains: Mapping[str, Chain]) -> None:
    """Refuse speeds where the ranges of the robot's file are of positions, and the other way round."""
    for joint in () if robot.file is None else robot.file.joints:
        told = chains[joint.name].command == "goal_velocity"
        if told != joint.by_speed:
            here, there = ("speeds", "positions") if told else ("positions", "speeds")
            raise RobotError(
                f"robot '{robot.name}': the chain of joint {joint.name} is told {here}, and the one in the robot's "
                f"file {there}: change it there."
            )


def torque_driven(chains: Mapping[str, Sequence[Mapping[str, Any]]]) -> list[str]:
    """Coordinates whose command is a torque, from the stages of their chains."""
    return [name for name, stages in chains.items() if any("torque_command" in stage for stage in stages)]
