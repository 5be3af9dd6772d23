"""What of a diagnosis a robot takes: all of it, unless it then misses its own log by more than as it was believed.

Each joint is judged alone, with its neighbours moving as measured, and what was tuned beside a cause is its own best
guess. Of bodies that other joints carry as well, such guesses may contradict each other; only the whole robot tells.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ...envs.extended import Extended
from ..log.progress import Progress
from ..log.types import MeasuredSet
from ..measure.named import CERTAIN, LIKELY, NamedCause
from ..replay.parameters import Target, address
from ..robot.encoders import ENCODERS
from ..search.structure import told_in
from ..verdict.verdict import JointDiagnosis
from .draws import with_draws
from .extension import Taken, as_taken, extended_of
from .whole import confirm_whole

NARROWER: tuple[Taken, ...] = ("own", "named")
KEPT = "Encoders whose error is doubted stay as believed in the model that is handed over"
HARM_RATIO = 1.1  # times its error as believed, beyond its noise, from which a joint counts as harmed
LEFT = {
    "own": "Numbers of bodies that were only tuned stay as the robot's file has them",
    "named": "Joints without a named cause, and numbers of bodies that were only tuned, stay as they were believed",
}
TOLD_MASS_CHANGE = 0.02  # relative change of a mass, or one in its unit, from which it is told
UNITS = {"payload": "kg"}
UNSEEN = f"{LEFT['own']}: no simulation of the whole robot could show that they do no harm."
"""Said where a robot cannot be simulated along its log."""


def hand_over(
    diagnoses: Sequence[JointDiagnosis], recorded: MeasuredSet, progress: Progress = lambda text: None
) -> tuple[Extended | None, dict[str, Any] | None]:
    """The machine as diagnosed, and how the whole robot follows its log with it.

    Args:
        diagnoses: of the machine.
        recorded: the data as they were logged.
        progress: is told what goes on.

    Returns:
        The model, with machines as it may be (:mod:`.draws`); of a robot with a file also what
        :func:`sealegs.gap.output.whole.confirm_whole` found of it, with ``taken``, the sentence ``left`` where not all
        is taken, ``harm`` where it still misses its log by more, and ``bodies`` where it changes any.
    """
    diagnoses, kept = [without_doubted_encoders(one) for one in diagnoses], kept_of(diagnoses)
    extended, confirmed = _taken(diagnoses, recorded, progress)
    if kept:
        confirmed = dict(confirmed or {})
        confirmed["left"] = " ".join(filter(None, (kept, confirmed.get("left"))))
    if extended is None:
        return None, confirmed
    progress("drawing machines as it may be")
    taken = "all" if confirmed is None else confirmed.get("taken", "all")
    extended = with_draws(extended, diagnoses, as_taken(recorded, diagnoses), taken)
    if confirmed is None or not (said := bodies_of(extended)):
        return extended, confirmed
    return extended, confirmed | {"bodies": said}


def doubted_encoders(diagnosis: JointDiagnosis) -> dict[str, NamedCause]:
    """Numbers of the encoder, by path, whose cause is no more likely than not.

    A log tells an encoder that reads too little from a joint that moves too little by their traces alone. Where it can
    not, a policy that believes the encoder's error would bring the link elsewhere; one that does not loses nothing that
    it has today.
    """
    if diagnosis.search is None:
        return {}
    doubted = {cause.name: cause for cause in diagnosis.causes if cause.standing not in (CERTAIN, LIKELY)}
    return {
        p.path: doubted[found.cause.name]
        for found in diagnosis.search.accepted
        if found.cause.name in ENCODERS and found.cause.name in doubted
        for p in found.variant
        if address(p.path).target is Target.STAGE and p.path in diagnosis.values
    }


def without_doubted_encoders(diagnosis: JointDiagnosis) -> JointDiagnosis:
    """The diagnosis as its model is handed over: with encoders as believed where their error is doubted."""
    doubted = doubted_encoders(diagnosis)
    if not doubted:
        return diagnosis
    return diagnosis.changed(values={path: value for path, value in diagnosis.values.items() if path not in doubted})


def kept_of(diagnoses: Sequence[JointDiagnosis]) -> str:
    """What is not handed over of encoders, in a sentence; empty for nothing."""
    rows = [
        f"{cause.name} of '{one.joint}' (confidence {cause.confidence:.0%})"
        for one in diagnoses
        for cause in one.causes
        if cause in doubted_encoders(one).values()
    ]
    return f"{KEPT}: {', '.join(rows)}." if rows else ""


def bodies_of(extended: Extended) -> str:
    """What a model changes of bodies, in a sentence; empty for nothing."""
    rows = []
    for change in extended.changes:
        _, _, key = change.path.partition("body.")
        if not key or abs(change.after - change.before) <= TOLD_MASS_CHANGE * max(abs(change.before), TOLD_MASS_CHANGE):
            continue
        value = f"x {change.after:.3g}" if key.endswith("factor") else f"{change.after:+.3g} {UNITS.get(key, 'm')}"
        rows.append(
            f"{change.joint} {key.replace('_factor', '').replace('_', ' ')} {value} ({change.cause or 'tuned'})"
        )
    return f"Bodies as handed over: {', '.join(dict.fromkeys(rows))}." if rows else ""


def _taken(
    diagnoses: Sequence[JointDiagnosis], recorded: MeasuredSet, progress: Progress
) -> tuple[Extended | None, dict[str, Any] | None]:
    data = as_taken(recorded, diagnoses)
    extended = extended_of(diagnoses, data)
    confirmed = None if extended is None else confirm_whole(diagnoses, recorded, extended, progress)
    if extended is None or confirmed is None:
        return extended, confirmed
    floors = {item.joint: item.gap["noise_floor"].rmse for item in diagnoses if "noise_floor" in item.gap}
    if "joints" not in confirmed:
        narrower = extended_of(diagnoses, data, "own")
        if narrower is None or narrower.changes == extended.changes:
            return extended, confirmed
        return narrower, confirmed | {"taken": "own", "left": UNSEEN}
    nominal = {name: {"nominal": item["nominal"]} for name, item in confirmed["joints"].items()}
    tried: dict[Taken, tuple[Extended, dict[str, Any]]] = {"all": (extended, confirmed)}
    for taken in NARROWER:
        last, of_last = next(reversed(tried.values()))
        if not harmed(of_last["joints"], floors):
            break
        narrower = extended_of(diagnoses, data, taken)
        if narrower is None or narrower.to_dict() == last.to_dict():
            continue
        found = confirm_whole(diagnoses, recorded, narrower, progress, taken, ("extended",))
        if found is None or "joints" not in found:
            break
        joints = {name: nominal[name] | item for name, item in found["joints"].items()}
        tried[taken] = narrower, found | {"joints": joints}
    best = min(
        tried, key=lambda taken: (bool(harmed(tried[taken][1]["joints"], floors)), _missed(tried[taken], floors))
    )
    extended, found = tried[best]
    said = found | {"taken": best}
    if best != "all":
        rows = _worse(confirmed["joints"], floors)
        said["left"] = f"{LEFT[best]}. As tuned, the whole robot misses its log by more: {rows}."
    if harmed(found["joints"], floors):
        rows = _worse(found["joints"], floors)
        said["harm"] = f"With what was found, the whole robot misses its log by more than as believed: {rows}."
    return extended, said


def harmed(joints: Mapping[str, Mapping[str, Any]], floors: Mapping[str, float]) -> list[str]:
    """Joints that the extended robot misses by more than the nominal one.

    Args:
        joints: errors of both by joint.
        floors: noise of joints, where it is known.
    """
    return [
        name
        for name, item in joints.items()
        if item["extended"] > HARM_RATIO * item["nominal"]
        and item["extended"] - item["nominal"] > floors.get(name, 0.0)
    ]


def _missed(tried: tuple[Extended, dict[str, Any]], floors: Mapping[str, float]) -> float:
    """How much more a robot misses its log by than as believed, over all joints, in logarithms."""
    joints = tried[1]["joints"]
    least = {name: max(floors.get(name, 0.0), 1e-12) for name in joints}
    return sum(
        math.log(max(item["extended"], least[name]) / max(item["nominal"], least[name]))
        for name, item in joints.items()
    )


def _worse(joints: Mapping[str, Mapping[str, Any]], floors: Mapping[str, float]) -> str:
    """Which joints the whole robot misses by more, in words."""
    rows = []
    for name in harmed(joints, floors):
        factor, unit = told_in(joints[name]["unit"])
        before, after = (f"{factor * joints[name][model]:.3g}" for model in ("nominal", "extended"))
        rows.append(f"'{name}' by {after} {unit} ({before} as believed)")
    return ", ".join(rows)
