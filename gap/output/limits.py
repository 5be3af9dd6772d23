"""Up to where each cause would not show, by family: thirty of them in a row are a wall."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..experiment import DetectionLimit
from ..verdict.verdict import JointDiagnosis

LIMITS = "limits"  # code of the reason that lists them all
LEAD = "Nothing was found. That much could be there unseen, hidden by numbers within their tolerance:"


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


def rows(limits: Sequence[DetectionLimit]) -> list[dict[str, str]]:
    """The same as a table: cause, number, what the model has, and below and above which values it would show."""
    told = []
    for limit in limits:
        unit = "" if limit.unit == "1" else f" {limit.unit}"
        ends = [f"{end:.3g}{unit}" if math.isfinite(end) else "never" for end in (limit.low, limit.high)]
        believed = f"{limit.nominal:.3g}{unit}" if math.isfinite(limit.nominal) else "none"
        told.append({"cause": limit.name, "number": limit.number, "model": believed, "low": ends[0], "high": ends[1]})
    return told
