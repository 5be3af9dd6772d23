"""SO-101 arm, six Feetech STS3215 12 V servos, P 16 I 0 D 32 (isaac-sim2real/sage, Apache-2.0)."""

from __future__ import annotations

from pathlib import Path

from ..types import JointLog, MeasuredRun
from ..writer import write_run
from .source import column, read_table, source_files

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
TORQUE_ESTIMATE_PER_COUNT = 0.022814
"""The published ``torque_est_*`` is the unsigned current register times this, and no torque."""
CURRENT_PER_COUNT = 0.0065
"""Step of the present-current register [A]."""
CHAIN = "sts3215"


def convert_so101(source: Path, target: Path) -> list[Path]:
    """Write one measured run per recording of ``source`` into ``target`` and return their paths.

    Raises:
        LogError: a recording is missing, damaged or incomplete, or a target exists.
    """
    return [write_run(read_so101(path), target, "parquet") for path in source_files(source, "*.parquet")]


def read_so101(path: Path) -> MeasuredRun:
    """Read one recording."""
    prefixes = ("goal", "pos", "vel", "torque_est")
    table = read_table(path, ["t", *(f"{prefix}_{joint}" for joint in JOINTS for prefix in prefixes)])
    joints = {
        joint: JointLog(
            goal=column(table, f"goal_{joint}"),
            position=column(table, f"pos_{joint}"),
            velocity=column(table, f"vel_{joint}"),
            current=column(table, f"torque_est_{joint}") / TORQUE_ESTIMATE_PER_COUNT * CURRENT_PER_COUNT,
        )
        for joint in JOINTS
    }
    return MeasuredRun(
        name=path.stem,
        time=column(table, "t"),
        joints=joints,
        robot="so101",
        actuators=dict.fromkeys(JOINTS, CHAIN),
        source=path,
        meta={
            "group": path.stem,
            "machine": "SO-101, six Feetech STS3215 12 V, P 16 I 0 D 32",
            "source": "isaac-sim2real/sage at 4ffd2627df9d",
            "licence": "Apache-2.0",
            "unknown": ["load"],
            "units": {"gripper.goal": "fraction", "gripper.position": "fraction"},
            "notes": "current is the unsigned current register; the gripper's position is its opening, 0 to 1.",
        },
    )
