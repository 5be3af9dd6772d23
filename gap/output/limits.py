"""Up to where each cause would not show, by family: thirty of them in a row are a wall."""

from __future__ import annotations

from collections.abc import Sequence

from ..experiment import DetectionLimit
from ..verdict.verdict import JointDiagnosis

LIMITS = "limits"  # code of the reason that lists them all
LEAD = "Beside numbers within their tolerance, this log would not show:"


def limits_told(diagnosis: JointDiagnosis) -> Sequence[DetectionLimit]:
    """The limits of a joint whose verdict lists them; else none."""
    return diagnosis.limits if any(reason.code == LIMITS for reason in diagnosis.reasons) else ()


def by_family(limits: Sequence[DetectionLimit]) -> list[tuple[str, str]]:
    """Families of causes and their limits as text, in the order in which they come."""
    families: dict[str, list[str]] = {}
    for limit in limits:
        family, _, name = limit.name.partition(".")
        families.setdefault(family, []).append(f"{name}{limit.sentence.removeprefix(limit.name)}")
    return [(family, "; ".join(told)) for family, told in families.items()]
