"""Columns that a sidecar says are in another unit, in the model's: ``units: {gripper.position: percent}``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from ..log.finding import Finding
from ..log.types import LogError, MeasuredRun, MeasuredSet
from ..log.units import factors
from .robot import LoggedRobot

HINGE: Mapping[str, float] = MappingProxyType(factors("rad", "deg", "turn", "rad/s", "deg/s", "rpm"))
SLIDE: Mapping[str, float] = MappingProxyType(factors("m", "cm", "mm", "m/s", "mm/s"))
SHARES: Mapping[str, float] = MappingProxyType({"fraction": 1.0, "percent": 100.0})
"""Of the joint's range in the model, from its lower end, with what the whole range is."""
POSITIONS, SPEEDS = ("position", "goal", "link_position"), ("velocity",)


def in_model_units(data: MeasuredSet, robot: LoggedRobot) -> tuple[MeasuredSet, list[Finding]]:
    """The runs with their positions and velocities in the units of the model, and what is to be said of them.

    Raises:
        LogError: a unit is not known for the joint, or is a share of a range that the model does not have.
    """
    notes: dict[str, Finding] = {}
    runs = [_converted(run, robot, notes) for run in data.runs]
    return replace(data, runs=tuple(runs)), list(notes.values())


def _converted(run: MeasuredRun, robot: LoggedRobot, notes: dict[str, Finding]) -> MeasuredRun:
    said = run.meta.get("units") or {}
    joints, now = dict(run.joints), dict(said)
    for name, log in run.joints.items():
        own = "m" if robot.slides(name) else "rad"
        for signals, unit in ((POSITIONS, own), (SPEEDS, f"{own}/s")):
            for signal in (signal for signal in signals if signal in log.signals()):
                column = f"{name}.{signal}"
                here = str(said.get(column, said.get(signal, unit)))
                if here == unit:
                    continue
                factor, zero = _scale(column, here, unit, name, run.name, robot)
                joints[name] = replace(joints[name], **{signal: factor * getattr(log, signal) + zero})
                now[column] = unit
                if here in SHARES:
                    notes[column] = _share_note(column, here, name, factor, zero, own)
    return replace(run, joints=joints, meta={**run.meta, "units": now}) if now != said else run


def _scale(column: str, here: str, unit: str, joint: str, run: str, robot: LoggedRobot) -> tuple[float, float]:
    """Factor and zero that make a column's values those of the model."""
    known = SLIDE if robot.slides(joint) else HINGE
    if here in _names(known, unit):
        return known[here], 0.0
    if here in SHARES and not unit.endswith("/s"):
        ends = robot.ends(joint)
        if ends is None:
            raise LogError(
                f"{run}: units says that {column} is a {here} of the joint's range, and the model gives it no range; "
                f"add one to the model, or convert the column to {unit} and correct the entry."
            )
        return (ends[1] - ends[0]) / SHARES[here], ends[0]
    raise LogError(
        f"{run}: units says that {column} is in {here}, and the model has that joint in {unit}; convert the column to "
        f"{unit}, and correct the entry ({', '.join(_names(known, unit))} are converted)."
    )


def _names(known: Mapping[str, float], unit: str) -> list[str]:
    """Those that measure what ``unit`` does."""
    speeds = unit.endswith("/s")
    return [name for name in known if (name.endswith("/s") or name == "rpm") == speeds]


def _share_note(column: str, here: str, joint: str, factor: float, zero: float, unit: str) -> Finding:
    end = zero + factor * SHARES[here]
    return Finding(
        "unit.share", "note", joint, column,
        f"{column} is a {here}: taken as that share of the joint's range in the model, {zero:.3g} to {end:.3g} {unit}, "
        "from its lower end (assumed; what the drive calls its range may differ).",
    )  # fmt: skip
