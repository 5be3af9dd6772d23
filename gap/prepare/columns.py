"""Which columns of a robot's log stand for what: joints that are judged, and joints that only tell how they moved."""

from __future__ import annotations

from collections.abc import Sequence

from ...common.errors import nearest
from ..ground.ground import GROUND
from ..load.robot import LoggedRobot
from ..log.finding import Finding
from ..log.types import COMMANDS, OF_CHAINS, LogError, MeasuredRun

MIN_ROBOT_SAMPLES = 30  # samples of a run of a robot: of fewer no derivative and no piece to judge on is left


def check_robot(runs: Sequence[MeasuredRun], robot: LoggedRobot) -> list[Finding]:
    """What is to be said of the joints of a robot's log.

    Raises:
        SealegsError: a run does not fit the robot, or is too short.
    """
    for run in runs:
        if len(run.time) < MIN_ROBOT_SAMPLES:
            raise LogError(
                f"{run.name} has {len(run.time)} samples, and a diagnosis of a robot needs {MIN_ROBOT_SAMPLES} at "
                "least; record some 20 s, or leave the run out."
            )
        joints_known(run, robot, commanded([run]))
    note = uncommanded(runs, robot)
    return [] if note is None else [note]


def commanded(runs: Sequence[MeasuredRun]) -> list[str]:
    """Joints of which a run says how they were driven: these are judged. Others of a robot only tell how they moved.

    A column may have been set aside in some runs.
    """
    keys = COMMANDS if runs[0].robot == "bench" else OF_CHAINS
    return [
        joint
        for joint in runs[0].joints
        if any(key in run.joints[joint].signals() for run in runs if joint in run.joints for key in keys)
    ]


def chosen(joints: Sequence[str], only: Sequence[str] | None, beside: Sequence[str] = ()) -> list[str]:
    """Those of some joints that a person asked for, None for all; what is ``beside`` them may be asked for, too.

    Raises:
        LogError: the log has no such joint, or none that could be judged.
    """
    if not joints:
        raise LogError(
            "No command of a joint was logged, and a measured torque stands in for one on a bench only; log what each "
            "joint was told as <joint>.goal, <joint>.goal_velocity (a wheel) or <joint>.torque_command."
        )
    for name in only or ():
        if name == GROUND and name not in joints:
            raise LogError(
                "joints= takes no 'ground': it is judged beside all joints, whose motion it needs; leave joints= out."
            )
        if name not in joints and name not in beside:
            hint = nearest(name, joints)
            raise LogError(f"The log drives no joint '{name}'{hint}; joints= takes {', '.join(joints)}.")
    return [joint for joint in joints if only is None or joint in only]


def uncommanded(runs: Sequence[MeasuredRun], robot: LoggedRobot) -> Finding | None:
    """That joints are not judged, since only their position was logged.

    Raises:
        LogError: the robot's model has no such joint.
    """
    named = commanded(runs)
    others = [joint for joint in runs[0].joints if joint not in named]
    if not others:
        return None
    known = {robot.column(number) for number in range(robot.model.njnt)}
    for joint in others:
        if robot.number(joint) < 0 and joint not in {item.name for item in robot.file.joints}:
            raise LogError(
                f"{runs[0].name}: {robot.file.model.path.name} has no joint '{joint}'{nearest(joint, known)}; rename "
                f"the column '{joint}.position' or leave it out."
            )
    measured = any(runs[0].joints[joint].torque is not None for joint in others)
    said = f"No command of {', '.join(others)} was logged{' (a measured torque is none)' if measured else ''}"
    if not named:
        raise LogError(
            f"{runs[0].name}: {said[0].lower()}{said[1:]}, so no joint can be judged; log what each joint was told as "
            f"{others[0]}.goal [rad, slides m] or {others[0]}.torque_command [N.m, slides N]."
        )
    return Finding(
        "robot.uncommanded", "note", None, None,
        f"{said}: how they move counts for the other joints, and nothing is judged at them.",
    )  # fmt: skip


def joints_known(run: MeasuredRun, robot: LoggedRobot, joints: Sequence[str]) -> None:
    """Refuse commands of joints that nothing drives.

    Raises:
        SealegsError: there is one; the message names the nearest joint that is driven.
    """
    for joint in joints:
        driven = any(item.name == joint for item in robot.file.joints)
        if not driven and robot.number(joint) >= 0 and joint not in run.actuators:
            raise LogError(
                f"{run.name}: {robot.file.path.name} drives no '{joint}', it is a passive joint; log its position, and "
                f"leave out '{joint}.goal' and the other columns of a drive."
            )
        robot.joint(joint)  # says that there is none
