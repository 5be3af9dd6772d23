"""What a diagnosis says, as typed data: verdict, causes, data errors, and the diagnosis of one joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from ..experiment import DetectionLimit, Experiment
from ..log.finding import Finding, Severity
from ..measure.case import Case
from ..measure.measured import Measured
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


NOTHING_MEASURED = Measured()


@dataclass(frozen=True, eq=False)
class JointDiagnosis:
    """What was found about one joint: its case, what was sought and measured, and what is said of it.

    What its parts have is its own, too: ``joint``, ``signal`` and ``findings`` of the case, ``gap``, ``causes`` and
    ``values`` of what was measured, ``verdict``, ``sentence`` and ``reasons`` of what is said.

    Attributes:
        case: what is known of the joint, whatever is found of it.
        said: verdict, sentence and reasons.
        measured: errors, causes, and what is left.
        search: that was made; None where none was, or where it was read from a folder.
        data_errors: faults of the log, mended before the fit where that is possible.
        experiment: next one; None where nothing is open, or none would help.
        limits: where nothing was found, up to where each cause would not show.
    """

    case: Case
    said: Verdict
    measured: Measured = NOTHING_MEASURED
    search: Search | None = None
    data_errors: tuple[DataError, ...] = ()
    experiment: Experiment | None = None
    limits: tuple[DetectionLimit, ...] = ()

    @classmethod
    def of(cls, **attributes: Any) -> JointDiagnosis:
        """A diagnosis from its attributes, whichever part has them."""
        return cls(Case(""), Verdict("", "")).changed(**attributes)

    def changed(self, **attributes: Any) -> JointDiagnosis:
        """The diagnosis with some of its attributes set, whichever part has them.

        Raises:
            TypeError: there is no such attribute.
        """
        if "verdict" in attributes:
            attributes["name"] = attributes.pop("verdict")
        parts: dict[str, Any] = {}
        for key in ("case", "said", "measured"):
            part = attributes.pop(key, getattr(self, key))
            names = {item.name for item in fields(part)} & set(attributes)
            parts[key] = replace(part, **{name: attributes.pop(name) for name in names})
        return replace(self, **parts, **attributes)

    @property
    def joint(self) -> str:
        """Name of the joint, or ``ground``, or that of the whole robot."""
        return self.case.joint

    @property
    def signal(self) -> str:
        """That is judged, as ``servo.position``."""
        return self.case.signal

    @property
    def unit(self) -> str:
        """Of the signal."""
        return self.case.unit

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings about the log of the joint, and about its search."""
        return self.case.findings

    @property
    def frames(self) -> Mapping[str, Any] | None:
        """Of a robot's joints, as given by the sidecar or taken, in the form of its ``meta.frames``."""
        return self.case.frames

    @property
    def problem(self) -> Problem | None:
        """The replay of all data; None where there is none."""
        return None if self.case.replay is None else self.case.replay.problem

    @property
    def verdict(self) -> str:
        """One of the five verdicts."""
        return self.said.name

    @property
    def sentence(self) -> str:
        """What, how much and how sure."""
        return self.said.sentence

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """The numbers behind it, the most important first."""
        return self.said.reasons

    @property
    def gap(self) -> Mapping[str, Error]:
        """Error of each model on the test part."""
        return self.measured.gap

    @property
    def causes(self) -> tuple[NamedCause, ...]:
        """That are named, largest share first."""
        return self.measured.causes

    @property
    def open_causes(self) -> tuple[OpenCause, ...]:
        """That are not named: withdrawn ones, and near misses with what they lack."""
        return self.measured.open_causes

    @property
    def unexplained(self) -> float:
        """Share of the nominal model's mean squared error beyond the noise that stays."""
        return self.measured.unexplained

    @property
    def tuned_share(self) -> float:
        """Share of it that the final model owes to its tuned numbers."""
        return self.measured.tuned_share

    @property
    def shared_share(self) -> float:
        """Share of it that the final model owes to what all joints share."""
        return sum(self.measured.shared_shares.values())

    @property
    def shared_shares(self) -> Mapping[str, float]:
        """The same by cause."""
        return self.measured.shared_shares

    @property
    def shared(self) -> Mapping[str, str]:
        """Causes of all joints, by the number of this joint's chain that each of them changes."""
        return self.measured.shared

    @property
    def values(self) -> Mapping[str, float]:
        """Of all parameters of the extended model, by path; a ``*`` marks a factor."""
        return self.measured.values

    @property
    def tuned(self) -> Mapping[str, float]:
        """Numbers of the nominal model that moved, as factors."""
        return self.measured.tuned

    @property
    def simulated(self) -> Mapping[str, np.ndarray]:
        """Channels of the models over the whole problem, by model name (n, 4)."""
        return self.measured.simulated

    @property
    def structure(self) -> Structure | None:
        """What is left of the error that is not noise."""
        return self.measured.structure

    @property
    def model(self) -> str:
        """Which model is handed over as the extended one: ``extended``, ``refitted`` or ``nominal``."""
        return self.measured.model

    @property
    def rivals(self) -> tuple[dict[str, Any], ...]:
        """Rivals of named causes, by the cause that they might stand in for."""
        return rivals_of(self.causes)

    @property
    def refitted(self) -> bool:
        """Whether numbers of the model were refitted beside the causes, some beyond their tolerance."""
        return self.said.because(BESIDE)

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
