"""What a diagnosis says: the verdict, its causes with their numbers, and the sentence for people."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..experiment import Experiment
from ..log.finding import Finding
from ..replay.problem import Problem
from ..search.result import Search
from ..search.structure import Structure, fine, listed

NEGLIGIBLE = 0.03  # unexplained share of the gap up to which it counts as explained, its causes beyond doubt and the
# structure that stays no larger than the noise
FEEBLE = 0.3  # squared error that causes remove, in parts of what re-tuning leaves, below which they explain nothing
UNSURE = 0.6  # a cause that is the best in a smaller share of draws than this is not named alone

EXPLAINED, PARTLY, NOTHING, NOT_IDENTIFIABLE, UNUSABLE = (
    "explained",
    "partly explained",
    "nothing to explain",
    "not identifiable",
    "unusable log",
)


@dataclass(frozen=True)
class Error:
    """Error of one model on the test part: root mean square and mean absolute."""

    rmse: float
    mae: float


@dataclass(frozen=True)
class Value:
    """A parameter that was found: value, 95 % interval, unit, and what the nominal model has."""

    value: float
    low: float
    high: float
    unit: str
    nominal: float


@dataclass(frozen=True)
class NamedCause:
    """A cause in the verdict.

    Attributes:
        name, sentence, joint: what it is and where.
        share: of the nominal gap's excess over the noise, beyond what re-tuning within the tolerance closes.
        confidence: how often, over resampled data, it was the best of all causes; less by what stays unexplained
            beside what it removes, since an unknown cause that leaves that much may also be what made it look good.
        parameters: by path.
        gain: error that it removes, as a share of the error without it; cross-validated on the data that chose it.
        kind: ``effect`` that the model lacks, wrong ``number`` of the model, or error of the ``data``.
        picture: which picture shows it.
    """

    name: str
    sentence: str
    joint: str
    share: float
    confidence: float
    parameters: dict[str, Value]
    gain: float
    kind: str
    picture: str = ""
    rivals: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class JointDiagnosis:
    """What was found about one joint.

    Attributes:
        gap: error of each model on the test part, by ``nominal``, ``retuned``, ``extended``, ``noise_floor``.
        values: of all parameters of the extended model, by path; a ``*`` marks a factor.
        simulated: channels of the models over the whole problem, by model name (n, 4).
        structure: what is left of the position error that is not noise.
        retuned: numbers of the nominal model that moved within their tolerance, as factors.
    """

    joint: str
    verdict: str
    sentence: str
    signal: str
    unit: str
    gap: dict[str, Error]
    causes: tuple[NamedCause, ...]
    unexplained: float
    rivals: tuple[dict[str, Any], ...]
    experiment: Experiment | None
    findings: tuple[Finding, ...]
    values: dict[str, float] = field(default_factory=dict)
    retuned: dict[str, float] = field(default_factory=dict)
    problem: Problem | None = None
    search: Search | None = None
    simulated: dict[str, np.ndarray] = field(default_factory=dict)
    structure: Structure | None = None


def verdict_of(
    joint: str,
    causes: Sequence[NamedCause],
    errors: Mapping[str, Error],
    base: Error,
    left: float,
    rest: Structure,
    whole: bool,
) -> tuple[str, str]:
    """Verdict and sentence.

    Args:
        joint: its name.
        causes: largest share first.
        errors: of the models on the test part.
        base: error of the nominal model there, re-tuned within its tolerance.
        left: share of the gap that stays.
        rest: what is left that is not noise.
        whole: whether the test part is whole runs, not pieces of runs that were fitted elsewhere.
    """
    before, after = (fine(errors[key].rmse, rest.unit) for key in ("nominal", "extended"))
    floor = fine(errors["noise_floor"].rmse, rest.unit, 2)
    if not causes and not rest.noticed:
        return NOTHING, (
            f"Nothing to explain: the simulation of '{joint}' is within {after} of the measurement, whose "
            f"noise is {floor} ({before} before its numbers were re-tuned within their tolerance)."
        )
    if not causes:
        return NOT_IDENTIFIABLE, (
            f"The simulation of '{joint}' is {before} off and {after} after re-tuning, and no known "
            f"cause explains that on runs it was not fitted to. {rest.sentence}"
        )
    names = listed([cause.name for cause in causes])
    seen = "runs" if whole else "pieces of the runs"
    tuned = f" ({fine(base.rmse, rest.unit)} with its numbers re-tuned within their tolerance)"
    change = f"from {before}{tuned} to {after} on {seen} that nothing was fitted to (noise {floor})"
    doubtful = [cause for cause in causes if cause.rivals and cause.confidence < UNSURE]
    if doubtful and (doubtful[0] is causes[0] or not rest.noticed):
        others = ", ".join(doubtful[0].rivals)
        place = f" in place of {doubtful[0].name}" if len(causes) > 1 else ""
        return NOT_IDENTIFIABLE, (
            f"The gap of '{joint}' may be {names}, but the data fit {others}{place} about as well: the error falls "
            f"{change}."
        )
    removed = (base.rmse**2 - errors["extended"].rmse ** 2) / max(base.rmse**2, 1e-24)
    if rest.noticed and removed < FEEBLE:
        return NOT_IDENTIFIABLE, (
            f"What the simulation of '{joint}' gets wrong is hardly in the catalogue. With {names} the error "
            f"falls only {change}. {rest.sentence}"
        )
    sure = all(cause.confidence >= UNSURE for cause in causes)
    if not rest.noticed or (left <= NEGLIGIBLE and sure and rest.level <= 1.0):
        close = f" {_also(causes)}" if any(cause.rivals for cause in causes) else ""
        return EXPLAINED, f"The gap of '{joint}' is explained by {names}: the error falls {change}.{close}"
    doubt = "" if sure else ", if that is the cause at all"
    return PARTLY, (
        f"The gap of '{joint}' is partly explained by {names}{doubt}: the error falls {change}; {100 * left:.0f} % of "
        f"it stays. {rest.sentence}"
    )


def _also(causes: Sequence[NamedCause]) -> str:
    """What else the data would allow."""
    pairs = [f"{' or '.join(cause.rivals)} in place of {cause.name}" for cause in causes if cause.rivals]
    return f"Less likely, but not excluded: {', '.join(pairs)}."


DATA_UNITS = {"sensor.delay": "s", "sensor.scale": "1", "sensor.offset": "rad"}


def data_causes(findings: Sequence[Finding], joint: str) -> list[NamedCause]:
    """Errors of the log itself. They stand apart from the position gap, so they have no share of it."""
    named = []
    for f in findings:
        if not f.data_error:
            continue
        values = {}
        if f.value is not None:
            low, high = (float(f.value if bound is None else bound) for bound in (f.low, f.high))
            values[f.column or joint] = Value(
                float(f.value), low, high, DATA_UNITS.get(f.cause or "", ""), 1.0 if f.cause == "sensor.scale" else 0.0
            )
        confidence = 0.95 if f.severity != "note" else 0.5
        named.append(NamedCause(f.cause or f.code, f.sentence, joint, 0.0, confidence, values, 0.0, "data"))
    return named


def with_data_errors(found: JointDiagnosis) -> JointDiagnosis:
    """The diagnosis, with the errors of the log named before any physics."""
    faults = [cause for cause in found.causes if cause.kind == "data"]
    if not faults or found.unit != "rad":  # a log of torques says it itself
        return found
    columns = (f"{found.joint}.goal", f"{found.joint}.position")
    replayed = any(finding.data_error and finding.column in columns for finding in found.findings)
    verdict = EXPLAINED if found.verdict == NOTHING and replayed else found.verdict
    sentence = f"The log is wrong: {' '.join(cause.sentence for cause in faults)} Beside that: {found.sentence}"
    return dataclasses.replace(found, verdict=verdict, sentence=sentence)
