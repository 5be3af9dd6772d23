"""What a diagnosis says, as typed data: verdict, causes, data errors, and the diagnosis of one joint."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Generic, TypeVar

from ..experiment import DetectionLimit, Experiment
from ..log.finding import Finding, Severity
from ..measure.case import Case
from ..measure.confidence import Thresholds
from ..measure.measured import Measured
from ..measure.named import CERTAIN, LIKELY, NamedCause, OpenCause, Value
from ..replay.problem import Problem
from ..search.result import Search
from ..search.settings import DEFAULT, SearchSettings
from ..search.structure import Structure, fine, listed, told_in

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


T = TypeVar("T")


class Of(Generic[T]):
    """An attribute of a part of a diagnosis, as the diagnosis' own; the part tells what it is."""

    def __init__(self, read: Callable[[JointDiagnosis], T]) -> None:
        self._read = read

    def __get__(self, found: JointDiagnosis, kind: type | None = None) -> T:
        return self._read(found)


@dataclass(frozen=True, eq=False)
class JointDiagnosis:
    """What was found about one joint: its case, what was sought and measured, and what is said of it.

    What its parts have is its own, too: ``joint``, ``signal``, ``unit``, ``findings`` and ``frames`` of the case,
    ``verdict`` (its name), ``sentence`` and ``reasons`` of what is said, all others of what was measured.

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

    joint = Of(lambda found: found.case.joint)
    signal = Of(lambda found: found.case.signal)
    unit = Of(lambda found: found.case.unit)
    findings = Of(lambda found: found.case.findings)
    frames = Of(lambda found: found.case.frames)
    verdict = Of(lambda found: found.said.name)
    sentence = Of(lambda found: found.said.sentence)
    reasons = Of(lambda found: found.said.reasons)
    gap = Of(lambda found: found.measured.gap)
    causes = Of(lambda found: found.measured.causes)
    open_causes = Of(lambda found: found.measured.open_causes)
    unexplained = Of(lambda found: found.measured.unexplained)
    tuned_share = Of(lambda found: found.measured.tuned_share)
    shared_shares = Of(lambda found: found.measured.shared_shares)
    shared = Of(lambda found: found.measured.shared)
    values = Of(lambda found: found.measured.values)
    tuned = Of(lambda found: found.measured.tuned)
    simulated = Of(lambda found: found.measured.simulated)
    structure = Of(lambda found: found.measured.structure)
    model = Of(lambda found: found.measured.model)

    @property
    def problem(self) -> Problem | None:
        """The replay of all data; None where there is none."""
        return None if self.case.replay is None else self.case.replay.problem

    @property
    def shared_share(self) -> float:
        """Share of the gap that the final model owes to what all joints share."""
        return sum(self.shared_shares.values())

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


# --- what a verdict is decided on -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Replayed:
    """Evidence of a replay and a search.

    Attributes:
        case: the joint.
        measured: errors, causes, and what is left.
        data_errors: faults of the log.
        beyond: the test part goes further than what was fitted, and errs there.
        blind_to: causes that the motion would hardly show; asked only where nothing was found.
        limits: up to where each cause would not show; asked only where nothing was found.
        factors: by which the tuned numbers differ from the nominal ones, by number, the most telling first.
    """

    case: Case
    measured: Measured
    data_errors: Sequence[DataError] = ()
    beyond: Finding | None = None
    blind_to: Sequence[str] = ()
    limits: Sequence[DetectionLimit] = ()
    factors: Mapping[str, float] = field(default_factory=dict)

    @property
    def joint(self) -> str:
        """Its name."""
        return self.case.joint

    @property
    def causes(self) -> Sequence[NamedCause]:
        """That the search named, largest share first, with confidence and rivals."""
        return self.measured.causes

    @property
    def structure(self) -> Structure:
        """What is left that is not noise."""
        assert self.measured.structure is not None
        return self.measured.structure

    @property
    def fault_in_replay(self) -> bool:
        """Whether a fault of the log is in a column that the replay takes or is judged by."""
        columns = (f"{self.joint}.goal", f"{self.joint}.position")
        return self.case.unit == "rad" and any(error.column in columns for error in self.data_errors)


@dataclass(frozen=True)
class Refused:
    """Why a log or a joint cannot be judged.

    Attributes:
        subject: in a sentence: ``'knee'``, ``the ground``.
        reason: a sentence or more.
        usable: whether the log as such is sound, and only what is asked of it is missing.
    """

    subject: str
    reason: str
    usable: bool = False


Evidence = Replayed | Refused

# --- how a verdict is said: sizes, falls, names and certainty, each in a few words -----------------------------------

TOLD_SHARE = 0.2
"""Share of the gap, or of what causes explain of it, from which what is only possible or unexplained is told."""


def levels(found: Replayed) -> tuple[str, str, str]:
    """Error before, after, and noise, as text."""
    unit = found.structure.unit
    before, after = (size(found.measured.gap[key].rmse, unit) for key in ("nominal", "extended"))
    return before, after, fine(found.measured.gap["noise_floor"].rmse, unit, 2)


def change(found: Replayed) -> str:
    before, after, floor = levels(found)
    seen = "runs" if found.measured.whole_runs else "pieces of the runs"
    how = "refitted" if found.measured.beside else "tuned within their tolerance"
    tuned = f" ({size(found.measured.tuned_error.rmse, found.structure.unit)} with its numbers {how})"
    return f"from {before}{tuned} to {after} on {seen} that nothing was fitted to (noise {floor})"


def fall(found: Replayed) -> str:
    """``24.1 to 0.6 mrad``."""
    before, after, _ = levels(found)
    return f"{before.partition(' ')[0]} to {after}"


def size(value: float, unit: str) -> str:
    """A size above zero, which rounding never makes zero."""
    told = told_in(unit)[0] * value
    return fine(value, unit, next((digits for digits in range(1, 6) if round(told, digits) > 0.0), 6))


def certainty(causes: Sequence[NamedCause]) -> str:
    """Of one cause its confidence; of several the least and the largest."""
    told = sorted(int(100 * min(cause.confidence, 0.99) + 1e-9) for cause in causes)
    low, high = told[0], told[-1]
    return f"confidence {low} %" if low == high else f"confidence {low} to {high} %"


def firmly(causes: Sequence[NamedCause]) -> tuple[Sequence[NamedCause], str]:
    """The causes that a sentence is about, and what it adds of those that are only possible beside them: these are left
    out where the others do nearly all.
    """
    firm = [cause for cause in causes if cause.standing in (CERTAIN, LIKELY)]
    doubted = [cause for cause in causes if cause not in firm]
    if not (firm and doubted) or sum(c.share for c in doubted) > TOLD_SHARE * sum(c.share for c in causes):
        return causes, ""
    return firm, f"; perhaps {subject(doubted)}"


def is_guess(causes: Sequence[NamedCause], limit: Thresholds) -> bool:
    """Whether the largest cause is a guess, and no other is more likely than not."""
    return causes[0].confidence < limit.guessed and not any(cause.standing in (CERTAIN, LIKELY) for cause in causes)


def subject(causes: Sequence[NamedCause]) -> str:
    return some([cause.name for cause in causes])


def some(names: Sequence[str]) -> str:
    """At most two names, else the first and how many more."""
    return listed(names) if len(names) <= 2 else f"{names[0]} and {len(names) - 1} more"


def verb(causes: Sequence[NamedCause], one: str, several: str) -> str:
    return one if len(causes) == 1 else several


def open_reason(cause: OpenCause) -> Reason:
    """Why a cause is not named."""
    return Reason(cause.standing, f"{cause.standing.capitalize()}, {cause.name}: {cause.sentence}.")


def also(causes: Sequence[NamedCause]) -> str:
    """What else the data would allow."""
    pairs = [f"{' or '.join(cause.rivals)} in place of {cause.name}" for cause in causes if cause.rivals]
    return f"Less likely, but not excluded: {', '.join(pairs)}."


DELAY = "delay.seconds"


def recording_reasons(
    causes: Sequence[NamedCause], findings: Sequence[Finding], settings: SearchSettings = DEFAULT
) -> tuple[Reason, ...]:
    """Reasons to doubt the log rather than the machine, for delays that were found."""
    reasons = []
    for cause in causes:
        delay = cause.parameters.get(DELAY)
        if delay is None:
            continue
        more = delay.value - delay.nominal
        if more < 0.0:
            said = (
                f"A delay of {1e3 * delay.value:.3g} ms, shorter than the {1e3 * delay.nominal:.3g} ms believed, is "
                "also what a log shows whose rows are stamped before they are read: readings are then newer than "
                "their stamps."
            )
            reasons.append(Reason("stamps", said))
        knots = next((f for f in findings if f.code == "goal.knots" and f.joint == cause.joint and f.value), None)
        if knots is not None and knots.value and abs(more / knots.value - 1.0) < settings.goal_knots:
            said = (
                f"The {1e3 * more:.3g} ms that were found beyond the believed delay are half of the time between two "
                "goals of this log, which are joined by straight lines: if they were held on the machine, the log was "
                "interpolated and there is no delay."
            )
            reasons.append(Reason("interpolated", said))
    return tuple(reasons)
