"""The one place that decides what is said: from evidence to verdict, without looking at any data.

Evidence comes in three kinds: of a replay and search, of a torque balance, and a refusal. The rules of a replay, in
the order in which they apply:

1. refitted numbers do better on unseen data than all causes: that is the finding, and not identifiable;
2. no cause, no structure in the residual: nothing to explain; not identifiable where the motion would hide causes;
3. no cause, but structure, or causes that unseen data refuted: not identifiable (a joint of a robot at the noise may
   have slight structure, of the bodies beside it, and one that no goal holds what adds up in its replay);
4. no cause is sure, and together they do less than what has no name beside them: that comes first, and not
   identifiable; the same is told first, as partly explained, where causes are sure;
5. a rival beside a cause of low confidence: partly explained where another cause is certain; else not identifiable
   (the largest cause, or no structure is left);
6. structure is left and the causes remove little, or none is more than a guess: not identifiable;
7. no structure is left, or little beside certain causes: explained; else partly explained;
8. in either case, a joint that hardly moves: not identifiable.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..experiment import Experiment
from ..log.finding import Finding
from ..measure.case import ROBOT, Case
from ..measure.confidence import THRESHOLDS, Adrift, Thresholds
from ..measure.measured import Measured
from ..measure.named import CERTAIN, WITHDRAWN, NamedCause, OpenCause
from ..measure.signatures import disagreeing
from ..measure.unseen import first
from ..replay.problem import OF_A_ROBOT, JointProblem, diverged
from ..search.settings import DEFAULT
from ..search.structure import listed
from .verdict import (
    BESIDE,
    EXPLAINED,
    NOT_IDENTIFIABLE,
    NOTHING,
    PARTLY,
    TOLD_SHARE,
    UNUSABLE,
    WORST_FIRST,
    Evidence,
    JointDiagnosis,
    Reason,
    Refused,
    Replayed,
    Verdict,
    also,
    certainty,
    change,
    fall,
    firmly,
    is_guess,
    levels,
    open_reason,
    size,
    some,
    subject,
    verb,
)

MAX_SENTENCE_WORDS = 25  # of the sentence that a verdict is told in


def decide(evidence: Evidence, limit: Thresholds = THRESHOLDS) -> Verdict:
    """The verdict that the evidence supports."""
    match evidence:
        case Refused():
            return _refused(evidence)
        case Replayed():
            return _replayed(evidence, limit)


def overall(verdicts: Sequence[str]) -> int:
    """Which of several joints speaks for the machine: the one that is understood worst."""
    return min(range(len(verdicts)), key=lambda k: WORST_FIRST.index(verdicts[k]))


# --- replay and search -------------------------------------------------------------------------------------------


def _replayed(found: Replayed, limit: Thresholds) -> Verdict:
    measured = found.measured
    withdrawn = [cause for cause in measured.open_causes if cause.standing == WITHDRAWN]
    if measured.turned:
        verdict = _refitted(found)
    elif found.causes:
        verdict = _with_causes(found, limit)
    elif not measured.adds_up(limit) and (not measured.settled(limit) or (found.structure.noticed and withdrawn)):
        verdict = _unknown_cause(found, withdrawn)
    else:
        verdict = _nothing(found, limit)
    reasons = (
        *verdict.reasons,
        *_beside_causes(found),
        *_contradictions(found),
        *(open_reason(cause) for cause in found.measured.open_causes),
    )
    if found.data_errors:
        said = " ".join(error.sentence for error in found.data_errors)
        reasons = (Reason("data", f"The log is wrong: {said}"), *reasons)
    if found.beyond is not None and (verdict.name == PARTLY or _open(verdict)):
        reasons = (*reasons, Reason("beyond", found.beyond.sentence))
    return Verdict(verdict.name, verdict.sentence, reasons)


def _open(verdict: Verdict) -> bool:
    return verdict.name == NOT_IDENTIFIABLE and not verdict.because("blind")


def _nothing(found: Replayed, limit: Thresholds) -> Verdict:
    before, after, floor = levels(found)
    agreement = Reason(
        "agrees",
        f"The simulation of '{found.joint}' is within {after} of the measurement, whose noise is {floor} ({before} "
        f"before its numbers were tuned within their tolerance{_turned(found)}).",
    )
    if found.case.held is not None and found.case.hidden:
        sentence = (
            f"The drive of '{found.joint}' is within {after} of the measurement, but this log cannot show "
            f"{some(found.case.hidden)}."
        )
        hidden = Reason("hidden", f"This log cannot show {', '.join(found.case.hidden)}. {found.case.held.sentence}")
        return Verdict(NOT_IDENTIFIABLE, sentence, (agreement, hidden))
    if found.blind_to:
        hidden = ", ".join(found.blind_to)
        what = "this log cannot show" if found.case.hidden else "the motion would hide"
        sentence = (
            f"The simulation of '{found.joint}' is within {after} of the measurement, but {what} "
            f"{some(found.blind_to)}."
        )
        why = f"But the motion is so poor that it would hardly show {hidden}."
        if found.case.hidden:
            why = f"But the link moves as measured, so this log would hardly show {hidden}: describe the load."
        return Verdict(NOT_IDENTIFIABLE, sentence, (agreement, Reason("blind", why)))
    if found.fault_in_replay:
        sentence = (
            f"Errors of the log explain the gap of '{found.joint}': once mended, the simulation is within {after} "
            f"(noise {floor})."
        )
        return Verdict(EXPLAINED, sentence, (agreement,))
    limits = _noticed(found)
    if found.structure.noticed and found.measured.adrift is not None and found.measured.adds_up(limit):
        limits = (_added_up(found, found.measured.adrift),)
    if found.limits:
        told = "; ".join(one.sentence for one in found.limits)
        limits = (Reason("limits", f"Beside numbers within their tolerance, this log would not show: {told}."), *limits)
    nominal, tuned = found.measured.gap["nominal"].rmse, found.measured.tuned_error.rmse
    if found.factors and nominal**2 > limit.tuned_away * tuned**2:
        sentence = (
            f"Nothing to explain: numbers within their tolerance ({first(list(found.factors.items()), 1)}) bring "
            f"'{found.joint}' within {after} of the measurement (noise {floor})."
        )
        return Verdict(NOTHING, sentence, (agreement, *limits))
    sentence = (
        f"Nothing to explain: the simulation of '{found.joint}' is within {after} of the measurement, whose noise is "
        f"{floor}."
    )
    return Verdict(NOTHING, sentence, (agreement, *limits))


def _turned(found: Replayed) -> str:
    """The tuned numbers that the fit needs most, to follow the word tolerance."""
    turned = [(number, factor) for number, factor in found.factors.items() if abs(factor - 1.0) > DEFAULT.least_change]
    return f": {first(turned)}" if turned else ""


def _added_up(found: Replayed, adrift: Adrift) -> Reason:
    """Why what is left at a joint that nothing holds asks for no cause."""
    left, may, unit = adrift.error, adrift.neighbours, found.structure.unit
    start = "No goal holds the joint, so that small errors add up in its replay"
    if left <= may:
        return Reason(
            "adds_up",
            f"{start}: accelerations of its neighbours that are {100.0 * OF_A_ROBOT:g} % off would leave "
            f"{size(may, unit)}. A cause that does no more than that would not show.",
        )
    return Reason(
        "adds_up",
        f"{start}: begun anew where it fits best, within the noise of the reading, it is {size(left, unit)} off.",
    )


def _refitted(found: Replayed) -> Verdict:
    """The nominal model's own numbers, turned, do better than anything that was named."""
    _, after, floor = levels(found)
    sentence = (
        f"Refitted numbers alone explain more of the gap of '{found.joint}' than any cause: error {fall(found)} on "
        "unseen data."
    )
    why = Reason(
        "refitted",
        f"The model that is handed over is the nominal one with {found.measured.turned}: on data that nothing was "
        f"fitted to it is {after} off (noise {floor}). Which of these numbers is meant is not identifiable.",
    )
    return Verdict(NOT_IDENTIFIABLE, sentence, (why, *_noticed(found)))


