"""Faults of columns are properties of the machine: decided once, over all its runs, and mended in all of them.

A column in a known unit is converted, a false one is set aside.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..log.finding import Finding
from ..log.types import Array, JointLog, MeasuredRun, MeasuredSet
from .clock import regular
from .context import JointContext, joint_contexts
from .motion import DEGREES_PER_RADIAN, FULL_TURN, MAX_STOPPED_ANGLE, nearer, on_turn_of, unwrapped
from .recording import held_again, unheld
from .signal import ANOTHER_UNIT_RATIO, same_unit

ANGLE_SIGNALS = ("position", "goal", "link_position")
Mend = Callable[[MeasuredRun, Finding], MeasuredRun]


@dataclass(frozen=True)
class Fault:
    """What is done about a kind of finding.

    Attributes:
        mend: a run and a finding to the run as it should have been recorded; None: it is only told.
        of_machine: whether a finding of one run holds for all of its machine, or for none of it.
        done: in words.
    """

    mend: Mend | None = None
    of_machine: bool = False
    done: str = "converted"


def _column(change: Callable[[JointLog, str, float], JointLog]) -> Mend:
    """A mend of the column that a finding names, by its value."""

    def mend(run: MeasuredRun, finding: Finding) -> MeasuredRun:
        log, signal = run.joints.get(finding.joint or ""), (finding.column or "").rpartition(".")[2]
        if log is None or not finding.joint or getattr(log, signal, None) is None:
            return run
        changed = change(log, signal, 1.0 if finding.value is None else float(finding.value))
        return replace(run, joints={**run.joints, finding.joint: changed})

    return mend


def _of_values(change: Callable[[Array, float], Array | None]) -> Mend:
    return _column(lambda log, signal, size: replace(log, **{signal: change(getattr(log, signal), size)}))


def _on_right_turn(log: JointLog, signal: str, jump: float) -> JointLog:
    """An angle without its jumps, on the turn of another one that goes with it: the goal, or the motor's position."""
    if signal == "goal" and log.goal is not None:
        return replace(log, goal=on_turn_of(unwrapped(log.goal), unwrapped(log.position)))
    other = log.goal if signal == "position" else log.position
    period = FULL_TURN if abs(jump / FULL_TURN - 1.0) < 0.1 else jump
    angle = np.unwrap(getattr(log, signal), period=period)
    return replace(log, **{signal: angle if other is None else on_turn_of(angle, other, period)})


def _in_radians(log: JointLog, signal: str, size: float) -> JointLog:
    both = (signal, "goal_velocity") if signal == "goal" and log.goal_velocity is not None else (signal,)
    return replace(log, **{name: getattr(log, name) * np.pi / 180.0 for name in both})


def _read_less_often(log: JointLog, signal: str, rows: float) -> JointLog:
    angle = signal in ("position", "link_position")
    return replace(log, **{signal: unheld(getattr(log, signal), int(rows), angle=angle)})


def _on_regular_clock(run: MeasuredRun, finding: Finding) -> MeasuredRun:
    return run if (grid := regular(run.time)) is None else replace(run, time=grid)


TURNED = Fault(_of_values(lambda values, size: -values), of_machine=True)
SCALED = Fault(_of_values(lambda values, size: values / size), of_machine=True)
WRAPPED = Fault(_column(_on_right_turn))
SET_ASIDE = Fault(_of_values(lambda values, size: None), done="set aside")

FAULTS: dict[str, Fault] = {
    **dict.fromkeys(("goal.wrap", "position.wrap", "link_position.wrap"), WRAPPED),
    "unit.millimetres": replace(SCALED, of_machine=False),
    "unit.degrees": Fault(_column(_in_radians)),
    "position.sign": TURNED,
    "clock.late_stamps": Fault(_on_regular_clock),
    "column.held": Fault(_column(_read_less_often), of_machine=True),
    "column.behind": Fault(
        _of_values(lambda values, size: np.concatenate([values[int(size) :], np.repeat(values[-1:], int(size))])),
        of_machine=True,
    ),
    "goal.interpolated": Fault(_of_values(lambda values, size: held_again(values, int(size))), of_machine=True),
    **dict.fromkeys(("current.unsigned", "voltage.aliased", "column.stuck", "column.empty"), SET_ASIDE),
    **dict.fromkeys(("velocity.scale", "velocity.lag"), SET_ASIDE),
    **dict.fromkeys(("link_position.sign", "velocity.sign", "duty.sign", "current.sign"), TURNED),
    **dict.fromkeys(("unit.velocity", "velocity.gear_side", "unit.duty", "unit.current", "unit.voltage"), SCALED),
    "unit.temperature": Fault(_of_values(lambda values, size: values - size), of_machine=True),
    **dict.fromkeys(("columns.before_goal", "position.late"), Fault(of_machine=True)),
}
"""By the code of a finding, in the order in which they are mended: earlier ones make others appear."""


def mendable(finding: Finding) -> bool:
    """Whether a log can be diagnosed in spite of a finding, with its column converted or set aside."""
    return finding.code in FAULTS and FAULTS[finding.code].mend is not None


