"""Columns that a sidecar says are in another unit, in the model's: ``units: {gripper.position: percent}``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from ...envs.robots import ROBOTS
from ..log.finding import Finding
from ..log.types import JointLog, LogError, MeasuredRun, MeasuredSet, factors
from .robot import LoggedRobot

HINGE_UNITS: Mapping[str, float] = MappingProxyType(factors("rad", "deg", "turn", "rad/s", "deg/s", "turn/s", "rpm"))
SLIDE_UNITS: Mapping[str, float] = MappingProxyType(factors("m", "cm", "mm", "m/s", "mm/s"))
RANGE_UNITS: Mapping[str, float] = MappingProxyType({"fraction": 1.0, "percent": 100.0})
"""Of the joint's range in the model, from its lower end, with what the whole range is."""
POSITIONS, SPEEDS = ("position", "goal", "link_position"), ("velocity", "goal_velocity")


def in_model_units(data: MeasuredSet, robot: LoggedRobot | None) -> tuple[MeasuredSet, list[Finding]]:
    """The runs with their positions and velocities in the units of the model, and what is to be said of them.

    Args:
        data: runs of one machine.
        robot: from its file; None of a bench or another robot without one, whose joint slides where ``units`` gives it
            a length, and turns elsewhere.

    Raises:
        LogError: a unit is not known for the joint, or is a share of a range that the model does not have.
    """
    notes: dict[str, Finding] = {}
    runs = [run_in_model_units(run, robot, notes) for run in data.runs]
    return replace(data, runs=tuple(runs)), list(notes.values())


def run_in_model_units(
    run: MeasuredRun, robot: LoggedRobot | None, notes: dict[str, Finding] | None = None
) -> MeasuredRun:
    """One run as :func:`in_model_units` has it; what is to be said goes into ``notes``, once for each column.

    Raises:
        LogError: as :func:`in_model_units`.
    """
    said = run.meta.get("units") or {}
    joints, now = dict(run.joints), dict(said)
    for name, log in run.joints.items() if said else ():
        own = _own_unit(name, log, said, robot)
        if robot is None and own == "m":  # nothing else says later that it slides
            now[f"{name}.position"] = own
        for signals, unit in ((POSITIONS, own), (SPEEDS, f"{own}/s")):
            for signal in (signal for signal in signals if signal in log.signals()):
                column = f"{name}.{signal}"
                here = str(said.get(column, said.get(signal, unit)))
                if here == unit:
                    continue
                scale = _scale(column, here, unit, run, robot)
                if scale is not None:
                    factor, zero = scale
                    joints[name] = replace(joints[name], **{signal: factor * getattr(log, signal) + zero})
                    now[column] = unit
                if here in RANGE_UNITS and notes is not None:
                    notes[column] = _share_note(column, here, scale, own)
    return replace(run, joints=joints, meta={**run.meta, "units": now}) if now != said else run


def _own_unit(joint: str, log: JointLog, said: Mapping[str, object], robot: LoggedRobot | None) -> str:
    """Unit of a joint's position: as its model has it, or as what is said of any of its columns has it."""
    if robot is not None:
        return "m" if robot.slides(joint) else "rad"
    signals = [signal for signal in (*POSITIONS, *SPEEDS) if signal in log.signals()]
    words = {str(said.get(f"{joint}.{signal}", said.get(signal))) for signal in signals}
    return "rad" if words.isdisjoint(SLIDE_UNITS) else "m"


def _scale(
    column: str, here: str, unit: str, run: MeasuredRun, robot: LoggedRobot | None
) -> tuple[float, float] | None:
    """Factor and zero that make a column's values those of the model; None of a share whose range nobody can say."""
    known = HINGE_UNITS if unit.startswith("rad") else SLIDE_UNITS
    if here in _names(known, unit):
        return known[here], 0.0
    if here in RANGE_UNITS and not unit.endswith("/s"):
        if robot is None and run.robot not in ROBOTS:  # of such a machine no range is known, and none is needed
            return None
        ends = None if robot is None else robot.ends(column.rpartition(".")[0])
        if ends is None:
            lacks, way = "the model gives it no range", f"add one to the model, or convert the column to {unit}"
            if robot is None:
                lacks, way = f"of a {run.robot} no range is known", f"convert the column to {unit}"
            raise LogError(
                f"{run.name}: units says that {column} is a {here} of the joint's range, and {lacks}; {way} and "
                "correct the entry."
            )
        return (ends[1] - ends[0]) / RANGE_UNITS[here], ends[0]
    is_in = "this joint is" if robot is None else "the model has that joint"
    every = {**HINGE_UNITS, **SLIDE_UNITS}
    names = _names(known if robot is not None or here in every else every, unit)
    raise LogError(
        f"{run.name}: units says that {column} is in {here}, and {is_in} in {unit}; convert the column to {unit}, and "
        f"correct the entry ({', '.join(names)} are converted)."
    )


def _names(known: Mapping[str, float], unit: str) -> list[str]:
    """Those that measure what ``unit`` does."""
    speeds = unit.endswith("/s")
    return [name for name in known if (name.endswith("/s") or name == "rpm") == speeds]


def _share_note(column: str, here: str, scale: tuple[float, float] | None, unit: str) -> Finding:
    joint = column.rpartition(".")[0]
    if scale is None:
        return Finding(
            "unit.share", "note", joint, column,
            f"{column} is a {here} of a range that nobody says: it is taken as it stands, so what is found of this "
            f"joint is in shares, not in {unit}; name the robot's file in the sidecar to have it converted.",
        )  # fmt: skip
    factor, zero = scale
    end = zero + factor * RANGE_UNITS[here]
    return Finding(
        "unit.share", "note", joint, column,
        f"{column} is a {here}: taken as that share of the joint's range in the model, {zero:.3g} to {end:.3g} {unit}, "
        "from its lower end (assumed; what the drive calls its range may differ).",
    )  # fmt: skip