def _beside_causes(found: Replayed) -> list[Reason]:
    """That numbers of the nominal model are off by more than their tolerance, too."""
    if not (found.causes and found.measured.beside):
        return []
    said = (
        f"Beside that, numbers of the nominal model are refitted: {found.measured.beside}. Data that no fit saw ask "
        "for it; which of them is wrong is not identifiable."
    )
    return [Reason(BESIDE, said)]


def _contradictions(found: Replayed) -> list[Reason]:
    """Causes that leave a feature of their own where it was."""
    reasons = []
    for cause in found.causes:
        if (seen := disagreeing(cause.signatures)) is not None:
            said = (
                f"{cause.name} does not do what it is named for: {seen.name} is "
                f"{1e3 * seen.extended:+.2g} m{seen.unit} off with it, {1e3 * seen.nominal:+.2g} m{seen.unit} without."
            )
            reasons.append(Reason("signature", said))
    return reasons


def _unknown_cause(found: Replayed, withdrawn: Sequence[OpenCause]) -> Verdict:
    before, after, floor = levels(found)
    if withdrawn:
        names = some([cause.name for cause in withdrawn])
        sentence = f"No cause of the gap of '{found.joint}' holds on unseen data: {names} withdrawn; error {before}."
        return Verdict(NOT_IDENTIFIABLE, sentence, (Reason("structure", found.structure.sentence),))
    sentence = f"No known cause explains the gap of '{found.joint}': {before}, {after} when tuned (noise {floor})."
    if found.measured.gap["extended"].rmse <= THRESHOLDS.at_noise * found.measured.gap["noise_floor"].rmse:
        sentence = (
            f"Tuned numbers bring '{found.joint}' from {before} to {after} (noise {floor}); no known cause explains "
            "the structure that is left."
        )
    why = Reason(
        "unknown",
        f"The simulation of '{found.joint}' is {before} off and {after} with its numbers tuned within their tolerance, "
        "and no known cause explains that on runs it was not fitted to.",
    )
    return Verdict(NOT_IDENTIFIABLE, sentence, (why, Reason("structure", found.structure.sentence)))


