"""Evidence of a replay from what a test says of it, whichever part of the evidence holds that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

from sealegs.gap.measure.case import Case
from sealegs.gap.measure.measured import Measured
from sealegs.gap.measure.named import Error, NamedCause
from sealegs.gap.search.structure import Structure
from sealegs.gap.verdict.verdict import Replayed


def evidence(
    joint: str, gap: Mapping[str, Error], causes: Sequence[NamedCause], structure: Structure, **more: Any
) -> Replayed:
    """Evidence of errors of each model, of causes and of what is left; ``more`` by the names that the parts have."""

    def own(kind: Any) -> dict[str, Any]:
        return {item.name: more.pop(item.name) for item in fields(kind) if item.name in more}

    case = Case(joint, **own(Case))
    return Replayed(case, Measured(gap, causes=tuple(causes), structure=structure, **own(Measured)), **more)


def with_measured(found: Replayed, **changes: Any) -> Replayed:
    """The same with something else measured."""
    return replace(found, measured=replace(found.measured, **changes))
