"""The extended model as files: chain, MJCF, and the list of what changed and why."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from actuators import Chain
from gap.diagnosis import JointDiagnosis
from gap.engine_replay import bench
from gap.joint_model import JointModel

NATIVE = {
    "friction": ("coulomb", "viscous"),
    "dc_motor": ("armature",),
    "regression": ("armature",),
    "ideal": ("armature",),
    "net": ("armature",),
    "spring": ("stiffness", "damping"),
    "compliance": ("stiffness", "damping"),
    "backlash": ("width",),
}
"""What MuJoCo itself simulates of a chain; everything else is the law's, and is listed as such."""


def changes(diagnosis: JointDiagnosis) -> list[dict[str, Any]]:
    """What the extended model changes: path, value before and after, and the cause (or ``re-tuned``) behind it."""
    if diagnosis.problem is None or diagnosis.search is None:
        return []
    nominal = diagnosis.problem.models[0]
    owner = {p.path: c.cause.name for c in diagnosis.search.accepted for p in c.variant}
    rows = []
    for path, value in diagnosis.values.items():
        bare = path.rstrip("*")
        before = nominal.value(bare)
        after = value * before if path.endswith("*") else value
        rows.append(
            {
                "path": bare,
                "from": float(before),
                "to": float(after),
                "why": owner.get(path, "re-tuned within its tolerance"),
            }
        )
    return sorted(rows, key=lambda row: row["why"].startswith("re-tuned"))


def not_native(chain: Chain) -> list[str]:
    """Stages and parameters of a chain that plain MuJoCo does not simulate."""
    found = []
    for stage in chain.stages:
        keys = [
            key for key, value in stage.parameters().items() if value != 0.0 and key not in NATIVE.get(stage.name, ())
        ]
        found += [
            f"{stage.name}.{key}"
            for key in keys
            if not (stage.name == "friction" and key.startswith(("stribeck_", "ripple_")))
        ]
    return found


def write_extension(diagnosis: JointDiagnosis, folder: Path, prefix: str = "") -> dict[str, Path]:
    """Write ``extended.yaml`` (the chain) and ``extended.xml`` (the bench with it).

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
        if len(seen) == 1:
            drivetrain = bench(joint, params)
            mjcf = folder / f"{prefix}extended.xml"
            mjcf.write_text(drivetrain.spec.to_xml(), encoding="utf-8")
            written["mjcf"] = mjcf
    return written


def _rounded(chain: Chain) -> Chain:
    """Numbers to six digits, so that the file can be read."""
    rounded = [
        dataclasses.replace(stage, **{key: float(f"{value:.6g}") for key, value in stage.parameters().items()})
        for stage in chain.stages
    ]
    return dataclasses.replace(chain, stages=tuple(rounded))
