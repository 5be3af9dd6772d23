"""Positions that one unit belongs to: decided together, and by what a goal or a velocity says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.log.importers import propose_for
from sealegs.gap.log.importers.steps import TURN_OF_FEW

from tests.importers.test_import_units import ANGLE, DEG, LATE, TIME, table

STEP = np.radians(300.0) / 1024
FAST = np.gradient(LATE, TIME)


def joints(sizes: dict[str, float], form: str = "{}_{}") -> dict[str, np.ndarray]:
    """Goal and position of several joints, by how far each moves beside the angle of the tests."""
    columns = {"time_s": TIME}
    for joint, size in sizes.items():
        columns |= {form.format("goal", joint): size * ANGLE, form.format("pos", joint): size * LATE}
    return columns


@pytest.mark.parametrize("form", ["{}_{}", "{1}_{0}", "{}[{}]"])
def test_positions_whose_names_differ_by_their_joint_get_one_decision(tmp_path: Path, form: str) -> None:
    """One joint came out in degrees, the others in rad."""
    source = table(tmp_path, joints({"0": 150.0, "1": 12.0, "2": 8.0}, form))
    found = propose_for(source, tmp_path / "out")
    (question,) = found.mapping.questions
    assert question.ask.startswith("degrees (unit=deg)") and len(question.about) == 6
    assert all(text.endswith("*pi/180") for name, text in found.mapping.columns.items() if name != "time")
    assert set(found.certain.columns) == {"time"}
    answered = propose_for(source, tmp_path / "out", "deg")
    assert not answered.mapping.questions


def test_an_encoder_of_one_joint_tells_the_unit_of_those_that_are_called_alike(tmp_path: Path) -> None:
    columns = joints({"0": 60.0, "1": 3.0})
    columns["pos_0"] = np.round(columns["pos_0"] / (360.0 / 4096)) * 360.0 / 4096
    found = propose_for(table(tmp_path, columns), tmp_path / "out")
    assert not found.mapping.questions and found.mapping.columns["joint1.goal"] == "goal_1*pi/180"
    assert "as pos_0, whose steps are an encoder's" in " ".join(found.text.split())


@pytest.mark.parametrize("last", ["gripper", "opening"])
def test_a_share_or_an_opening_of_a_gripper_decides_nothing_for_the_arm(tmp_path: Path, last: str) -> None:
    for low, high in ((0.0, 100.0), (0.0, 1.0)):
        columns = joints({"shoulder": 1.5, "elbow": 1.0})
        share = (LATE - LATE.min()) / np.ptp(LATE)
        columns |= {f"goal_{last}": low + high * np.roll(share, -4), f"pos_{last}": low + high * share}
        (question,) = propose_for(table(tmp_path, columns), tmp_path / "out").mapping.questions
        assert question.about == (f"{last}.position", f"{last}.goal")


def test_a_velocity_in_a_unit_that_is_said_tells_the_unit_of_its_position(tmp_path: Path) -> None:
    columns = {"time_s": TIME, "goal": 4 * ANGLE, "pos": 4 * LATE, "vel_dps": 4 * FAST}
    found = propose_for(table(tmp_path, columns), tmp_path / "out").mapping
    assert not found.questions
    assert (found.columns["joint.position"], found.columns["joint.goal"]) == ("pos*pi/180", "goal*pi/180")
    columns = {"time_s": TIME, "goal": 30 * ANGLE, "pos": 30 * LATE, "vel_rad_s": 30 * FAST}
    found = propose_for(table(tmp_path, columns), tmp_path / "out").mapping
    assert not found.questions and found.columns["joint.position"] == "pos", "a wheel of several turns"
    columns = {"time_s": TIME, "goal": 300 * ANGLE, "pos": 300 * LATE, "vel_m_s": 0.3 * FAST}
    found = propose_for(table(tmp_path, columns), tmp_path / "out").mapping
    assert not found.questions and found.columns["joint.goal"] == "goal*1e-3", "a slide in mm"


def test_a_velocity_that_is_no_derivative_in_its_unit_tells_none(tmp_path: Path) -> None:
    columns = {"time_s": TIME, "goal": 4 * ANGLE, "pos": 4 * LATE, "vel_dps": 30 * FAST}
    found = propose_for(table(tmp_path, columns), tmp_path / "out").mapping
    assert found.columns["joint.position"] == "pos" and found.questions[0].about == ("joint.velocity",)


def test_a_position_that_moves_as_a_goal_in_degrees_is_not_taken_for_rad_in_silence(tmp_path: Path) -> None:
    source = table(tmp_path, {"time_s": TIME, "goal_deg": 4 * ANGLE, "pos": 4 * LATE})
    (question,) = propose_for(source, tmp_path / "out").mapping.questions
    assert "is pos in deg, too (unit=deg)?" in question.ask and "joint.goal" in question.about
    assert not propose_for(source, tmp_path / "out", "deg").mapping.questions
    source = table(tmp_path, {"time_s": TIME, "goal_deg": DEG * ANGLE, "pos": LATE})
    assert not propose_for(source, tmp_path / "out").mapping.questions


def test_the_answer_ticks_keeps_the_question_how_many_are_a_turn_where_1024_may_be(tmp_path: Path) -> None:
    columns = {"time_s": TIME, "goal": np.round(512 + ANGLE / STEP), "pos": np.round(512 + LATE / STEP)}
    (question,) = propose_for(table(tmp_path, columns), tmp_path / "out", "ticks").mapping.questions
    assert question.ask == TURN_OF_FEW and question.about == ("joint.position", "joint.goal")
    assert "(<column> - 512)*300/1024*pi/180" in question.ask
    columns |= {"elbow_goal": np.round(2048 + 600 * ANGLE), "elbow_pos": np.round(2048 + 600 * LATE)}
    columns |= {"shoulder_goal": columns.pop("goal"), "shoulder_pos": columns.pop("pos")}
    assert not propose_for(table(tmp_path, columns), tmp_path / "out", "ticks").mapping.questions


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_an_opening_from_0_to_1_is_asked_about_where_other_joints_are_angles(tmp_path: Path, unit: str) -> None:
    """``unit=rad`` took the grippers of an ALOHA for rad."""
    columns = joints({"waist": 60.0 if unit == "deg" else 1.0})
    share = (LATE - LATE.min()) / np.ptp(LATE)
    columns |= {"goal_gripper": np.roll(share, -4), "pos_gripper": share}
    (question,) = propose_for(table(tmp_path, columns), tmp_path / "out", unit).mapping.questions
    assert question.about == ("gripper.position", "gripper.goal") and "as an opening does" in question.ask
    columns = joints({"waist": 1.0, "elbow": 1.0})
    columns |= {"goal_elbow": 0.4 + 0.3 * ANGLE, "pos_elbow": 0.4 + 0.3 * LATE}
    assert not propose_for(table(tmp_path, columns), tmp_path / "out", "rad").mapping.questions, "an elbow within 0..1"
