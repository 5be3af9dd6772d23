"""A log before anything is fitted: what its sidecar says, units, faults that are mended, and what makes it unusable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...actuators.stages.controller import Ideal
from ...envs.robots import robot_meant
from ..checks.data_set import check_set, corrected, merged, unusable
from ..checks.drive import released
from ..checks.motion import MAX_STOPPED_ANGLE, steps_of_a_turn
from ..checks.signal import quantisation_step, same_unit
from ..load.robot import Machine
from ..load.units import POSITIONS, in_model_units
from ..log.finding import Finding
from ..log.progress import Progress
from ..log.types import BESIDE_GOAL, TURN_IN_UNITS, Array, JointLog, LogError, MeasuredRun, MeasuredSet
from .columns import check_robot, commanded
from .pieces import chain_of

TAKEN, UNUSED = "command.beside", "command.unused"
"""Codes of the findings on what an impedance drive is told beside its goal."""
OTHER_UNITS = ("unit.degrees", "unit.ticks", "unit.millimetres", "unit.length")
"""Findings that a position or goal is in another unit than the model's."""


def check_log(data: MeasuredSet, progress: Progress) -> tuple[MeasuredSet, list[Finding], Finding | None]:
    """The data with their faults mended, what was found about them, and the finding that makes them unusable."""
    robot = data.runs[0].robot
    if hint := robot_meant(robot):
        raise LogError(f"{data.runs[0].name}: there is no robot '{robot}'{hint}; correct it in the sidecar.")
    logged = Machine.of(data.runs).robot
    of_joints: list[Finding] = []
    if logged is not None:
        _alike(data)
        of_joints = check_robot(data.runs, logged)  # before units of a joint that there is not
    recorded = data
    data, said = in_model_units(data, logged)
    converted = {run.name: _converted(run, now) for run, now in zip(recorded.runs, data.runs, strict=True)}
    for run, now in zip(recorded.runs, data.runs, strict=True):
        _check_steps(run, converted[run.name])
        _check_ways(run, now, converted[run.name])
    said += of_joints
    progress("checking the log")
    marked, off = released(data)  # a sign is told where the drive is on
    mended, every = corrected(marked, [*data.findings, *said, *check_set(marked)])
    _check_said(every, converted)
    if mended is not marked:  # once more: a goal in another unit or direction looks away
        mended, off = released(_unmarked(mended, data))
    every += off + [note for note in said if note not in every]  # mending asks the columns anew
    runs, of_drives = with_whole_goals(Machine.of(mended.runs))
    told = {finding.joint for finding in of_drives if finding.code == TAKEN}
    every = [f for f in every if not (f.code == "goal.still" and f.joint in told)]  # it is not all that was told
    mended, every = _without_bad_goals(replace(mended, runs=runs), every)
    return mended, merged([*every, *of_drives]), unusable(every, mended)


def _without_bad_goals(data: MeasuredSet, findings: list[Finding]) -> tuple[MeasuredSet, list[Finding]]:
    """The data without goals that cannot be used, where other joints have some: those joints tell how they moved."""
    bad = {
        finding.joint: finding
        for finding in findings
        if finding.joint and (finding.column or "").endswith(".goal") and unusable([finding], data) is finding
    }
    if not bad or not set(commanded(data.runs)) - set(bad):
        return data, findings
    runs = []
    for run in data.runs:
        joints = {name: replace(log, goal=None) if name in bad else log for name, log in run.joints.items()}
        runs.append(replace(run, joints=joints))
    said = " This joint is not judged; where it was counts for the others."
    told = [
        replace(f, severity="warning", sentence=f"{f.sentence}{said}") if bad.get(f.joint or "") is f else f
        for f in findings
    ]
    others = [f for f in told if f.severity != "error" or not ((f.column or "").endswith(".goal") and f.joint in bad)]
    return replace(data, runs=tuple(runs)), others


