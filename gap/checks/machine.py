"""Faults of a column are properties of the machine: decided once, over all its runs, and mended in all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..log.finding import Finding
from ..log.types import MeasuredSet
from .context import JointContext, joint_contexts
from .motion import DEGREES_PER_RADIAN, MAX_STOPPED_ANGLE, nearer

DECIDED_ONCE = (
    "position.sign",
    "link_position.sign",
    "velocity.sign",
    "duty.sign",
    "current.sign",
    "unit.velocity",
    "velocity.gear_side",
    "unit.duty",
    "unit.current",
    "unit.voltage",
    "unit.temperature",
    "column.held",
    "column.behind",
    "goal.interpolated",
    "columns.before_goal",
    "position.late",
)
"""Findings of single runs that hold for all of a machine, or for none of it."""
ANGLE_SIGNALS = ("position", "goal", "link_position")
TWO_UNITS_NOISE_RATIO = 15.0
"""Ratio of the noises of two runs from which their column has two units; degrees and radians make 57."""
ONE_UNIT_NOISE_RATIO = 4.0  # and up to which it has one
OTHER_RUNS_REACH = 2.0  # times as far as the other runs go, in radians: more is no motion of the same joint


def decided(findings: Sequence[Finding], data: MeasuredSet) -> list[Finding]:
    """Findings of runs with those of :data:`DECIDED_ONCE` decided for the machine, by the samples for either side.

    A sample speaks where the joint moves and its drive is on; what the majority of them says holds for all runs.
    """
    contexts = [{joint.name: joint for joint in joint_contexts(run)} for run in data.runs]
    weights = [{name: _speaking(joint) for name, joint in joints.items()} for joints in contexts]
    total = {
        name: sum(weight.get(name, 0) for weight in weights)
        for name in dict.fromkeys(name for weight in weights for name in weight)
    }
    names = [run.name for run in data.runs]
    kept = [f for f in findings if f.code not in DECIDED_ONCE]
    for fault in dict.fromkeys(f.fault for f in findings if f.code in DECIDED_ONCE):
        same = [f for f in findings if f.fault == fault]
        if any(f.run is None or f.run not in names for f in same):  # decided before, or of a file these are windows of
            kept += same
            continue
        column = (same[0].column or "").rpartition(".")[2]
        able = sum(
            weight.get(fault[1] or "", 0)
            for weight, run in zip(weights, data.runs, strict=True)
            if (log := run.joints.get(fault[1] or "")) is not None and getattr(log, column, None) is not None
        )
        speaks = sum(weights[names.index(f.run)].get(fault[1] or "", 0) for f in same if f.run)
        if 2 * speaks <= min(able, total.get(fault[1] or "", 0)):
            continue
        middle = sorted(same, key=lambda f: f.value if f.value is not None else 0.0)[len(same) // 2]
        seen = f" (seen in {len(same)} of {len(names)} runs; it holds for all)" if len(same) < len(names) else ""
        kept.append(replace(middle, run=None, sentence=f"{middle.sentence}{seen}"))
    return [*kept, *_odd_units(contexts, kept)]


def _speaking(joint: JointContext) -> int:
    """Samples in which the joint moves with its drive on."""
    return 0 if joint.still else int((joint.moving & joint.on).sum())


def _odd_units(contexts: Sequence[dict[str, JointContext]], findings: Sequence[Finding]) -> list[Finding]:
    """Runs whose angles are in degrees while those of the others are in radians, or the other way round.

    One encoder has one noise: a run in which it is 57 times as large is in the other unit, whatever its motion.
    """
    found: list[Finding] = []
    for name in dict.fromkeys(name for joints in contexts for name in joints):
        same = [joints[name] for joints in contexts if name in joints and not joints[name].still]
        for signal in ANGLE_SIGNALS:
            column = same[0].column(signal) if same else ""
            flagged = {f.run for f in findings if f.code == "unit.degrees" and f.column == column}
            if None in flagged:
                continue
            there = [joint for joint in same if getattr(joint.log, signal) is not None and joint.radians]
            odd = [
                joint for joint in there if joint.run.name not in flagged and _degrees(joint, there, flagged, signal)
            ]
            found += [
                Finding(
                    "unit.degrees", "error", name, column,
                    f"{column} is in degrees in {joint.run.name} and in radians in other runs: its noise is "
                    f"{DEGREES_PER_RADIAN:.3g} times theirs or so; multiply it by pi/180.",
                    value=DEGREES_PER_RADIAN, data_error=True, run=joint.run.name,
                )
                for joint in odd
            ]  # fmt: skip
    return found


def _degrees(joint: JointContext, every: Sequence[JointContext], flagged: set[str | None], signal: str) -> bool:
    """Whether a run's angle is in degrees, by runs known to be, else by those whose noise is far less."""
    noise = _noise(joint)
    in_degrees = [_noise(other) for other in every if other.run.name in flagged]
    goal = joint.log.goal
    if signal == "position" and goal is not None and np.isfinite(goal).all() and np.ptp(goal) > 0.0:
        alike = 0.3 < np.ptp(joint.log.position) / np.ptp(goal) < 3.0  # then the goal is in degrees as well
        if not alike and not nearer(joint.log.position, goal):
            return False
    if in_degrees and noise > 0.0:
        return 1.0 / ONE_UNIT_NOISE_RATIO < noise / float(np.median(in_degrees)) < ONE_UNIT_NOISE_RATIO
    others = [other for other in every if other is not joint and other.run.name not in flagged]
    reach = float(np.abs(getattr(joint.log, signal)).max())
    theirs = [float(np.abs(getattr(other.log, signal)).max()) for other in others]
    if not others or reach / DEGREES_PER_RADIAN > OTHER_RUNS_REACH * max(theirs) or reach < MAX_STOPPED_ANGLE:
        return False
    usual = float(np.median([_noise(other) for other in others]))
    if usual <= 0.0 or noise <= 0.0:
        return reach > TWO_UNITS_NOISE_RATIO * max(theirs)
    return noise > TWO_UNITS_NOISE_RATIO * usual and reach > OTHER_RUNS_REACH * max(theirs)


def _noise(joint: JointContext) -> float:
    return joint.step if joint.step > 0.0 else joint.noise
