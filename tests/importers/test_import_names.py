"""What names of columns say: numbered motors are no metres, and joints are spelled as in the robot's file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.log.importers import propose_for
from sealegs.gap.log.importers.names import said

from tests.importers.test_import_units import ANGLE, LATE, TIME, table

GRID = 360.0 / 4096


@pytest.mark.parametrize(
    ("column", "signal", "unit"),
    [
        ("pos_m1", "position", ""),
        ("cmd_m2", "goal", ""),
        ("pos_a1", "position", ""),
        ("theta_m", "position", ""),
        ("pos_m", "position", "m"),
        ("slide_pos_m", "position", "m"),
        ("pos_mm_1", "position", "mm"),
    ],
)
def test_a_letter_with_a_number_is_a_motor_and_no_unit(column: str, signal: str, unit: str) -> None:
    assert (said(column).signal, said(column).unit) == (signal, unit)


def test_angles_of_numbered_motors_are_taken_as_degrees(tmp_path: Path) -> None:
    """They were read as 139 m of a slide, and nobody was asked."""
    columns = {"time": TIME}
    for k, size in ((1, 70.0), (2, 40.0)):
        columns |= {f"cmd_m{k}": size * ANGLE, f"pos_m{k}": size * LATE}
    found = propose_for(table(tmp_path, columns), tmp_path / "out", unit="deg").mapping
    assert found.columns["m1.position"] == "pos_m1*pi/180" and found.columns["m2.goal"] == "cmd_m2*pi/180"
    assert not found.questions and "units" not in found.sidecar


def test_a_hundred_metres_are_asked_about(tmp_path: Path) -> None:
    found = propose_for(table(tmp_path, {"time": TIME, "cmd_m": 70.0 * ANGLE, "pos_m": 70.0 * LATE}), tmp_path / "out")
    (question,) = found.mapping.questions
    assert "position" in question.about[0] and "m of a slide (unit=m), or the angle of a motor" in question.ask


def test_an_opening_in_percent_beside_degrees_is_asked_about_whatever_unit_is_said(tmp_path: Path) -> None:
    """unit=deg made 0..100 degrees of how far a gripper was open."""
    degrees = {"lift.goal": 40.0 * ANGLE, "lift.position": GRID * np.round(40.0 * LATE / GRID)}
    share = {"gripper.goal": 50.0 + 60.0 * ANGLE, "gripper.position": 50.0 + 60.0 * LATE}
    assert share["gripper.position"].min() >= 0.0 and share["gripper.position"].max() <= 100.0
    source = table(tmp_path, {"time": TIME} | degrees | share)
    found = propose_for(source, tmp_path / "out", unit="deg").mapping
    asked = [name for question in found.questions for name in question.about]
    assert "gripper.position" in asked and "lift.position" not in asked
    assert any("opening in percent" in question.ask for question in found.questions)


@pytest.mark.parametrize(
    ("joints", "columns"),
    [
        (("joint_1", "joint_2"), "{}.goal {}.position"),
        (("leftHipYaw", "leftKnee"), "{}_cmd {}_pos"),
        (("Joint-A", "Joint-B"), "{}_cmd {}_pos"),
    ],
)
def test_joints_are_called_as_in_the_file_of_the_robot(tmp_path: Path, joints: tuple[str, str], columns: str) -> None:
    """``joint_1`` became ``joint1``, which the robot does not have."""
    (tmp_path / "robot.xml").write_text(
        f'<mujoco><worldbody><body><joint name="{joints[0]}"/><geom size="0.1" mass="1"/>'
        f'<body pos="0 0 1"><joint name="{joints[1]}"/><geom size="0.1" mass="1"/></body></body></worldbody></mujoco>'
    )
    table_of = {"time": TIME}
    for joint, size in zip(joints, (1.0, 0.6), strict=True):
        goal, position = columns.format(joint, joint).split()
        table_of |= {goal: size * ANGLE, position: size * LATE}
    found = propose_for(table(tmp_path, table_of), tmp_path / "out", "rad", str(tmp_path / "robot.xml")).mapping
    assert {f"{joint}.{signal}" for joint in joints for signal in ("goal", "position")} <= found.columns.keys()


def test_joints_of_a_header_like_a_log_s_keep_their_names(tmp_path: Path) -> None:
    columns = {"time": TIME, "joint_1.goal": ANGLE, "joint_1.position": LATE}
    columns |= {"joint_2.goal": 0.6 * ANGLE, "joint_2.position": 0.6 * LATE}
    found = propose_for(table(tmp_path, columns), tmp_path / "out", "rad").mapping
    assert set(found.columns) == columns.keys()
