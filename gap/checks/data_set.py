"""Check measured logs before any physics is blamed: clock, units, contradicting columns, too little motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..log.finding import Finding
from ..log.types import LogError, MeasuredRun, MeasuredSet
from .clock import check_clock, check_stamps
from .columns import check_columns, check_unsigned
from .context import JointContext, joint_contexts
from .drive import check_drive
from .faults import FAULTS, SET_ASIDE, decided, mendable, mended, told
from .motion import check_motion
from .recording import check_goal, check_recording
from .signal import sample_noise
from .torque import check_torque

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
