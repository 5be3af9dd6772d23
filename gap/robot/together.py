"""What all joints share beside the robot's bodies, sought before their own causes: the latency of the bus."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...common.errors import SealegsError
from ..measure.case import Case, Replay
from ..measure.confidence import standing
from ..measure.measured import Measured
from ..measure.named import Error, NamedCause, Value
from ..prepare.request import Request
from ..replay.problem import NOISE_FLOORS
from ..search.forward import NUMERICAL
from ..search.latency import DELAY, NUMBER, Latency, latency_of
from ..search.look import Look, look
from ..search.structure import fine
from ..verdict.evidence import Refused
from ..verdict.verdict import EXPLAINED, NOTHING, PARTLY, JointDiagnosis, Reason, Verdict
from .search import ROBOT

SENTENCE = "Commands take effect at another time than the model believes, at all joints alike: the bus."
MOSTLY = 0.5  # of a joint's gap, from which what joints share is told first
Replayed = Callable[[str], Replay | Refused | None]
"""Gives the replay of a joint; None where it has no commands."""


def seek_latency(joints: Sequence[str], replayed: Replayed, request: Request) -> Latency | None:
    """The latency that joints share, from a first look at each; None where there are too few joints, or none.

    Args:
        joints: their names.
        replayed: gives each joint's replay.
        request: what was asked for.
    """
    if len(joints) < 2 or (request.causes is not None and DELAY not in request.causes):
        return None
    return look_at(joints, replayed, request).latency


@dataclass(frozen=True, eq=False)
class FirstLook:
    """What a machine shows at first sight: each joint that could be replayed, and the latency that they share."""

    joints: Mapping[str, Look]
    latency: Latency | None


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
    problem, noise = diagnosis.problem, diagnosis.gap.get("noise_floor")
    if found is None or diagnosis.joint not in found.joints or problem is None or noise is None:
        return diagnosis
    if NUMBER not in diagnosis.values:  # the believed model is handed over
        return diagnosis
    rows = problem.simulate([{}, {NUMBER: found.value}])
    before, after = (float(np.mean(problem.position_error(row) ** 2)) for row in rows)
    gap = max(before - noise.rmse**2, 1e-24)
    share = float(np.clip((before - after) / gap, 0.0, diagnosis.tuned_share))
    reason = Reason("shared", f"All joints share a {told(found)}: {100.0 * share:.0f} % of this gap.")
    diagnosis = diagnosis.changed(
        shared_share=share,
        tuned_share=diagnosis.tuned_share - share,
        shared={NUMBER: DELAY},
        reasons=(reason, *diagnosis.reasons),
    )
    if share < MOSTLY:
        return diagnosis
    if any(reason.code == "outweighed" for reason in diagnosis.reasons):  # numbers of its own are not what does most
        rest = diagnosis.sentence.partition("; ")[2]
        what = f"The latency of all joints explains {100.0 * share:.0f} % of the gap of '{diagnosis.joint}'"
        return diagnosis.changed(sentence=f"{what}; {rest}")
    if diagnosis.verdict != NOTHING:
        return diagnosis
    errors = [diagnosis.gap[name].rmse for name in ("nominal", "extended")]
    sentence = (
        f"The latency of all joints, {1e3 * found.value:.1f} ms, explains the gap of '{diagnosis.joint}': error "
        f"{fine(errors[0], diagnosis.unit)} to {fine(errors[1], diagnosis.unit)}."
    )
    return diagnosis.changed(verdict=EXPLAINED, sentence=sentence)


def with_latency(diagnoses: Sequence[JointDiagnosis], found: Latency | None) -> list[JointDiagnosis]:
    """The diagnoses with the latency named once, at the robot."""
    having = [one for one in diagnoses if found is not None and one.joint in found.joints and NUMBER in one.shared]
    if found is None or not having:
        return list(diagnoses)
    noises = {one.joint: one.gap["noise_floor"].rmse for one in having}
    sizes = {
        name: float(np.sqrt(np.mean([(one.gap[name].rmse / noises[one.joint]) ** 2 for one in having])))
        for name in ("nominal", "extended")
    }
    weights = np.array([(one.gap["nominal"].rmse / noises[one.joint]) ** 2 for one in having])
    share = float(weights @ np.array([one.shared_share for one in having]) / weights.sum())
    value = Value(found.value, found.low, found.high, "s", found.believed)
    cause = NamedCause(
        name=DELAY,
        sentence=SENTENCE,
        joint=ROBOT,
        share=share,
        confidence=found.confidence,
        parameters={NUMBER: value},
        gain=share,
        kind="number",
        standing=standing(found.confidence, ()),
    )
    sentence = f"All joints: {told(found)}, {100.0 * share:.0f} % of the gap."
    known = next((one for one in diagnoses if one.joint == ROBOT), None)
    if known is not None:
        causes = tuple(sorted((cause, *known.causes), key=lambda named: -named.share))
        joined = known.changed(causes=causes, reasons=(Reason("shared", sentence), *known.reasons))
        return [joined if one is known else one for one in diagnoses]
    reason = Reason("shared", f"It is of the same size at {', '.join(found.joints)}.")
    measured = Measured(
        gap={name: Error(size, size) for name, size in {**sizes, "noise_floor": 1.0}.items()},
        unexplained=max(1.0 - share, 0.0),
        causes=(cause,),
        shared_share=share,
    )
    case = Case(ROBOT, signal=f"{ROBOT}.position", unit=NOISE_FLOORS)
    said = Verdict(EXPLAINED if share >= MOSTLY else PARTLY, sentence, (reason,))
    return [*diagnoses, JointDiagnosis(case, said, measured)]
