"""The extended model as files: chain, MJCF, and the list of what changed and why."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from ...actuators import Chain
from ..replay.joint_model import JointModel
from ..replay.parameters import address
from ..verdict.verdict import JointDiagnosis
from .mjcf import native_mjcf, not_native

__all__ = ["changes", "not_native", "write_extension"]


def changes(diagnosis: JointDiagnosis) -> list[dict[str, Any]]:
    """What the extended model changes: path, value before and after, and the cause (or ``re-tuned``) behind it."""
    if diagnosis.problem is None or diagnosis.search is None:
        return []
    nominal = diagnosis.problem.models[0]
    owner = {p.path: c.cause.name for c in diagnosis.search.accepted for p in c.variant}
    rows = []
    for path, value in diagnosis.values.items():
        at = address(path)
        before = nominal.value(at.number)
        after = value * before if at.factor else value
        why = owner.get(path, "re-tuned within its tolerance")
        rows.append({"path": at.number, "from": float(before), "to": float(after), "why": why})
    return sorted(rows, key=lambda row: row["why"] not in owner.values())


def write_extension(diagnosis: JointDiagnosis, folder: Path, prefix: str = "") -> dict[str, Path]:
    """Write ``extended.yaml`` (the chain) and ``extended.xml`` (the bench with what of it plain MuJoCo simulates).

    Runs that differ in their nominal chain get a chain file each.

    Returns:
        Paths by ``chain`` and ``mjcf`` (of the first chain), and ``chain.<n>`` for further ones.
    """
    assert diagnosis.problem is not None
    written: dict[str, Path] = {}
    seen: list[JointModel] = []
    for nominal, params in zip(diagnosis.problem.models, diagnosis.problem.params, strict=True):
        if any(nominal.chain.stages == other.chain.stages for other in seen):
            continue
        seen.append(nominal)
        joint = nominal.with_fitted(diagnosis.values)
        suffix = f"-{len(seen)}" if len(seen) > 1 else ""
        path = folder / f"{prefix}extended{suffix}.yaml"
        named = ", ".join(cause.name for cause in diagnosis.causes if cause.kind != "data") or "nothing named"
        lines = [f"# Extended chain of joint '{diagnosis.joint}': {named}. Against the nominal chain:"]
        lines += [
            f"#   {row['path']}: {row['from']:.5g} -> {row['to']:.5g} ({row['why']})" for row in changes(diagnosis)
        ]
        path.write_text("\n".join(lines) + "\n" + _rounded(joint.chain).to_yaml(), encoding="utf-8")
        written[f"chain{suffix.replace('-', '.')}"] = path
        if len(seen) == 1 and params:  # without a load, there is no bench to write
            mjcf = folder / f"{prefix}extended.xml"
            missing = ", ".join(not_native(joint.chain)) or "nothing"
            note = f"<!-- For plain MuJoCo; the control is the position goal [rad]. Left out: {missing}. -->"
            mjcf.write_text(f"{note}\n{native_mjcf(joint, params)}", encoding="utf-8")
            written["mjcf"] = mjcf
    return written


def _rounded(chain: Chain) -> Chain:
    """Numbers to six digits, so that the file can be read."""
    rounded = [
        dataclasses.replace(stage, **{key: float(f"{value:.6g}") for key, value in stage.parameters().items()})
        for stage in chain.stages
    ]
    return dataclasses.replace(chain, stages=tuple(rounded))
