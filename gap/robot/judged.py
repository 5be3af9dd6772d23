"""What joints of a robot share, from what was found at each of them first, and their diagnoses beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from ..load.robot import Machine
from ..log.finding import Finding
from ..measure.case import ROBOT, Case, Replay
from ..measure.confidence import THRESHOLDS
from ..measure.measured import Measured, measure
from ..measure.named import NamedCause
from ..prepare.request import Request
from ..search.latency import DELAY, NUMBER
from ..search.structure import listed, told_in
from ..verdict.decide import decide
from ..verdict.verdict import JointDiagnosis, Reason, Replayed
from .encoders import ENCODERS, InLight, in_light
from .joints import NOTHING_KNOWN, Again, Known, joints_of
from .search import SharedFound, affected, search_shared
from .together import headed, split

NOT_NAMED = "robot.not_shared"
SHARED = "robot.shared"
"""Code of the finding that says with what of the whole robot a joint is judged."""


@dataclass(frozen=True, eq=False)
class OfRobot:
    """What was found of a robot, before its joints are diagnosed with it.

    Attributes:
        known: how each joint is to be diagnosed.
        before: of the joints that carry what was found, what they were without it.
        said: what was found, in words.
        shares: of its causes in the gap of the robot, by name.
        robot: its own diagnosis; None where nothing is named.
    """

    known: Mapping[str, Known]
    before: Mapping[str, JointDiagnosis] = field(default_factory=dict)
    said: str = ""
    shares: Mapping[str, float] = field(default_factory=dict)
    robot: JointDiagnosis | None = None

    def beside(self, found: Sequence[JointDiagnosis], request: Request) -> list[JointDiagnosis]:
        """Diagnoses of joints that were made with it, beside what was found of the robot."""
        judged = [
            headed(beside_before(one, self.before[one.joint], self.said, self.shares), request.latency)
            if one.joint in self.before
            else one
            for one in found
        ]
        return judged if self.robot is None else [*judged, self.robot]


def of_robot(machine: Machine, found: Sequence[JointDiagnosis], request: Request, again: Again) -> OfRobot:
    """What joints of a robot share, from what was found at each of them first.

    Args:
        machine: that was logged, of a robot with a file.
        found: first, about each joint.
        request: what was asked for.
        again: seeks the same once more, with what is known of the joints.
    """
    robot = machine.robot
    assert robot is not None
    light = in_light(robot, machine, found, request, again)
    light = replace(light, known={one.joint: _going_on(one, light.known) for one in light.found})
    joints = joints_of(light.found, request.search)
    named = {d.joint: [cause.name for cause in d.causes] for d in light.found}
    noticed = {d.joint: d.structure is not None and d.structure.noticed for d in light.found}
    if not (light.tilted or affected(named, noticed)):
        return OfRobot(light.known)
    sought = search_shared(
        robot,
        light.runs,
        joints.problems,
        searches=joints.searches,
        seed=request.seed,
        progress=request.progress,
        causes=request.causes,
        settings=request.search,
        look_on=request.look_on,
        apart=ENCODERS if light.tilted else (),
    )
    if sought is None or not sought.search.accepted:
        return OfRobot(light.known)
    names = listed([candidate.cause.key for candidate in sought.search.accepted])
    if not sought.widespread():
        return _not_named(light, f"{names} would lower the error by a tenth at fewer than two joints", request)
    request.progress("measuring what joints share on runs that nothing has seen")
    measured = measure(Replay(sought.problem, sought.problem), sought.search, ROBOT, request.seed)
    values = {number: value for number, value in measured.values.items() if number in sought.rows}
    surest = max((of_any(cause, sought) for cause in measured.causes), default=0.0)
    if surest < THRESHOLDS.sure:  # what joints say stands
        return _not_named(light, f"{names} would have a confidence of {surest:.0%}", request)
    units = {number: sought.problem.models[0].units[number] for number in values}
    said = ", ".join(
        f"{number} {x:.3g}{'' if units[number] == '1' else ' ' + units[number]}" for number, x in values.items()
    )
    before, known = {}, dict(light.known)
    for one in light.found:
        if (more := sought.more(one.joint, values)) is not None:
            sentence = f"'{one.joint}' is judged with what was found of the whole robot: {said}."
            note = Finding(SHARED, "note", one.joint, None, sentence)
            known[one.joint] = light.moved.get(one.joint, NOTHING_KNOWN).also(more, note)
            before[one.joint] = one
    if before:
        request.progress(f"judging {', '.join(before)} with what the robot was found to have")
    measured = sought.by_effect(measured, "" if request.latency is None else NUMBER, DELAY)
    shares = {cause.name: cause.share for cause in measured.causes}
    return OfRobot(known, before, said, shares, _diagnosis(sought, measured, values))


def of_any(cause: NamedCause, sought: SharedFound) -> float:
    """Confidence that the robot has a cause or one of its rivals, all of which are of its bodies or its base."""
    wins = [one.best for one in sought.search.accepted if one.cause.name == cause.name]
    return min(cause.confidence / max(wins), 1.0) if any(wins) else cause.confidence


def _going_on(found: JointDiagnosis, known: Mapping[str, Known]) -> Known:
    """What a joint was found with first, and what was found of it with that."""
    return replace(known.get(found.joint, NOTHING_KNOWN), begun=found.search)


def _not_named(light: InLight, why: str, request: Request) -> OfRobot:
    """Nothing of the robot, and a note for each joint of what was sought of it, and is not named."""
    sentence = f"Nothing is said of the whole robot: {why}. What was found of each joint stands."
    request.progress(sentence)
    return OfRobot(noted(light.known, light.found, Finding(NOT_NAMED, "note", None, None, sentence)))


def noted(known: Mapping[str, Known], found: Sequence[JointDiagnosis], finding: Finding) -> dict[str, Known]:
    """What is known of joints, with a finding that each of them has as its own."""
    return {
        one.joint: known.get(one.joint, NOTHING_KNOWN).also(None, replace(finding, joint=one.joint)) for one in found
    }


def beside_before(now: JointDiagnosis, before: JointDiagnosis, said: str, robot: Mapping[str, float]) -> JointDiagnosis:
    """A joint judged anew, beside what its nominal model was before anything of the robot was known.

    Args:
        now: judged with what was found of the robot.
        before: judged without.
        said: what was found.
        robot: shares of its causes in the gap of the robot, by name.
    """
    if not all("nominal" in one.gap and "noise_floor" in one.gap for one in (now, before)):
        return now
    noise = now.gap["noise_floor"].rmse
    first, rest = (max(one.gap["nominal"].rmse ** 2 - noise**2, 0.0) for one in (before, now))
    kept = min(rest / first, 1.0) if first > 0.0 else 1.0  # of the gap, for the joint's own causes to explain
    factor, unit = told_in(now.unit)
    errors = " to ".join(f"{factor * one.gap['nominal'].rmse:.3g}" for one in (before, now))
    taken = f"What was found of the whole robot ({said}) takes the error from {errors} {unit}; this is about the rest."
    simulated = dict(now.simulated)
    if "nominal" in before.simulated:
        simulated["nominal"] = before.simulated["nominal"]
    found = now.changed(
        gap={**now.gap, "nominal": before.gap["nominal"]},
        simulated=simulated,
        unexplained=now.unexplained * kept,
        reasons=(Reason("shared", taken), *now.reasons) if kept < 1.0 else now.reasons,
    )
    return split(found, before.problem, robot)


def _diagnosis(sought: SharedFound, measured: Measured, values: dict[str, float]) -> JointDiagnosis:
    """What is said of the robot."""
    case = Case(ROBOT, signal=f"{ROBOT}.position", unit=sought.problem.signal[1])
    shared = replace(measured, values=values, simulated={}, tuned={})
    gap = {model: error for model, error in shared.gap.items() if model != "refitted"}  # nothing of it was refitted
    return JointDiagnosis(case, decide(Replayed(case, shared)), replace(shared, gap=gap), sought.search)