def _with_causes(found: Replayed, limit: Thresholds) -> Verdict:
    causes, rest = found.causes, found.structure
    noticed = rest.noticed and not found.measured.only_starts(limit)
    doubtful = [cause for cause in causes if cause.rivals and cause.confidence < limit.sure]
    certain = [cause for cause in causes if cause.standing == CERTAIN]
    if doubtful and certain and not found.case.still:
        return _beside(found, certain, doubtful[0])
    unsure = all(cause.confidence < limit.sure for cause in causes)
    # numbers of single joints are told there, and are no rivals of what the robot has
    numbers = 0.0 if found.case.joint == ROBOT else _numbers(found)
    if unsure and _named(found) < max(numbers, found.measured.left):
        return _outweighed(found)
    if doubtful and (doubtful[0] is causes[0] or not noticed):
        return _rivalled(found, doubtful[0])
    removed = found.measured.removed
    if removed is None:
        tuned, extended = found.measured.tuned_error.rmse, found.measured.gap["extended"].rmse
        removed = (tuned**2 - extended**2) / max(tuned**2, 1e-24)
    if noticed and removed < limit.feeble:
        return _feeble(found)
    if is_guess(causes, limit) and not found.case.still:
        return _guessed(found)
    sure = all(cause.confidence >= limit.sure for cause in causes)
    explained = not noticed or (found.measured.left <= limit.negligible and sure and rest.level <= limit.as_noise)
    verdict = _explained(found) if explained else _partly(found, sure)
    if not found.case.still:
        return verdict
    sentence = (
        f"{subject(causes)} may explain the gap of '{found.joint}', but the joint hardly moves: other causes may do "
        "as well."
    )
    still = Reason("still", "But the joint hardly moves, so other causes may do as well.")
    return Verdict(NOT_IDENTIFIABLE, sentence, (*verdict.reasons, still))


def _falls(found: Replayed, how: str = "", doubt: str = "") -> str:
    names = listed([cause.name for cause in found.causes])
    return f"With {names} the error falls {how}{change(found)}{doubt}."


