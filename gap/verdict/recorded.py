"""What a delay may be instead: the way in which a log was recorded, where the log itself cannot tell."""

from __future__ import annotations

from collections.abc import Sequence

from ..log.finding import Finding
from ..measure.named import NamedCause
from ..search.settings import DEFAULT, SearchSettings
from .verdict import Reason

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