def mended(run: MeasuredRun, findings: Iterable[Finding]) -> MeasuredRun:
    """The run as its findings say that it should have been recorded; what was recorded stays in its file."""
    for finding in findings:
        fault = FAULTS.get(finding.code)
        if fault is not None and fault.mend is not None:
            run = fault.mend(run, finding)
    return run


def told(finding: Finding) -> Finding:
    """The finding, saying what was done about it."""
    severity = "warning" if finding.severity == "error" else finding.severity
    done = FAULTS[finding.code].done
    return replace(finding, severity=severity, sentence=f"{finding.sentence} For this diagnosis it was {done}.")


def decided(findings: Sequence[Finding], data: MeasuredSet) -> list[Finding]:
    """Findings of runs with those of faults of a machine decided for all of it, by the samples for either side.

    A sample speaks where the joint moves and its drive is on; what the majority of them says holds for all runs.
    """
    contexts = [{joint.name: joint for joint in joint_contexts(run)} for run in data.runs]
    weights = [{name: _speaking(joint) for name, joint in joints.items()} for joints in contexts]
    names = [run.name for run in data.runs]
    of_machine = [f for f in findings if f.code in FAULTS and FAULTS[f.code].of_machine]
    kept = [f for f in findings if f not in of_machine]
    for fault in dict.fromkeys(f.fault for f in of_machine):
        same = [f for f in of_machine if f.fault == fault]
        if any(f.run not in names for f in same):  # decided before, or of a file these are windows of
            kept += same
            continue
        column, joint = (same[0].column or "").rpartition(".")[2], fault[1] or ""
        able = sum(
            weight.get(joint, 0)
            for weight, run in zip(weights, data.runs, strict=True)
            if joint in run.joints and getattr(run.joints[joint], column, None) is not None
        )
        speaks = sum(weights[names.index(f.run)].get(joint, 0) for f in same if f.run)
        if 2 * speaks <= able:
            continue
        middle = sorted(same, key=lambda f: f.value if f.value is not None else 0.0)[len(same) // 2]
        seen = f" (seen in {len(same)} of {len(names)} runs; it holds for all)" if len(same) < len(names) else ""
        kept.append(replace(middle, run=None, sentence=f"{middle.sentence}{seen}"))
    return [*kept, *_odd_units(contexts, kept)]


def _speaking(joint: JointContext) -> int:
    """Samples in which the joint moves with its drive on."""
    return 0 if joint.still else int((joint.moving & joint.on).sum())


def _odd_units(contexts: Sequence[dict[str, JointContext]], findings: Sequence[Finding]) -> list[Finding]:
    """Runs whose angles are in degrees while those of the others are in radians.

    One encoder has one noise: a run in which it is 57 times as large is in the other unit, whatever its motion.
    """
    found: list[Finding] = []
    for name in dict.fromkeys(name for joints in contexts for name in joints):
        same = [joints[name] for joints in contexts if name in joints and not joints[name].still]
        for signal in ANGLE_SIGNALS:
            column = same[0].column(signal) if same else ""
            flagged = {f.run for f in findings if f.code == "unit.degrees" and f.column == column}
            there = [joint for joint in same if getattr(joint.log, signal) is not None and joint.radians]
            others = [joint for joint in there if joint.run.name not in flagged]
            if None in flagged:
                continue
            found += [
                Finding(
                    "unit.degrees", "error", name, column,
                    f"{column} is in degrees in {joint.run.name} and in radians in other runs: its noise is "
                    f"{DEGREES_PER_RADIAN:.3g} times theirs or so; multiply it by pi/180.",
                    value=DEGREES_PER_RADIAN, data_error=True, run=joint.run.name,
                )
                for joint in others
                if _degrees(joint, [j for j in there if j.run.name in flagged], [j for j in others if j is not joint],
                            signal)
            ]  # fmt: skip
    return found


def _degrees(
    joint: JointContext, in_degrees: Sequence[JointContext], others: Sequence[JointContext], signal: str
) -> bool:
    """Whether a run's angle is in degrees, by the noise of runs known to be, else by that of all others."""
    goal = joint.log.goal
    if signal == "position" and goal is not None and np.isfinite(goal).all() and np.ptp(goal) > 0.0:
        alike = same_unit(np.ptp(joint.log.position) / np.ptp(goal))  # then the goal is in degrees as well
        if not alike and not nearer(joint.log.position, goal):
            return False
    if in_degrees:
        return same_unit(_noise(joint) / float(np.median([_noise(other) for other in in_degrees])))
    if not others or _reach(joint, signal) < MAX_STOPPED_ANGLE:
        return False
    usual, furthest = float(np.median([_noise(other) for other in others])), max(_reach(o, signal) for o in others)
    # further than the others go, and as degrees no further than the same joint may
    far = ANOTHER_UNIT_RATIO < _reach(joint, signal) / furthest < ANOTHER_UNIT_RATIO * DEGREES_PER_RADIAN
    return far and same_unit(_noise(joint) / usual / DEGREES_PER_RADIAN)


def _noise(joint: JointContext) -> float:
    return max(joint.step if joint.step > 0.0 else joint.noise, 1e-12)


def _reach(joint: JointContext, signal: str) -> float:
    return float(np.abs(getattr(joint.log, signal)).max())
