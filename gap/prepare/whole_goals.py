"""Commands of an impedance drive (MIT mode): goal, goal velocity and torque as the one goal that asks for the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...actuators.stages.controller import Ideal
from ..load.robot import Machine
from ..log.finding import Finding
from ..log.types import BESIDE_GOAL, JointLog, MeasuredRun
from .pieces import chain_of

TAKEN, UNUSED = "command.beside", "command.unused"


def with_whole_goals(machine: Machine) -> tuple[tuple[MeasuredRun, ...], list[Finding]]:
    """The runs with goals that hold all that their drives were told, and what is to be said of them.

    ``stiffness (goal - position) + damping (goal velocity - speed) + torque`` is what the same drive gives for the goal
    ``goal + (damping goal velocity + torque) / stiffness`` alone: what replays a goal replays an impedance drive.

    Args:
        machine: in the units of its model. A run whose joint has no chain is left to what asks for it.

    Raises:
        SealegsError: a chain cannot be read.
    """
    robot, notes, whole = machine.robot, {}, []
    for run in machine:
        joints = dict(run.joints)
        for name, log in run.joints.items():
            beside = [signal for signal in BESIDE_GOAL if getattr(log, signal) is not None]
            if not beside or (robot is None and name not in run.actuators):
                continue
            chain = chain_of(run, name, robot)
            if chain.command == "goal_velocity":
                continue
            if log.goal is None or chain.command == "torque_command":
                beside = [signal for signal in beside if signal == "goal_velocity"]
            elif (drive := chain.impedance_drive()) is not None:
                joints[name] = _whole(log, drive)
                notes[name] = _taken(name, beside, drive)
                continue
            if beside:
                notes[name] = _unused(name, beside)
        whole.append(replace(run, joints=joints))
    return tuple(whole), list(notes.values())


def _whole(log: JointLog, drive: Ideal) -> JointLog:
    goal = log.goal
    assert goal is not None
    if log.goal_velocity is not None:
        goal = goal + drive.feedforward * drive.damping / drive.stiffness * log.goal_velocity
    if log.torque_command is not None:
        goal = goal + drive.feedforward / drive.stiffness * log.torque_command
    return replace(log, goal=goal, goal_alone=log.goal, goal_velocity=None, torque_command=None)


def _taken(joint: str, beside: Sequence[str], drive: Ideal) -> Finding:
    columns = " and ".join(f"{joint}.{signal}" for signal in beside)
    return Finding(
        TAKEN, "note", joint, f"{joint}.{beside[0]}",
        f"{columns}: taken with {joint}.goal as one goal, by the stiffness of {drive.stiffness:g} and the damping of "
        f"{drive.damping:g} that the chain of '{joint}' has. Goals in what follows are these.",
    )  # fmt: skip


def _unused(joint: str, beside: Sequence[str]) -> Finding:
    columns = " and ".join(f"{joint}.{signal}" for signal in beside)
    sentence = (
        f"{columns} {'are' if len(beside) > 1 else 'is'} not used: the chain of joint '{joint}' does not take "
        f"{'them' if len(beside) > 1 else 'it'}. Of an impedance drive (MIT mode), name its chain with feedforward: 1 "
        "under 'ideal'."
    )
    if "torque_command" in beside:
        sentence += " Of a loop outside the drive, log the whole torque, and take a chain with torque_command."
    severity = "warning" if "torque_command" in beside else "note"  # of a velocity the goal mostly tells, too
    return Finding(UNUSED, severity, joint, f"{joint}.{beside[0]}", sentence)