def _noticed(found: Replayed) -> tuple[Reason, ...]:
    """The structure that is left, where there is any."""
    return (Reason("structure", found.structure.sentence),) if found.structure.noticed else ()


def _rivals(found: Replayed) -> tuple[Reason, ...]:
    """What else the data would allow, where they do."""
    return (Reason("rivals", also(found.causes)),) if any(cause.rivals for cause in found.causes) else ()


def _named(found: Replayed) -> float:
    """Share of the gap that the causes are said to explain."""
    return sum(cause.share for cause in found.causes)


def _numbers(found: Replayed) -> float:
    """Share of the gap that numbers of the model do beside the causes."""
    return 1.0 - found.measured.left - _named(found)


def _beside_numbers(found: Replayed, causes: Sequence[NamedCause]) -> tuple[str, str]:
    """Causes as a subject with its verb, behind the numbers of the model where these do more."""
    if _numbers(found) <= _named(found):
        return subject(causes), verb(causes, "explains", "explain")
    names = subject(causes)
    numbers = "Refitted numbers" if found.measured.beside else "Tuned numbers"
    if found.case.joint == ROBOT:
        numbers = "What single joints have"
    return f"{numbers}{', ' if ' and ' in names else ' and '}{names}", "explain"


def _outweighed(found: Replayed) -> Verdict:
    """What has no name does more than all that has one, and is told before it."""
    numbers = "Refitted numbers" if found.measured.beside else "Tuned numbers"
    what, share = (f"{numbers} explain", _numbers(found))
    if found.measured.left >= share:
        what, share = "No known cause explains", found.measured.left
    sentence = (
        f"{what} {100.0 * share:.0f} % of the gap of '{found.joint}' (error {fall(found)}); "
        f"perhaps {subject(found.causes)} {100.0 * _named(found):.0f} % ({certainty(found.causes)})."
    )
    return Verdict(NOT_IDENTIFIABLE, sentence, (Reason("outweighed", _falls(found)), *_noticed(found), *_rivals(found)))


def _beside(found: Replayed, certain: Sequence[NamedCause], doubtful: NamedCause) -> Verdict:
    """Certain causes, which doubt about another does not touch."""
    others = " or ".join((doubtful.name, *doubtful.rivals[:1]))
    them = "it" if len(certain) == 1 else "them"
    sentence = (
        f"{subject(certain)} {verb(certain, 'is', 'are')} certain at '{found.joint}': error "
        f"{fall(found)}, {certainty(certain)}; beside {them} perhaps {others}."
    )
    return Verdict(PARTLY, sentence, (Reason("error", _falls(found)), *_noticed(found), *_rivals(found)))


def _rivalled(found: Replayed, doubtful: NamedCause) -> Verdict:
    others = ", ".join(doubtful.rivals)
    place = f" in place of {doubtful.name}" if len(found.causes) > 1 else ""
    fits = "fits" if len(doubtful.rivals) == 1 else "fit"
    alike, unexplained = f"{fits} about as well", ""
    if found.structure.noticed and found.measured.left >= TOLD_SHARE:
        alike, unexplained = f"{fits} alike", f"; {100.0 * found.measured.left:.0f} % unexplained"
    sentence = (
        f"The gap of '{found.joint}' may be {subject(found.causes)}, but {some(doubtful.rivals)} "
        f"{alike} ({certainty([doubtful])}){unexplained}."
    )
    why = f"The data fit {others}{place} about as well. The error falls {change(found)}."
    return Verdict(NOT_IDENTIFIABLE, sentence, (Reason("rivals", why), *_noticed(found)))


def _feeble(found: Replayed) -> Verdict:
    sentence = (
        f"{subject(found.causes)} {verb(found.causes, 'removes', 'remove')} little of the gap of '{found.joint}': "
        f"error {fall(found)}; the rest has no known cause."
    )
    return Verdict(NOT_IDENTIFIABLE, sentence, (Reason("feeble", _falls(found, "only ")), *_noticed(found)))


