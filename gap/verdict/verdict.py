"""What a diagnosis says, as typed data: verdict, causes, data errors, and the diagnosis of one joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..experiment import DetectionLimit, Experiment
from ..log.finding import Finding, Severity
from ..measure.named import Error, NamedCause, OpenCause, Value
from ..replay.problem import Problem
from ..search.result import Search
from ..search.structure import Structure

EXPLAINED, PARTLY, NOTHING, NOT_IDENTIFIABLE, UNUSABLE = (
    "explained",
    "partly explained",
    "nothing to explain",
    "not identifiable",
    "unusable log",
)
BESIDE = "beside"
"""Code of the reason that names numbers which were refitted beside the causes."""
WORST_FIRST = (UNUSABLE, NOT_IDENTIFIABLE, PARTLY, EXPLAINED, NOTHING)


@dataclass(frozen=True)
class DataError:
    """A fault of the log itself. It is no cause of the gap: it has no share of it.

    Attributes:
        name: entry of the catalogue that it is (``sensor.scale``), else the code of the check that found it.
        code: of the check.
        sentence: for people, with numbers and what to do.
        severity: as of the finding.
        joint, column: where; column None for several.
        values: what was measured of it, by column.
    """

    name: str
    code: str
    sentence: str
    severity: Severity
    joint: str
    column: str | None = None
    values: dict[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class Reason:
    """Why a verdict is what it is: a stable code, and a sentence with the numbers."""

    code: str
    sentence: str


@dataclass(frozen=True)
class Verdict:
    """One of the five verdicts.

    Attributes:
        name: :data:`EXPLAINED`, :data:`PARTLY`, :data:`NOTHING`, :data:`NOT_IDENTIFIABLE` or :data:`UNUSABLE`.
        sentence: what, how much and how sure, in at most 25 words.
        reasons: the numbers behind it, the most important first.
    """

    name: str
    sentence: str
    reasons: tuple[Reason, ...] = ()

    def because(self, *codes: str) -> bool:
        """Whether one of these reasons is among its own."""
        return any(reason.code in codes for reason in self.reasons)


@dataclass(frozen=True, eq=False)
class JointDiagnosis:
    """What was found about one joint.

    Attributes:
        verdict, sentence, reasons: as of :class:`Verdict`.
        gap: error of each model on the test part, by ``nominal``, ``refitted`` (its own numbers up to fivefold, nothing
            added), ``extended`` (with the causes), ``noise_floor``.
        causes: largest share first.
        data_errors: faults of the log, mended before the fit where that is possible.
        unexplained: share of the nominal model's mean squared error beyond the noise that stays.
        tuned_share: share of it that the final model owes to its tuned numbers.
        shared_share: of a joint of a robot, the share that what was found of the whole robot takes away.
        shared: causes of all joints, by the number of this joint's chain that each of them changes.
        values: of all parameters of the extended model, by path; a ``*`` marks a factor.
        simulated: channels of the models over the whole problem, by model name (n, 4).
        structure: what is left of the position error that is not noise.
        tuned: numbers of the nominal model that moved within their tolerance, as factors; where ``model`` is
            ``refitted``, up to fivefold.
        open_causes: causes that are not named: withdrawn ones, and near misses with what they lack.
        model: which model is handed over as the extended one: ``extended``, ``refitted`` or ``nominal``.
        limits: where nothing was found, up to where each cause would not show.
        frames: of a robot's joints, as given by the sidecar or taken, in the form of its ``meta.frames``.
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
    tuned: dict[str, float] = field(default_factory=dict)
    problem: Problem | None = None
    search: Search | None = None
    simulated: dict[str, np.ndarray] = field(default_factory=dict)
    structure: Structure | None = None
    reasons: tuple[Reason, ...] = ()
    data_errors: tuple[DataError, ...] = ()
    tuned_share: float = 0.0
    shared_share: float = 0.0
    shared: Mapping[str, str] = field(default_factory=dict)
    open_causes: tuple[OpenCause, ...] = ()
    model: str = "extended"
    limits: tuple[DetectionLimit, ...] = ()
    frames: Mapping[str, Any] | None = None

    @property
    def refitted(self) -> bool:
        """Whether numbers of the model were refitted beside the causes, some beyond their tolerance."""
        return any(reason.code == BESIDE for reason in self.reasons)

    @property
    def text(self) -> str:
        """The sentence and its reasons."""
        return " ".join((self.sentence, *(reason.sentence for reason in self.reasons)))


def rivals_of(causes: Sequence[NamedCause]) -> tuple[dict[str, Any], ...]:
    """Rivals of named causes, by the cause that they might stand in for."""
    return tuple(
        {"of": cause.name, "names": [cause.name, *cause.rivals], "confidence": cause.confidence}
        for cause in causes
        if cause.rivals
    )


DATA_UNITS = {"sensor.delay": "s", "sensor.scale": "1", "sensor.offset": "rad"}


def data_errors(findings: Sequence[Finding], joint: str) -> tuple[DataError, ...]:
    """Faults of the log among findings."""
    errors = []
    for f in findings:
        if not f.data_error:
            continue
        values = {}
        if f.value is not None:
            low, high = (float(f.value if bound is None else bound) for bound in (f.low, f.high))
            values[f.column or joint] = Value(
                float(f.value), low, high, DATA_UNITS.get(f.cause or "", ""), 1.0 if f.cause == "sensor.scale" else 0.0
            )
        errors.append(DataError(f.cause or f.code, f.code, f.sentence, f.severity, joint, f.column, values))
    return tuple(errors)
