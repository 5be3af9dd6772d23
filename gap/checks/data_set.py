"""Check measured logs before any physics is blamed: clock, units, contradicting columns, too little motion."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..load.units import POSITIONS
from ..log.finding import Finding
from ..log.types import Array, JointLog, LogError, MeasuredRun, MeasuredSet
from .columns import check_clock, check_columns, check_stamps, check_unsigned, regular
from .context import JointContext, joint_contexts
from .drive import check_drive
from .motion import DEGREES_PER_RADIAN, FULL_TURN, MAX_STOPPED_ANGLE, check_motion, nearer, on_turn_of, unwrapped
from .recording import check_goal, check_recording, held_again, unheld
from .signal import ANOTHER_UNIT_RATIO, same_unit, sample_noise
from .torque_balance import check_torque

__all__ = ["Finding", "check_run", "check_set", "corrected", "merged", "noise_floor", "shows_little", "unusable"]


def check_run(run: MeasuredRun) -> list[Finding]:
    """Return what is wrong with, or worth knowing about, one run; an empty list for a clean one."""
    return _of_runs([run])


def check_set(data: MeasuredSet) -> list[Finding]:
    """Return the findings of every run and those across runs; torques and magnitudes are judged over all of them."""
    return [*_of_runs(data.runs), *_across(data)]


def _of_runs(runs: Sequence[MeasuredRun]) -> list[Finding]:
    contexts = [joint_contexts(run) for run in runs]
    findings = [finding for run, joints in zip(runs, contexts, strict=True) for finding in _of_run(run, joints)]
    only = runs[0].name if len(runs) == 1 else None
    for name in dict.fromkeys(joint.name for joints in contexts for joint in joints):
        same = [joint for joints in contexts for joint in joints if joint.name == name]
        findings += [*check_torque(same, only), *check_unsigned(same, only)]
    return findings


UNKNOWN_UNIT = frozenset(("unit.ticks", "unit.length"))
"""Findings of a position of which the checks of other columns would say something wrong."""


def corrected(
    data: MeasuredSet, findings: list[Finding], done: frozenset[tuple[str | None, ...]] = frozenset()
) -> tuple[MeasuredSet, list[Finding]]:
    """Return the runs with their mendable columns converted or set aside, and what is to be said about both.

    A run is checked again after it was mended, since a column in degrees makes others look wrong. What mending did not
    cure (``done``) is told and left.
    """
    findings = decided(findings, data)
    faults = [finding for finding in findings if mendable(finding) and _where(finding) not in done]
    if not faults:
        return data, findings
    first = min((finding.code for finding in faults), key=list(FAULTS).index)
    aside = FAULTS[first] is SET_ASIDE  # which changes no other column
    now = [f for f in faults if f.code == first or (aside and FAULTS[f.code] is SET_ASIDE)]
    runs = tuple(mended(run, _once([f for f in now if _concerns(f, run)])) for run in data.runs)
    data = replace(data, runs=runs)
    rest = [finding for finding in data.findings if not mendable(finding)]
    data, others = corrected(data, [*rest, *check_set(data)], done | {_where(finding) for finding in now})
    return data, [*(told(finding) for finding in now), *others]


def _concerns(finding: Finding, run: MeasuredRun) -> bool:
    """Whether a finding holds for a run: it is of the run, of the file that the run is a window of, or of all."""
    return finding.run in (run.name, _file(run.name), None)


def _file(run: str) -> str:
    """Name of the file that a run is, or that it is a window of (``file[from:to]``)."""
    return run.partition("[")[0]


def _where(finding: Finding) -> tuple[str | None, ...]:
    return *finding.fault, finding.run


def _once(findings: list[Finding]) -> list[Finding]:
    """One finding of each kind and column: what was found in a whole log and again in a piece of it is mended once."""
    kept: dict[tuple[str, str | None, str | None], Finding] = {}
    for finding in findings:
        kept.setdefault(finding.fault, finding)
    return list(kept.values())


def shows_little(runs: Sequence[MeasuredRun], joint: str) -> bool:
    """Whether a joint hardly moves in any of the runs: what explains them best may then not be what it is."""
    contexts = (_context(run, joint) for run in runs)
    return all(context.still or context.short or context.seldom for context in contexts)


def noise_floor(run: MeasuredRun, joint: str) -> float:
    """Return the rms error of one logged position of a joint [rad]: quantisation and high-frequency noise together.

    Raises:
        LogError: the run has no such joint.
    """
    if joint not in run.joints:
        raise LogError(f"{run.name}: has no joint '{joint}', only {', '.join(run.joints)}")
    context = _context(run, joint)
    return sample_noise(context.time, context.log.position)


def _context(run: MeasuredRun, joint: str) -> JointContext:
    return next(context for context in joint_contexts(run) if context.name == joint)


def merged(findings: list[Finding]) -> list[Finding]:
    """Return one finding per code and column: the one in the middle, which says in how many runs it was found."""
    out = []
    for finding, runs in middle_ones(findings):
        if len(runs) > 1:
            sentence = f"{finding.sentence} (run {finding.run or runs[0]}; found in {len(runs)} runs)"
            finding = replace(finding, sentence=sentence, run=None)
        out.append(finding)
    return sorted(out, key=lambda finding: ("error", "warning", "note").index(finding.severity))


def middle_ones(findings: list[Finding]) -> list[tuple[Finding, list[str]]]:
    """One finding per code and column, the one in the middle, and the files that it was found in."""
    groups: dict[tuple[str, str | None, str | None], list[Finding]] = {}
    for finding in findings:
        groups.setdefault(finding.fault, []).append(finding)
    out = []
    for group in groups.values():
        group.sort(key=lambda finding: finding.value if finding.value is not None else 0.0)
        files = {_file(finding.run): None for finding in group if finding.run}
        out.append((group[len(group) // 2], list(files)))
    return out


def unusable(findings: list[Finding], data: MeasuredSet) -> Finding | None:
    """Return the finding that makes a whole data set unusable, None where it can be diagnosed.

    That is an error in goal, position or time of any run, runs of machines with other joints, or no motion of any joint
    in any run.
    """
    fatal = [finding for finding in findings if finding.severity == "error"]
    still = [finding for finding in fatal if finding.code == "motion.none"]
    if still and len(still) == sum(len(run.joints) for run in data.runs):
        return still[0]
    needed = ("time", "goal", "position")
    return next(
        (
            finding
            for finding in fatal
            if finding.code == "set.joints"
            or (finding.code != "motion.none" and (finding.column or "").rpartition(".")[2] in needed)
        ),
        None,
    )


def _of_run(run: MeasuredRun, joints: Sequence[JointContext]) -> list[Finding]:
    findings = list(check_clock(run))
    for joint in joints:
        of_motion = list(check_motion(joint))
        findings += of_motion
        if not joint.still and UNKNOWN_UNIT.isdisjoint(finding.code for finding in of_motion):
            findings += check_columns(joint)
            findings += check_drive(joint)
            findings += check_goal(joint)
            if not any(finding.severity == "error" for finding in of_motion):
                findings += check_recording(joint)
    fastest = max(joints, key=lambda joint: joint.span / max(joint.noise, 1e-12))
    if not any(finding.severity == "error" for finding in findings):
        findings += check_stamps(fastest)
    return [replace(finding, run=run.name) for finding in findings]


def _across(data: MeasuredSet) -> Iterator[Finding]:
    first = data.runs[0]
    for index, run in enumerate(data.runs):
        if run.joints.keys() != first.joints.keys():
            yield Finding(
                "set.joints", "error", None, None,
                f"{run.name} has the joints {', '.join(run.joints)}, {first.name} has {', '.join(first.joints)}: "
                "keep one machine per data set.",
                data_error=True, run=run.name,
            )  # fmt: skip
        for other in data.runs[:index]:
            same = len(run.time) == len(other.time) and all(
                name in other.joints and np.array_equal(log.position, other.joints[name].position)
                for name, log in run.joints.items()
            )
            if same and any(np.ptp(log.position) > 0.0 for log in run.joints.values()):  # rest looks alike
                yield Finding(
                    "set.duplicate", "warning", None, None,
                    f"{run.name} is the same recording as {other.name}: a test on one after a fit on the other proves "
                    "nothing; remove one.",
                    data_error=True, run=run.name,
                )  # fmt: skip


# --- faults of columns are properties of the machine: decided once, over all its runs, and mended in all of them -----
#
# A column in a known unit is converted, a false one is set aside.

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
        for signal in POSITIONS:
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