def _guessed(found: Replayed) -> Verdict:
    sentence = (
        f"The gap of '{found.joint}' may come from {subject(found.causes)}, as a guess "
        f"({certainty(found.causes)}): error {fall(found)}."
    )
    why = _falls(found)
    refitted, unit = found.measured.gap["refitted"].rmse, found.structure.unit
    if refitted <= THRESHOLDS.at_noise * found.measured.gap["extended"].rmse:
        why += f" The numbers that the model has, refitted up to fivefold, do as well: {size(refitted, unit)}."
        if any(cause.name.startswith("load.") for cause in found.causes):
            why += " A weaker motor looks like a heavier load: weigh it, or log duty and current, where one is missing."
    return Verdict(NOT_IDENTIFIABLE, sentence, (Reason("guessed", why), *_noticed(found)))


def _explained(found: Replayed) -> Verdict:
    firm, doubted = firmly(found.causes)
    who, does = _beside_numbers(found, firm)
    sentence = f"{who} {does} the gap of '{found.joint}': error {fall(found)}, {certainty(firm)}{doubted}."
    reasons = [Reason("error", _falls(found))]
    if found.structure.noticed and found.measured.adrift is not None and found.measured.only_starts():
        reasons.append(_added_up(found, found.measured.adrift))
    return Verdict(EXPLAINED, sentence, (*reasons, *_rivals(found)))


def _partly(found: Replayed, sure: bool) -> Verdict:
    """What stays is told by its size, which is never zero where structure is noticed."""
    causes, rest, (firm, doubted) = found.causes, found.structure, firmly(found.causes)
    who, does = _beside_numbers(found, firm)
    how_sure = certainty(firm if who == subject(firm) else firm[:1])  # or the sentence gets too long
    sentence = (
        f"{who} partly {does} the gap of '{found.joint}': error {fall(found)}, {size(rest.rms, rest.unit)} "
        f"unexplained, {how_sure}{doubted}."
    )
    if (left := found.measured.left) > max(_named(found), _numbers(found)):
        shares = f"{100.0 * left:.0f} % of the gap of '{found.joint}', {subject(firm)} {100.0 * _named(found):.0f} %"
        sentence = f"No known cause explains {shares}: error {fall(found)}, {certainty(firm)}{doubted}."
    doubt = "" if sure else f", if {'that is the cause' if len(causes) == 1 else 'those are the causes'} at all"
    return Verdict(PARTLY, sentence, (Reason("error", _falls(found, doubt=doubt)), *_noticed(found)))


# --- refusal ------------------------------------------------------------------------------------------------------


def _refused(found: Refused) -> Verdict:
    name = NOT_IDENTIFIABLE if found.usable else UNUSABLE
    start = f"Nothing can be said about {found.subject}" if found.usable else "The log cannot be used"
    whole = f"{start}: {found.reason}"
    if len(whole.split()) <= MAX_SENTENCE_WORDS:
        return Verdict(name, whole)
    first = f"{start}: {found.reason.partition('; ')[0].partition('. ')[0].rstrip('.')}."
    sentence = first if len(first.split()) <= MAX_SENTENCE_WORDS else f"{start}; the reason is given below."
    return Verdict(name, sentence, (Reason("refused", found.reason),))


def refuse(
    joint: str,
    why: Refused,
    findings: Sequence[Finding] = (),
    experiment: Experiment | None = None,
    signal: str = "",
    unit: str = "rad",
    unexplained: float = 1.0,
) -> JointDiagnosis:
    """The diagnosis of what cannot be judged."""
    verdict = decide(why)
    case = Case(joint, tuple(findings), signal or f"{joint}.position", unit)
    return JointDiagnosis(case, verdict, Measured(unexplained=unexplained), experiment=experiment)


def refuse_divergence(problem: JointProblem, joint: str) -> Refused | None:
    """Why a joint cannot be judged whose replay with the nominal model leaves all bounds; None where it does not."""
    if not diverged(problem.simulate([{}])[0]):
        return None
    why = (
        f"its nominal model leaves all bounds even in steps of {1e3 * problem.step:g} ms: it is driven away from its "
        "goal, or damping and stiffness are too large for its inertia; check direction, gains, damping and armature in "
        "the robot's file and the chain"
    )
    return Refused(f"'{joint}'", why, usable=True)
