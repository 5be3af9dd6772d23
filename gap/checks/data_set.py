"""Check measured logs before any physics is blamed: clock, units, contradicting columns, too little motion."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..log.finding import Finding
from ..log.types import LogError, MeasuredRun, MeasuredSet
from .clock import check_clock
from .columns import check_columns
from .context import JointContext, joint_contexts
from .correction import mendable, mended, told
from .drive import check_drive
from .goals import check_goal
from .machine import decided
from .motion import check_motion
from .recording import check_recording, check_stamps
from .signal import sample_noise
from .torque import check_torque

__all__ = ["Finding", "check_run", "check_set", "corrected", "merged", "noise_floor", "shows_little", "unusable"]


def check_run(run: MeasuredRun) -> list[Finding]:
    """Return what is wrong with, or worth knowing about, one run; an empty list for a clean one."""
    findings = _without_torque(run)
    for joint in joint_contexts(run):
        findings += check_torque([joint], run.name)
    return findings


def check_set(data: MeasuredSet) -> list[Finding]:
    """Return the findings of every run and those across runs; torque columns are judged over all runs together."""
    findings = [finding for run in data.runs for finding in _without_torque(run)]
    contexts = [joint_contexts(run) for run in data.runs]
    names_of_runs = [run.name for run in data.runs]
    only = names_of_runs[0] if len(names_of_runs) == 1 else None
    names = dict.fromkeys(joint.name for joints in contexts for joint in joints)
    for name in names:
        same = [joint for joints in contexts for joint in joints if joint.name == name]
        findings += check_torque(same, only)
    return _without_unit_of_magnitudes(_magnitudes(findings, data)) + list(_across(data))


def _magnitudes(findings: list[Finding], data: MeasuredSet) -> list[Finding]:
    """Findings less those of an unsigned column that is negative in another run: there a load pushed one way."""
    return [
        finding
        for finding in findings
        if finding.code not in UNSIGNED or not any(_negative(run, finding.joint, finding.code) for run in data.runs)
    ]


def _negative(run: MeasuredRun, joint: str | None, code: str) -> bool:
    """Whether the column that such a finding is of goes below zero in a run."""
    log = run.joints.get(joint or "")
    values = None if log is None else getattr(log, code.partition(".")[0])
    return values is not None and bool(np.any(values < 0.0))


def _without_unit_of_magnitudes(findings: list[Finding]) -> list[Finding]:
    """Findings less the unit and sign of a current that is unsigned in any run: a magnitude has neither.

    Where a run pushes one way only, a magnitude looks like a current of another scale.
    """
    unsigned = {(finding.joint, finding.column) for finding in findings if finding.code in UNSIGNED}
    return [
        finding
        for finding in findings
        if finding.code not in ("unit.current", "current.sign") or (finding.joint, finding.column) not in unsigned
    ]


MENDED_FIRST = (
    *("goal.wrap", "position.wrap", "link_position.wrap", "unit.millimetres", "unit.degrees", "position.sign"),
    *("clock.late_stamps", "column.held", "column.behind", "goal.interpolated"),
)
"""Errors that make others appear, one after the other."""
UNKNOWN_UNIT = frozenset(("unit.ticks", "unit.length"))
"""Findings of a position of which the checks of other columns would say something wrong."""
UNSIGNED = ("current.unsigned",)
"""Findings of one run that hold for all of a machine: its register has no sign."""


def corrected(
    data: MeasuredSet, findings: list[Finding], done: frozenset[tuple[str | None, ...]] = frozenset()
) -> tuple[MeasuredSet, list[Finding]]:
    """Return the runs with their mendable columns converted or set aside, and what is to be said about both.

    A run is checked again after it was mended, since a column in degrees makes others look wrong. What mending did not
    cure (``done``) is told and left.
    """
    findings = together(decided(_without_unit_of_magnitudes(findings), data))
    faults = [finding for finding in findings if mendable(finding) and _where(finding) not in done]
    if not faults:
        return data, findings
    staged = ([finding for finding in faults if finding.code == code] for code in MENDED_FIRST)
    now = next((stage for stage in staged if stage), faults)
    runs = tuple(mended(run, _once([f for f in now if _concerns(f, run)])) for run in data.runs)
    data = replace(data, runs=runs)
    rest = [finding for finding in data.findings if not mendable(finding)]
    data, others = corrected(data, [*rest, *check_set(data)], done | {_where(finding) for finding in now})
    return data, [*(told(finding) for finding in now), *others]


def _concerns(finding: Finding, run: MeasuredRun) -> bool:
    """Whether a finding holds for a run: it is of the run, of the file that the run is a window of, or of all."""
    return finding.code in UNSIGNED or finding.run in (run.name, _file(run.name), None)


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


def _without_torque(run: MeasuredRun) -> list[Finding]:
    findings = list(check_clock(run))
    for joint in joint_contexts(run):
        of_motion = list(check_motion(joint))
        findings += of_motion
        if not joint.still and UNKNOWN_UNIT.isdisjoint(finding.code for finding in of_motion):
            findings += check_columns(joint)
            findings += check_drive(joint)
            findings += check_goal(joint)
            if not any(finding.severity == "error" for finding in of_motion):
                findings += check_recording(joint)
    fastest = max(joint_contexts(run), key=lambda joint: joint.span / max(joint.noise, 1e-12))
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


VELOCITY_RATIOS = ("unit.velocity", "velocity.gear_side")
TORQUE_RATIO = "torque.gear_side"
SAME_RATIO_TOLERANCE = 0.08
"""Relative difference up to which two ratios may be one: of a scale with some percent of error each."""


def together(findings: Sequence[Finding]) -> list[Finding]:
    """Findings of which those on one gear say so: both readings are told where both fit."""
    torques = {f.joint: f for f in findings if f.code == TORQUE_RATIO and f.value}
    measured = (f for f in findings if f.code in VELOCITY_RATIOS and not (f.column or "").endswith(".goal_velocity"))
    speeds = {f.joint: f for f in measured if f.value}
    found = []
    for finding in findings:
        torque, speed = torques.get(finding.joint), speeds.get(finding.joint)
        if torque is None or speed is None or finding not in (torque, speed) or not _one_gear(torque, speed):
            found.append(finding)
            continue
        gear = _size(torque)
        if finding is torque:
            said = f"The velocity of the same log has a ratio of {_size(speed):.3g} as well: one gear would make both."
        else:
            what = "the unit is one reading, the" if finding.code == "unit.velocity" else "the"
            said = f"The torque of the same log has a ratio of {gear:.3g} as well: {what} other side of a gear another."
        found.append(replace(finding, sentence=f"{finding.sentence} {said}"))
    return found


def _size(finding: Finding) -> float:
    value = abs(finding.value or 1.0)
    return max(value, 1.0 / value)


def _one_gear(torque: Finding, speed: Finding) -> bool:
    return abs(math.log(_size(torque) / _size(speed))) < SAME_RATIO_TOLERANCE
