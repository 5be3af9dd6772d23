"""What all joints share beside the robot's bodies: the latency of the bus, sought before their own causes, and the
supply, where they agree on it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from ...common.errors import SealegsError
from ..load.terms import T_DRAWN
from ..measure.case import ROBOT, Case, Replay
from ..measure.confidence import moved, standing, with_shares
from ..measure.measured import Measured
from ..measure.named import Error, NamedCause, Value
from ..prepare.request import Request
from ..replay.free import RESISTANCE
from ..replay.parameters import numbers
from ..replay.problem import NOISE_FLOORS, Problem
from ..search.forward import NUMERICAL
from ..search.latency import AGREEING, DELAY, NUMBER, ROOM, Latency, agreeing, latency_of, mean_of
from ..search.look import Look, look
from ..search.structure import fine, listed
from ..verdict.verdict import EXPLAINED, NOTHING, PARTLY, JointDiagnosis, Reason, Refused, Verdict, certainty, subject

SAG = "drive.supply_sag"
SUPPLY_SENTENCE = "The supply that all joints draw from drops under their currents."
SENTENCE = "Commands take effect at another time than the model believes, at all joints alike: the bus."
EXPLAINED_SHARE = 0.5  # of the gaps of all joints, from which what they share explains them
Replayed = Callable[[str], Replay | Refused | None]
"""Gives the replay of a joint; None where it has no commands."""


def seek_latency(joints: Sequence[str], replayed: Replayed, request: Request) -> FirstLook:
    """The latency that joints share, from a first look at each; nothing is looked at where there are too few joints.

    Args:
        joints: their names.
        replayed: gives each joint's replay.
        request: what was asked for.
    """
    if len(joints) < 2 or (request.causes is not None and DELAY not in request.causes):
        return FirstLook({}, None)
    return look_at(joints, replayed, request)


@dataclass(frozen=True, eq=False)
class FirstLook:
    """What a machine shows at first sight: each joint that could be replayed, and the latency that they share."""

    joints: Mapping[str, Look]
    latency: Latency | None

    def numbers(self) -> dict[str, Mapping[str, float]]:
        """What was found of each joint, by joint and path."""
        return {joint: seen.found.values for joint, seen in self.joints.items()}


def look_at(joints: Sequence[str], replayed: Replayed, request: Request) -> FirstLook:
    """A first look at joints; arguments as of :func:`seek_latency`."""
    looks, causes = {}, {}
    for joint in joints:
        request.progress(f"{joint}: a first look")
        try:
            replay = replayed(joint)
            if isinstance(replay, Replay) and replay.problem.free_joint is not None:
                looks[joint] = look(replay.fitting, replay.wide, replay.causes, request.search)
                causes[joint] = replay.causes
        except (SealegsError, *NUMERICAL):
            continue  # its own diagnosis says why
    found = latency_of(looks, causes, request.seed)
    if found is not None:
        request.progress(f"{told(found)}, at {', '.join(found.joints)}")
    return FirstLook(looks, found)


def told(found: Latency) -> str:
    """The latency in words."""
    ends = f"{1e3 * found.low:.1f} to {1e3 * found.high:.1f}"
    return f"latency {1e3 * found.value:.1f} ms ({ends}, {1e3 * found.believed:.3g} believed)"


def beside_latency(diagnosis: JointDiagnosis, found: Latency | None) -> JointDiagnosis:
    """A joint that was judged with the latency, which is no number of its own.

    Args:
        diagnosis: of the joint.
        found: the latency of all joints.
    """
    if found is None or diagnosis.joint not in found.joints or diagnosis.problem is None:
        return diagnosis
    if NUMBER not in diagnosis.values:  # the believed model is handed over
        return diagnosis
    diagnosis = split(diagnosis.changed(shared={NUMBER: DELAY}))
    share = diagnosis.shared_shares[DELAY]
    reason = Reason("shared", f"All joints share a {told(found)}: {100.0 * share:.0f} % of this gap.")
    return headed(diagnosis.changed(reasons=(reason, *diagnosis.reasons)), found)


def split(
    diagnosis: JointDiagnosis, before: Problem | None = None, robot: Mapping[str, float] = MappingProxyType({})
) -> JointDiagnosis:
    """A joint whose explained gap is split by effect: its own causes, its tuned numbers, and what all joints share.

    Args:
        diagnosis: of the joint.
        before: its replay without what was found of the robot; None where nothing was.
        robot: shares of the causes of the robot in what was found of it, by name.
    """
    problem, known = diagnosis.problem, numbers(diagnosis.values)
    assert problem is not None
    parts = [{known[number] for number in cause.parameters if number in known} for cause in diagnosis.causes]
    parts.append({number for number in diagnosis.shared if number in diagnosis.values})
    parts.append(set(diagnosis.values).difference(*parts))
    effects = [*moved(problem, diagnosis.values, parts), 0.0]
    if before is not None:
        here, away = (one.position_error(one.simulate([diagnosis.values])[0]) for one in (problem, before))
        effects[-1] = float(np.mean((here - away) ** 2))
    *shares, late, tuned, whole = map(
        float, (1.0 - diagnosis.unexplained) * np.array(effects) / max(sum(effects), 1e-300)
    )
    shared = dict.fromkeys(diagnosis.shared.values(), late)
    shared |= {name: whole * part / sum(robot.values()) for name, part in robot.items()}
    causes = with_shares(diagnosis.causes, shares)
    return diagnosis.changed(causes=causes, shared_shares=shared, tuned_share=tuned)


def headed(diagnosis: JointDiagnosis, found: Latency | None) -> JointDiagnosis:
    """A joint whose sentence begins with what all joints share, where that does most.

    Args:
        diagnosis: of the joint.
        found: the latency of all joints.
    """
    shared = diagnosis.shared_shares
    first = max(shared, key=shared.__getitem__, default="")
    others = max([diagnosis.unexplained, *(cause.share for cause in diagnosis.causes)])
    if not first or shared[first] <= others:
        return diagnosis
    lead = f"{first} of the robot"
    if first == DELAY and found is not None:
        lead = f"The latency of all joints, {1e3 * found.value:.1f} ms,"
    named = ""
    if diagnosis.causes:
        own = 100.0 * sum(cause.share for cause in diagnosis.causes)
        named = f", {subject(diagnosis.causes)} {own:.0f} % ({certainty(diagnosis.causes)})"
    errors = [fine(diagnosis.gap[name].rmse, diagnosis.unit) for name in ("nominal", "extended")]
    rest = diagnosis.measured.structure
    left = f", {fine(rest.rms, rest.unit, 2)} unexplained" if rest is not None and rest.noticed else ""
    fell = f"error {errors[0]} to {errors[1]}{left}"
    sentence = f"{lead} explains {100.0 * shared[first]:.0f} % of the gap of '{diagnosis.joint}'{named}: {fell}."
    alone = diagnosis.verdict == NOTHING or diagnosis.said.because("blind")  # nothing of the joint's own is open
    verdict = EXPLAINED if alone else diagnosis.verdict
    return diagnosis.changed(verdict=verdict, sentence=sentence)


def agreed_latency(diagnoses: Sequence[JointDiagnosis]) -> tuple[list[JointDiagnosis], Latency | None]:
    """Joints that were each found to be as late, which a first look did not see, and the latency that is theirs.

    Args:
        diagnoses: of the joints, and of the robot.
    """
    joints, mean, half, told = _agreed(diagnoses, DELAY, NUMBER, lambda one: one.problem is not None)
    replayed = [one for one in diagnoses if one.problem is not None and one.problem.joint is not None]
    believed = {told[joint].parameters[NUMBER].nominal for joint in joints}
    rivals = set[str].intersection(*(set(told[joint].rivals) for joint in joints)) if joints else set()
    if len(joints) < AGREEING * len(replayed) or len(believed) != 1 or rivals:
        return list(diagnoses), None  # what no joint tells from a late reading is not told of all of them
    sure = sum(told[joint].confidence for joint in joints) / len(replayed)
    found = Latency(mean, max(mean - half, 0.0), mean + half, believed.pop(), tuple(joints), sure)
    return _late_by(found, diagnoses, told), found


def joined(diagnoses: Sequence[JointDiagnosis], found: Latency) -> tuple[list[JointDiagnosis], Latency]:
    """The latency with the joints that a first look left out, and that their own search found as late as the others.

    Args:
        diagnoses: of the joints, and of the robot.
        found: the latency of all joints, as a first look found it.
    """
    told = {one.joint: cause for one in diagnoses for cause in one.causes if cause.name == DELAY
            and one.joint not in (*found.joints, ROBOT) and _within(cause, found)}  # fmt: skip
    joints = (*found.joints, *told)
    known = replace(found, joints=joints, confidence=min(found.confidence * len(joints) / len(found.joints), 1.0))
    return _late_by(known, diagnoses, told), known


def _within(cause: NamedCause, found: Latency) -> bool:
    """Whether the delay of a joint may be the latency of all."""
    value = cause.parameters.get(NUMBER)
    return (
        value is not None
        and not cause.rivals
        and value.nominal == found.believed
        and value.low <= found.high
        and found.low <= value.high
    )


def _late_by(
    found: Latency, diagnoses: Sequence[JointDiagnosis], told: Mapping[str, NamedCause]
) -> list[JointDiagnosis]:
    """The diagnoses, with the latency of all joints in place of the delays that joints were told."""
    return [
        headed(_without(one, told[one.joint], NUMBER), found)
        if one.joint in told and one.joint in found.joints
        else one
        for one in diagnoses
    ]


def _agreed(
    diagnoses: Sequence[JointDiagnosis], name: str, number: str, may: Callable[[JointDiagnosis], bool]
) -> tuple[list[str], float, float, dict[str, NamedCause]]:
    """Joints that agree on the number of a cause, its mean and half width, and what each joint has of it.

    Args:
        diagnoses: of the joints, and of the robot.
        name, number: of the cause.
        may: whether a joint's may be one with that of others.
    """
    told = {one.joint: cause for one in diagnoses for cause in one.causes if cause.name == name and may(one)}
    values = {joint: cause.parameters[number] for joint, cause in told.items() if number in cause.parameters}
    halves = {joint: 0.5 * (value.high - value.low) for joint, value in values.items()}
    joints = agreeing({joint: (value.value, ROOM * halves[joint]) for joint, value in values.items()})
    if len(joints) < max(2, AGREEING * len(told)):
        return [], 0.0, 0.0, told
    mean, half = mean_of([(values[joint].value, halves[joint]) for joint in joints])
    # clocks, and what drives draw from each other, are wrong for all of them alike: no mean narrows that
    return joints, mean, half * len(joints) ** 0.5, told


def with_latency(diagnoses: Sequence[JointDiagnosis], found: Latency | None) -> list[JointDiagnosis]:
    """The diagnoses with the latency named once, at the robot."""
    if found is None:
        return list(diagnoses)
    value = Value(found.value, found.low, found.high, "s", found.believed)
    return of_all(diagnoses, OfAll(DELAY, NUMBER, SENTENCE, value, found.confidence, told(found)))


def with_supply(diagnoses: Sequence[JointDiagnosis], found: Latency | None) -> list[JointDiagnosis]:
    """The diagnoses with the sag of a supply that joints draw from together named once, where they agree on it.

    Args:
        diagnoses: of the joints, and of the robot.
        found: the latency of all joints.
    """
    joints, mean, half, told = _agreed(diagnoses, SAG, RESISTANCE, _draws)
    if not joints:
        return list(diagnoses)
    believed = told[joints[0]].parameters[RESISTANCE].nominal
    value = Value(mean, max(mean - half, 0.0), mean + half, "ohm", believed)
    sure = max(told[joint].confidence for joint in joints)
    words = f"supply {mean:.2g} ohm ({value.low:.2g} to {value.high:.2g}, {value.nominal:.2g} believed)"
    shared = [
        headed(_without(one, told[one.joint], RESISTANCE), found) if one.joint in joints else one for one in diagnoses
    ]
    return of_all(shared, OfAll(SAG, RESISTANCE, SUPPLY_SENTENCE, value, sure, words))


def _draws(diagnosis: JointDiagnosis) -> bool:
    """Whether others draw from the supply of a joint."""
    joint = None if diagnosis.problem is None else diagnosis.problem.joint
    return joint is not None and joint.terms is not None and bool(joint.terms[:, T_DRAWN].any())


def _without(diagnosis: JointDiagnosis, cause: NamedCause, number: str) -> JointDiagnosis:
    """A joint one of whose causes, and the number that it turns, are told of all joints."""
    return diagnosis.changed(
        causes=tuple(one for one in diagnosis.causes if one is not cause),
        shared={**diagnosis.shared, number: cause.name},
        shared_shares={**diagnosis.shared_shares, cause.name: cause.share},
    )


@dataclass(frozen=True)
class OfAll:
    """A cause of all joints.

    Attributes:
        name: of the cause.
        number: of each chain that it changes.
        sentence: about it.
        value: of the number.
        confidence: in the cause.
        words: the value, in words.
    """

    name: str
    number: str
    sentence: str
    value: Value
    confidence: float
    words: str


def of_all(diagnoses: Sequence[JointDiagnosis], told: OfAll) -> list[JointDiagnosis]:
    """The diagnoses with a cause of all joints named once, at the robot.

    Args:
        diagnoses: those of joints have its share, where they have it.
        told: the cause.
    """
    having = [one for one in diagnoses if told.number in one.shared]
    if not having:
        return list(diagnoses)
    noises = {one.joint: one.gap["noise_floor"].rmse for one in having}
    sizes = {
        name: float(np.sqrt(np.mean([(one.gap[name].rmse / noises[one.joint]) ** 2 for one in having])))
        for name in ("nominal", "extended")
    }
    weights = np.array([(one.gap["nominal"].rmse / noises[one.joint]) ** 2 for one in having])
    share = float(weights @ np.array([one.shared_shares[told.name] for one in having]) / weights.sum())
    cause = NamedCause(
        name=told.name,
        sentence=told.sentence,
        joint=ROBOT,
        share=share,
        confidence=told.confidence,
        parameters={told.number: told.value},
        gain=share,
        kind="number",
        standing=standing(told.confidence, ()),
    )
    known = next((one for one in diagnoses if one.joint == ROBOT), None)
    if known is not None:
        return [_beside_others(one, cause, told.words) if one is known else one for one in diagnoses]
    sentence = f"All joints: {told.words}, {100.0 * share:.0f} % of the gap."
    reason = Reason("shared", f"It is of the same size at {', '.join(one.joint for one in having)}.")
    measured = Measured(
        gap={name: Error(size, size) for name, size in {**sizes, "noise_floor": 1.0}.items()},
        unexplained=max(1.0 - share, 0.0),
        causes=(cause,),
    )
    case = Case(ROBOT, signal=f"{ROBOT}.position", unit=NOISE_FLOORS)
    said = Verdict(EXPLAINED if share >= EXPLAINED_SHARE else PARTLY, sentence, (reason,))
    return [*diagnoses, JointDiagnosis(case, said, measured)]


def _beside_others(robot: JointDiagnosis, cause: NamedCause, words: str) -> JointDiagnosis:
    """What is said of the robot, with another cause of all joints; the one that does most comes first."""
    tuned, open_share = robot.tuned_share, robot.unexplained
    share = robot.shared_shares.get(cause.name)
    if share is None:  # until now its numbers were tuned ones of the joints, or explained nothing
        share = min(cause.share, tuned + open_share)
        tuned, open_share = max(tuned - share, 0.0), open_share - max(share - tuned, 0.0)
    cause = replace(cause, share=share, gain=share)
    causes = tuple(sorted((cause, *robot.causes), key=lambda one: -one.share))
    others = listed([f"{one.name} {100.0 * one.share:.0f} %" for one in robot.causes])
    size = f"{words}, {100.0 * cause.share:.0f} % of the gap"
    sentence = f"All joints: {size}; beside it {others} ({certainty(robot.causes)})."
    if causes[0] is not cause:
        sentence = f"{robot.sentence.removesuffix('.')}; beside it the {size}."
    verdict = EXPLAINED if share >= EXPLAINED_SHARE else robot.verdict
    return robot.changed(
        verdict=verdict,
        causes=causes,
        sentence=sentence,
        shared_shares={name: part for name, part in robot.shared_shares.items() if name != cause.name},
        reasons=(Reason("shared", f"All joints: {size}."), *robot.reasons),
        tuned_share=tuned,
        unexplained=open_share,
    )
