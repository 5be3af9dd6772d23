"""The diagnosis of what cannot be judged."""

from __future__ import annotations

from collections.abc import Sequence

from ..experiment import Experiment
from ..log.finding import Finding
from .decide import decide
from .evidence import Refused
from .verdict import JointDiagnosis


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
    return JointDiagnosis(
        joint=joint,
        verdict=verdict.name,
        sentence=verdict.sentence,
        signal=signal or f"{joint}.position",
        unit=unit,
        gap={},
        causes=(),
        unexplained=unexplained,
        rivals=(),
        experiment=experiment,
        findings=tuple(findings),
        reasons=verdict.reasons,
    )
