"""The extended leg as a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from .leg_problem import LegProblem


def write_leg(problem: LegProblem, values: Mapping[str, float], folder: Path, prefix: str = "") -> dict[str, Path]:
    """Write ``extended.xml``: the whole leg, its joints as diagnosed, on the ground that was found.

    Args:
        problem: the stances.
        values: of its fit.
        folder, prefix: where the file goes, and what its name starts with.

    Returns:
        Path by ``leg``.
    """
    leg = problem.models[0].with_fitted(values)
    path = folder / f"{prefix}extended.xml"
    path.write_text(leg.drivetrain().spec.to_xml(), encoding="utf-8")
    return {"leg": path}
