"""How a verdict is said: sizes, falls, names and certainty, each in a few words."""

from __future__ import annotations

from collections.abc import Sequence

from ..log.finding import Finding
from ..measure.confidence import Thresholds
from ..measure.named import CERTAIN, LIKELY, NamedCause, OpenCause
from ..search.settings import DEFAULT, SearchSettings
from ..search.structure import fine, listed, told_in
from .verdict import Reason, Replayed

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
