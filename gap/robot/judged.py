"""What joints of a robot share, decided on top of their own diagnoses, and their diagnoses in its light."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

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
from .encoders import ENCODERS, in_light
from .joints import Again, joints_of
from .search import SharedFound, affected, search_shared
from .together import headed, split

NOT_NAMED = "robot.not_shared"
SHARED = "robot.shared"
"""Code of the finding that says with what of the whole robot a joint is judged."""


def with_robot(
    machine: Machine,
    found: Sequence[JointDiagnosis],
    request: Request,
    again: Again,
) -> list[JointDiagnosis]:
    """Diagnoses of the joints with one of the robot behind them, where they share a cause; else as they are.

    Args:
        machine: that was logged, of a robot with a file.
        found: about each joint.
        request: what was asked for.
        again: diagnoses joints again.
    """
    robot = machine.robot
    assert robot is not None
    light = in_light(robot, machine, found, request, again)
    found, runs = light.found, light.runs
    joints = joints_of(found, request.search)
    named = {d.joint: [cause.name for cause in d.causes] for d in found}
    noticed = {d.joint: d.structure is not None and d.structure.noticed for d in found}
    if not (light.tilted or affected(named, noticed)):
        return list(found)
    sought = search_shared(
        robot,
        runs,
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
        return list(found)
    names = listed([candidate.cause.key for candidate in sought.search.accepted])
    if not sought.widespread():
        return _not_named(found, f"{names} would lower the error by a tenth at fewer than two joints", request)
    request.progress("measuring what joints share on runs that nothing has seen")
    measured = measure(Replay(sought.problem, sought.problem), sought.search, ROBOT, request.seed)
    values = {number: value for number, value in measured.values.items() if number in sought.rows}
    surest = max((of_any(cause, sought) for cause in measured.causes), default=0.0)
    if surest < THRESHOLDS.sure:  # what joints say stands
        return _not_named(found, f"{names} would have a confidence of {surest:.0%}", request)
    units = {number: sought.problem.models[0].units[number] for number in values}
    said = ", ".join(
        f"{number} {x:.3g}{'' if units[number] == '1' else ' ' + units[number]}" for number, x in values.items()
    )
    asked = {}
    for diagnosis in found:
        joint = diagnosis.joint
        if (more := sought.more(joint, values)) is not None:
            if joint in light.rows:
                more = [a + b for a, b in zip(more, light.rows[joint], strict=True)]
            sentence = f"'{joint}' is judged with what was found of the whole robot: {said}."
            asked[joint] = more, Finding(SHARED, "note", joint, None, sentence)
    if asked:
        request.progress(f"judging {', '.join(asked)} with what the robot was found to have")
    now = {diagnosis.joint: diagnosis for diagnosis in again(asked)} if asked else {}
    measured = sought.by_effect(measured, "" if request.latency is None else NUMBER, DELAY)
    robots = {cause.name: cause.share for cause in measured.causes}
    judged = [
        headed(beside_before(now[one.joint], one, said, robots), request.latency) if one.joint in now else one
        for one in found
    ]
    return [*judged, _of_robot(sought, measured, values)]


def of_any(cause: NamedCause, sought: SharedFound) -> float:
    """Confidence that the robot has a cause or one of its rivals, all of which are of its bodies or its base."""
    wins = [one.best for one in sought.search.accepted if one.cause.name == cause.name]
    return min(cause.confidence / max(wins), 1.0) if any(wins) else cause.confidence


def _not_named(found: Sequence[JointDiagnosis], why: str, request: Request) -> list[JointDiagnosis]:
    """The diagnoses as they are, each with a note of what was sought of the whole robot, and is not named."""
    sentence = f"Nothing is said of the whole robot: {why}. What was found of each joint stands."
    request.progress(sentence)
    return [
        one.changed(findings=(*one.findings, Finding(NOT_NAMED, "note", one.joint, None, sentence))) for one in found
    ]


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


def _of_robot(sought: SharedFound, measured: Measured, values: dict[str, float]) -> JointDiagnosis:
    """What is said of the robot."""
    case = Case(ROBOT, signal=f"{ROBOT}.position", unit=sought.problem.signal[1])
    shared = replace(measured, values=values, simulated={}, tuned={})
    return JointDiagnosis(case, decide(Replayed(case, shared)), shared, sought.search)
