"""The one place that decides what is said: from evidence to verdict, without looking at any data.

Evidence comes in three kinds: of a replay and search, of a torque balance, and a refusal. The rules of a replay, in
the order in which they apply:

1. no cause, no structure in the residual: nothing to explain; not identifiable where the motion would hide causes;
2. no cause, but structure: not identifiable;
3. a near miss beside a cause of low confidence: not identifiable (the largest cause, or no structure is left);
4. structure is left and the causes remove little: not identifiable;
5. no structure is left, or little beside certain causes: explained; else partly explained;
6. in either case, a joint that hardly moves: not identifiable.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..log.finding import Finding
from ..search.structure import Structure, fine, listed
from .verdict import (
    EXPLAINED,
    NOT_IDENTIFIABLE,
    NOTHING,
    PARTLY,
    UNUSABLE,
    WORST_FIRST,
    DataError,
    Error,
    NamedCause,
    Reason,
    Verdict,
)

MOST_WORDS = 25  # of the sentence that a verdict is told in


@dataclass(frozen=True)
class Thresholds:
    """What the decision compares with.

    Attributes:
        negligible: most unexplained share of the gap that still counts as explained while structure is noticed; its
            causes must be certain, and the structure no larger than the noise.
        feeble: least share of the mean squared error of the tuned model that causes must remove beside structure.
        sure: least confidence of a cause that is named alone.
        torque_explained: most unexplained share of a torque gap that counts as explained by a shift.
        torque_nothing: most unexplained share of it, without a shift, that counts as nothing to explain.
    """

    negligible: float = 0.03
    feeble: float = 0.3
    sure: float = 0.6
    torque_explained: float = 0.15
    torque_nothing: float = 0.05


THRESHOLDS = Thresholds()


@dataclass(frozen=True)
class Replayed:
    """Evidence of a replay and a search.

    Attributes:
        joint: its name.
        errors: of the models on the test part, as :attr:`JointDiagnosis.gap`.
        tuned: error there of the nominal model with its numbers tuned within their tolerance.
        causes: that the search named, largest share first, with confidence and near misses.
        left: share of the nominal mean squared error beyond the noise that stays on the test part.
        structure: what is left that is not noise.
        whole_runs: whether the test part is whole runs, not pieces of runs that were fitted elsewhere.
        still: whether the joint hardly moves in any run.
        blind_to: causes that the motion would hardly show; asked only where nothing was found.
        beyond: the test part goes further than what was fitted, and errs there.
        data_errors: faults of the log.
        fault_in_replay: whether one of them was in a column that the replay takes or is judged by.
    """

    joint: str
    errors: Mapping[str, Error]
    tuned: Error
    causes: Sequence[NamedCause]
    left: float
    structure: Structure
    whole_runs: bool = True
    still: bool = False
    blind_to: Sequence[str] = ()
    beyond: Finding | None = None
    data_errors: Sequence[DataError] = ()
    fault_in_replay: bool = False


@dataclass(frozen=True)
class Balanced:
    """Evidence of a torque balance: errors of the torque on the test blocks, the shift if any, and what stays."""

    joint: str
    errors: Mapping[str, Error]
    causes: Sequence[NamedCause]
    left: float


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


Evidence = Replayed | Balanced | Refused


def decide(evidence: Evidence, limit: Thresholds = THRESHOLDS) -> Verdict:
    """The verdict that the evidence supports."""
    match evidence:
        case Refused():
            return _refused(evidence)
        case Balanced():
            return _balanced(evidence, limit)
        case Replayed():
            return _replayed(evidence, limit)


def confidence(win_rate: float, removed: float, residual: float) -> float:
    """Win rate x removed / (removed + residual structure), both as loss per value.

    An unknown cause that leaves that much may also be what made this one look good.
    """
    return win_rate * removed / (removed + residual) if removed > 0.0 else 0.0


def overall(verdicts: Sequence[str]) -> int:
    """Which of several joints speaks for the machine: the one that is understood worst."""
    return min(range(len(verdicts)), key=lambda k: WORST_FIRST.index(verdicts[k]))


# --- replay and search -------------------------------------------------------------------------------------------


def _replayed(found: Replayed, limit: Thresholds) -> Verdict:
    if found.causes:
        verdict = _with_causes(found, limit)
    elif found.structure.noticed:
        verdict = _unknown_cause(found)
    else:
        verdict = _nothing(found)
    reasons = verdict.reasons
    if found.data_errors:
        said = " ".join(error.sentence for error in found.data_errors)
        reasons = (Reason("data", f"The log is wrong: {said}"), *reasons)
    if found.beyond is not None and (verdict.name == PARTLY or _open(verdict)):
        reasons = (*reasons, Reason("beyond", found.beyond.sentence))
    return Verdict(verdict.name, verdict.sentence, reasons)


def _open(verdict: Verdict) -> bool:
    return verdict.name == NOT_IDENTIFIABLE and not verdict.because("blind")


def _nothing(found: Replayed) -> Verdict:
    before, after, floor = _levels(found)
    agreement = Reason(
        "agrees",
        f"The simulation of '{found.joint}' is within {after} of the measurement, whose noise is {floor} ({before} "
        "before its numbers were tuned within their tolerance).",
    )
    if found.blind_to:
        hidden = ", ".join(found.blind_to)
        sentence = (
            f"The simulation of '{found.joint}' is within {after} of the measurement, but the motion would hide "
            f"{_some(found.blind_to)}."
        )
        return Verdict(
            NOT_IDENTIFIABLE,
            sentence,
            (agreement, Reason("blind", f"But the motion is so poor that it would hardly show {hidden}.")),
        )
    if found.fault_in_replay:
        sentence = (
            f"Errors of the log explain the gap of '{found.joint}': once mended, the simulation is within {after} "
            f"(noise {floor})."
        )
        return Verdict(EXPLAINED, sentence, (agreement,))
    sentence = (
        f"Nothing to explain: the simulation of '{found.joint}' is within {after} of the measurement, whose noise is "
        f"{floor}."
    )
    return Verdict(NOTHING, sentence, (agreement,))


def _unknown_cause(found: Replayed) -> Verdict:
    before, after, floor = _levels(found)
    sentence = f"No known cause explains the gap of '{found.joint}': {before}, {after} when tuned (noise {floor})."
    why = Reason(
        "unknown",
        f"The simulation of '{found.joint}' is {before} off and {after} with its numbers tuned within their tolerance, "
        "and no known cause explains that on runs it was not fitted to.",
    )
    return Verdict(NOT_IDENTIFIABLE, sentence, (why, Reason("structure", found.structure.sentence)))


def _with_causes(found: Replayed, limit: Thresholds) -> Verdict:
    causes, rest = found.causes, found.structure
    doubtful = [cause for cause in causes if cause.rivals and cause.confidence < limit.sure]
    if doubtful and (doubtful[0] is causes[0] or not rest.noticed):
        return _rivalled(found, doubtful[0])
    removed = (found.tuned.rmse**2 - found.errors["extended"].rmse ** 2) / max(found.tuned.rmse**2, 1e-24)
    if rest.noticed and removed < limit.feeble:
        return _feeble(found)
    sure = all(cause.confidence >= limit.sure for cause in causes)
    explained = not rest.noticed or (found.left <= limit.negligible and sure and rest.level <= 1.0)
    verdict = _explained(found) if explained else _partly(found, sure)
    if not found.still:
        return verdict
    sentence = (
        f"{_subject(causes)} may explain the gap of '{found.joint}', but the joint hardly moves: other causes may do "
        "as well."
    )
    still = Reason("still", "But the joint hardly moves, so other causes may do as well.")
    return Verdict(NOT_IDENTIFIABLE, sentence, (*verdict.reasons, still))


def _rivalled(found: Replayed, doubtful: NamedCause) -> Verdict:
    others = ", ".join(doubtful.rivals)
    place = f" in place of {doubtful.name}" if len(found.causes) > 1 else ""
    sentence = (
        f"The gap of '{found.joint}' may be {_subject(found.causes)}, but {_some(doubtful.rivals)} "
        f"{'fits' if len(doubtful.rivals) == 1 else 'fit'} about as well ({_certainty([doubtful])})."
    )
    return Verdict(
        NOT_IDENTIFIABLE,
        sentence,
        (Reason("near miss", f"The data fit {others}{place} about as well. The error falls {_change(found)}."),),
    )


def _feeble(found: Replayed) -> Verdict:
    sentence = (
        f"{_subject(found.causes)} {_verb(found.causes, 'removes', 'remove')} little of the gap of '{found.joint}': "
        f"error {_fall(found)}; the rest has no known cause."
    )
    why = f"With {listed([cause.name for cause in found.causes])} the error falls only {_change(found)}."
    return Verdict(NOT_IDENTIFIABLE, sentence, (Reason("feeble", why), Reason("structure", found.structure.sentence)))


def _explained(found: Replayed) -> Verdict:
    causes = found.causes
    sentence = (
        f"{_subject(causes)} {_verb(causes, 'explains', 'explain')} the gap of '{found.joint}': error {_fall(found)}, "
        f"{_certainty(causes)}."
    )
    names = listed([cause.name for cause in causes])
    reasons = [Reason("error", f"With {names} the error falls {_change(found)}.")]
    if any(cause.rivals for cause in causes):
        reasons.append(Reason("near miss", _also(causes)))
    return Verdict(EXPLAINED, sentence, tuple(reasons))


def _partly(found: Replayed, sure: bool) -> Verdict:
    """What stays is told by its size, which is never zero where structure is noticed."""
    causes, rest = found.causes, found.structure
    sentence = (
        f"{_subject(causes)} {_verb(causes, 'explains', 'explain')} part of the gap of '{found.joint}': error "
        f"{_fall(found)}, {_size(rest.rms, rest.unit)} unexplained, {_certainty(causes)}."
    )
    doubt = "" if sure else f", if {'that is the cause' if len(causes) == 1 else 'those are the causes'} at all"
    names = listed([cause.name for cause in causes])
    return Verdict(
        PARTLY,
        sentence,
        (
            Reason("error", f"With {names} the error falls {_change(found)}{doubt}."),
            Reason("structure", rest.sentence),
        ),
    )


# --- torque balance, refusal -------------------------------------------------------------------------------------


def _balanced(found: Balanced, limit: Thresholds) -> Verdict:
    before, refitted, after = (found.errors[key].rmse for key in ("nominal", "refitted", "extended"))
    change = Reason(
        "error",
        f"The torque that the motion needs differs from the logged one by {before:.2f} N.m with the sidecar's numbers, "
        f"{refitted:.2f} N.m refitted, {after:.2f} N.m with the shift (held-out blocks).",
    )
    if found.causes:
        shift = found.causes[0]
        name = EXPLAINED if found.left < limit.torque_explained else PARTLY
        value = next(iter(shift.parameters.values()))
        sentence = (
            f"The torque column is {1e3 * value.value:.0f} ms out of step: torque error {before:.2f} to {after:.2f} "
            f"N.m, {_certainty(found.causes)}."
        )
        return Verdict(name, sentence, (Reason("shift", shift.sentence), change))
    name = NOTHING if found.left < limit.torque_nothing else PARTLY
    sentence = (
        f"Refitted inertia, gravity and friction leave no shift between torque and motion: torque error {before:.2f} "
        f"to {after:.2f} N.m."
    )
    return Verdict(name, sentence, (change,))


def _refused(found: Refused) -> Verdict:
    name = NOT_IDENTIFIABLE if found.usable else UNUSABLE
    start = f"Nothing can be said about {found.subject}" if found.usable else "The log cannot be used"
    whole = f"{start}: {found.reason}"
    if len(whole.split()) <= MOST_WORDS:
        return Verdict(name, whole)
    first = f"{start}: {found.reason.partition('; ')[0].partition('. ')[0].rstrip('.')}."
    sentence = first if len(first.split()) <= MOST_WORDS else f"{start}; the reason is given below."
    return Verdict(name, sentence, (Reason("refused", found.reason),))


# --- words -------------------------------------------------------------------------------------------------------


def _levels(found: Replayed) -> tuple[str, str, str]:
    """Error before, after, and noise, as text."""
    unit = found.structure.unit
    before, after = (_size(found.errors[key].rmse, unit) for key in ("nominal", "extended"))
    return before, after, fine(found.errors["noise_floor"].rmse, unit, 2)


def _change(found: Replayed) -> str:
    before, after, floor = _levels(found)
    seen = "runs" if found.whole_runs else "pieces of the runs"
    tuned = f" ({_size(found.tuned.rmse, found.structure.unit)} with its numbers tuned within their tolerance)"
    return f"from {before}{tuned} to {after} on {seen} that nothing was fitted to (noise {floor})"


def _fall(found: Replayed) -> str:
    """``24.1 to 0.6 mrad``."""
    before, after, _ = _levels(found)
    return f"{before.partition(' ')[0]} to {after}"


def _size(value: float, unit: str) -> str:
    """A size above zero, which rounding never makes zero."""
    return fine(value, unit, next((digits for digits in range(1, 6) if round(1e3 * value, digits) > 0.0), 6))


def _certainty(causes: Sequence[NamedCause]) -> str:
    least = min(cause.confidence for cause in causes)
    return f"confidence {'at least ' if len(causes) > 1 else ''}{int(100 * min(least, 0.99) + 1e-9)} %"


def _subject(causes: Sequence[NamedCause]) -> str:
    return _some([cause.name for cause in causes])


def _some(names: Sequence[str]) -> str:
    """At most two names, else the first and how many more."""
    return listed(names) if len(names) <= 2 else f"{names[0]} and {len(names) - 1} more"


def _verb(causes: Sequence[NamedCause], one: str, several: str) -> str:
    return one if len(causes) == 1 else several


def _also(causes: Sequence[NamedCause]) -> str:
    """What else the data would allow."""
    pairs = [f"{' or '.join(cause.rivals)} in place of {cause.name}" for cause in causes if cause.rivals]
    return f"Less likely, but not excluded: {', '.join(pairs)}."