def _unmarked(data: MeasuredSet, recorded: MeasuredSet) -> MeasuredSet:
    """The data with ``enabled`` columns only where they were recorded, run by run."""
    runs = []
    for run, before in zip(data.runs, recorded.runs, strict=True):
        joints = {
            name: replace(log, enabled=None) if before.joints[name].enabled is None else log
            for name, log in run.joints.items()
        }
        runs.append(replace(run, joints=joints))
    return replace(data, runs=tuple(runs))


def _alike(data: MeasuredSet) -> None:
    """Refuse runs of a robot's file whose sidecars differ in what the robot is: one model is made of it."""
    first = data.runs[0]
    for run in data.runs[1:]:
        for key, mine, its in (
            ("robot_params", dict(run.robot_params), dict(first.robot_params)),
            ("meta.frames", run.meta.get("frames"), first.meta.get("frames")),
        ):
            if mine != its:
                raise LogError(f"{run.name}: its sidecar has other {key} than {first.name}; diagnose such runs apart.")


def _converted(run: MeasuredRun, now: MeasuredRun) -> dict[str, str]:
    """Positions and goals of a run that ``units`` of its sidecar had converted: the word for each column."""
    units = run.meta.get("units") or {}
    return {
        f"{joint}.{signal}": str(units.get(f"{joint}.{signal}", units.get(signal)))
        for joint, log in run.joints.items()
        for signal, values in log.signals().items()
        if signal in POSITIONS and getattr(now.joints[joint], signal) is not values
    }


def _check_steps(run: MeasuredRun, converted: dict[str, str]) -> None:
    """Refuse a column whose encoder makes its steps in another unit than ``units`` says."""
    for column, word in converted.items():
        joint, _, signal = column.rpartition(".")
        step = quantisation_step(run.joints[joint].signals()[signal]) if word in TURN_IN_UNITS else 0.0
        steps = steps_of_a_turn(step)
        if steps and word not in steps:
            unit, count = next(iter(steps.items()))
            raise LogError(
                f"{run.name}: units says that {column} is in {word}, and it is in {unit}: its step of {step:.4g} is "
                f"a whole turn of {TURN_IN_UNITS[unit]:.4g} divided by {count}; correct the entry."
            )


def _check_ways(run: MeasuredRun, now: MeasuredRun, converted: dict[str, str]) -> None:
    """Refuse a unit of goal or position alone that parts them, where they move alike as they were recorded.

    Where the other one is too large for the unit of the model, it is that one which is mended.
    """
    for joint, log in run.joints.items():
        names = {"position": f"{joint}.position", "goal": f"{joint}.goal"}
        one = [signal for signal, column in names.items() if column in converted]
        if log.goal is None or len(one) != 1:
            continue
        other = "goal" if one == ["position"] else "position"
        mine = now.joints[joint]
        assert mine.goal is not None
        small = float(np.quantile(np.abs(log.signals()[other]), 0.98)) < 0.5 * MAX_STOPPED_ANGLE
        if small and _move_alike(log.position, log.goal) and not _move_alike(mine.position, mine.goal):
            raise LogError(
                f"{run.name}: units says that {names[one[0]]} is in {converted[names[one[0]]]}, and as they were "
                f"recorded it and {names[other]} move alike; correct the entry, or add one for {names[other]}."
            )


def _move_alike(one: Array, other: Array) -> bool:
    """Whether two columns go about equally far."""
    return same_unit(float(np.ptp(one)) / max(float(np.ptp(other)), 1e-12))


def _check_said(findings: list[Finding], converted: dict[str, dict[str, str]]) -> None:
    """Refuse a column that is in yet another unit than ``units`` says: mending it for the model's would be false."""
    words = {column: word for columns in converted.values() for column, word in columns.items()}
    for finding in findings:
        column = finding.column or ""
        if finding.code in OTHER_UNITS and column in (converted.get(finding.run, words) if finding.run else words):
            raise LogError(
                f"{finding.run or 'the log'}: units says that {column} is in {words[column]}, and with that "
                f"{finding.sentence.rpartition(';')[0]}; correct the entry, or the column."
            )


# --- commands of an impedance drive (MIT mode): goal, its velocity and torque as the one goal that asks for the same


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
