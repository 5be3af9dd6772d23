"""The extended leg as a file."""

from __future__ import annotations

from pathlib import Path

from ..verdict.verdict import JointDiagnosis
from .leg_model import LegModel


def write_leg(diagnosis: JointDiagnosis, folder: Path, prefix: str = "") -> dict[str, Path]:
    """Write ``extended.xml``: the whole leg, its joints as diagnosed, on the ground that was found.

    Returns:
        Path by ``leg``.
    """
    assert diagnosis.problem is not None
    leg: LegModel = diagnosis.problem.models[0]  # type: ignore[assignment]
    path = folder / f"{prefix}extended.xml"
    path.write_text(leg.with_fitted(diagnosis.values).drivetrain().spec.to_xml(), encoding="utf-8")
    return {"leg": path}
