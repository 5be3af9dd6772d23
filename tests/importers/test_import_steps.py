"""Imports of raw encoder steps and of shares of a range, against what the robot's model allows; LeRobot's gains."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.load.robot import robot_of
from sealegs.gap.load.units import run_in_model_units
from sealegs.gap.log import LogError, read_measured
from sealegs.gap.log.importers import import_logs, propose_for
from sealegs.gap.log.importers.mapping import Mapping
from sealegs.gap.log.importers.positions import STEPS

from tests.importers.importing import ANGLE, LATE, RAD, TIME, table
from tests.importers.test_import_robots import NAMES, data_set

STEP = 2.0 * np.pi / 4096
ARM = """<mujoco><compiler angle="radian"/><worldbody>
  <body name="upper"><joint name="shoulder" axis="0 1 0" range="-1.5 1.5"/><geom size="0.1" mass="1"/>
    <body pos="0 0 -1"><joint name="gripper" axis="0 1 0" range="-0.2 1.8"/><geom size="0.1" mass="1"/></body>
    <body pos="0 1 -1"><joint name="wheel" axis="0 1 0"/><geom size="0.1" mass="1"/></body></body>
</worldbody></mujoco>"""


def steps(angle: np.ndarray, middle: int = 2048) -> np.ndarray:
    """Angles [rad] as a servo of 4096 steps a turn has them."""
    return np.round(middle + angle / STEP)


def servos(columns: int = 3) -> dict[str, np.ndarray]:
    """Registers of several servos, the last of which hardly moves."""
    sizes = {k: 0.2 if k == columns else 1.0 for k in range(1, columns + 1)}
    registers: dict[str, np.ndarray] = {"time_s": TIME}
    registers |= {f"present_position_{k}": steps(size * LATE) for k, size in sizes.items()}
    return registers | {f"goal_position_{k}": steps(size * ANGLE) for k, size in sizes.items()}


@pytest.fixture
def arm(tmp_path: Path) -> str:
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    return str(path)


# --- encoder steps ---------------------------------------------------------------------------------------------------


def test_whole_numbers_within_a_register_are_asked_about_as_encoder_steps(tmp_path: Path) -> None:
    """1956 to 2500 were asked about as degrees, rad or mm, by how far each joint moved."""
    (question,) = propose_for(table(tmp_path, servos()), tmp_path / "out").mapping.questions
    assert question.ask == STEPS and "unit=ticks" in STEPS and len(question.about) == 6


def test_the_answer_ticks_makes_an_angle_of_steps(tmp_path: Path) -> None:
    source, out = table(tmp_path, servos()), tmp_path / "out"
    found = propose_for(source, out, "ticks", actuator="ideal")
    assert not found.mapping.questions
    assert found.mapping.columns["joint1.position"] == "(present_position_1 - 2048)*2*pi/4096"
    import_logs(source, out, replace(found.mapping, sidecar={**found.mapping.sidecar, "robot": "a machine of ours"}))
    log = read_measured(out).runs[0].joints["joint1"]
    assert log.goal is not None
    np.testing.assert_allclose(log.position, LATE, atol=STEP)
    np.testing.assert_allclose(log.goal, ANGLE, atol=STEP)


def test_steps_that_are_called_degrees_are_asked_about(tmp_path: Path) -> None:
    """``unit=deg`` made an angle of 35 rad of a servo near its middle."""
    (question,) = propose_for(table(tmp_path, servos()), tmp_path / "out", "deg").mapping.questions
    assert question.ask == STEPS and len(question.about) == 6


def test_whole_degrees_are_no_steps(tmp_path: Path) -> None:
    columns = {"time_s": TIME, "goal": np.round(90 + 57 * ANGLE), "pos": np.round(90 + 57 * LATE)}
    (question,) = propose_for(table(tmp_path, columns), tmp_path / "out").mapping.questions
    assert question.ask.startswith("degrees (unit=deg)") and "encoder steps (unit=ticks)" in question.ask
    assert not propose_for(table(tmp_path, columns), tmp_path / "out", "deg").mapping.questions


def test_servos_of_1024_steps_are_told_their_line(tmp_path: Path) -> None:
    step = np.radians(300.0) / 1024
    columns = {"time_s": TIME, "goal": np.round(512 + ANGLE / step), "pos": np.round(512 + LATE / step)}
    (question,) = propose_for(table(tmp_path, columns), tmp_path / "out").mapping.questions
    assert question.ask == STEPS and "(<column> - 512)*300/1024*pi/180" in STEPS


@pytest.mark.parametrize("kind", ["fractions", "counts"])
def test_what_is_no_steps_of_a_servo_is_asked_about_in_spite_of_the_answer(tmp_path: Path, kind: str) -> None:
    size = 1e6 if kind == "counts" else 1.0
    position = np.round(size * LATE) if kind == "counts" else 2048 + LATE / STEP
    goal = np.round(size * ANGLE) if kind == "counts" else 2048 + ANGLE / STEP
    found = propose_for(table(tmp_path, {"time_s": TIME, "goal": goal, "pos": position}), tmp_path / "out", "ticks")
    (question,) = found.mapping.questions
    assert question.about == ("joint.position", "joint.goal")
    assert ("No unit is said" if kind == "fractions" else "are a turn") in question.ask


def test_a_column_that_says_ticks_takes_the_answer_and_one_in_rad_keeps_its_unit(tmp_path: Path) -> None:
    columns = {"time_s": TIME, "a_goal_ticks": steps(ANGLE), "a_pos_ticks": steps(LATE)}
    columns |= {"b_goal_rad": ANGLE, "b_pos_rad": LATE}
    found = propose_for(table(tmp_path, columns), tmp_path / "out", "ticks")
    assert not found.mapping.questions
    assert found.mapping.columns["a.goal"] == "(a_goal_ticks - 2048)*2*pi/4096"
    assert found.mapping.columns["b.position"] == "b_pos_rad"
    with pytest.raises(LogError, match="unit=ticks is for positions and goals whose unit is open, and none is"):
        propose_for(table(tmp_path, {"time_s": TIME, **RAD}), tmp_path / "out", "ticks")


def test_a_velocity_in_steps_a_second_goes_with_its_position(tmp_path: Path) -> None:
    columns = {"time_s": TIME, "goal": steps(ANGLE), "pos": steps(LATE)}
    columns["velocity"] = np.round(np.gradient(LATE, TIME) / STEP)
    found = propose_for(table(tmp_path, columns), tmp_path / "out", "ticks")
    assert found.mapping.columns["joint.velocity"] == "velocity*2*pi/4096" and not found.mapping.questions


# --- the range of the model ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("zero", [0.0, 40.0])
def test_a_joint_far_outside_its_range_is_told(tmp_path: Path, arm: str, zero: float) -> None:
    columns = {"time_s": TIME, "shoulder_goal_rad": ANGLE + zero, "shoulder_pos_rad": LATE + zero}
    columns |= {"wheel_goal_rad": ANGLE + 50.0, "wheel_pos_rad": LATE + 50.0}
    source, out = table(tmp_path, columns), tmp_path / "out"
    found = propose_for(source, out, robot=arm)
    told = re.search(r"# Note: shoulder\.position goes from 39\.\d to 40\.\d rad, far outside the range", found.text)
    assert bool(told) == (zero > 0.0) and "wheel.position goes" not in found.text
    far = import_logs(source, out, found.mapping).far
    assert [sentence.partition(" ")[0] for sentence in far] == ["shoulder.goal", "shoulder.position"] * bool(zero)


# --- percent ---------------------------------------------------------------------------------------------------------


def gripper() -> dict[str, np.ndarray]:
    opening = {"gripper_goal": 50.0 + 60.0 * ANGLE, "gripper_pos": 50.0 + 60.0 * LATE}
    return {"time_s": TIME, "shoulder_goal_rad": ANGLE, "shoulder_pos_rad": LATE} | opening


def test_the_answer_percent_takes_the_range_of_the_model(tmp_path: Path, arm: str) -> None:
    """The range had to be written by hand into three places."""
    source, out = table(tmp_path, gripper()), tmp_path / "out"
    assert "unit=percent beside robot=" in propose_for(source, out).text
    found = propose_for(source, out, "percent", arm, "ideal")
    assert not found.mapping.questions and found.mapping.columns["shoulder.position"] == "shoulder_pos_rad"
    assert found.mapping.sidecar["units"] == {"gripper.position": "percent", "gripper.goal": "percent"}
    import_logs(source, out, found.mapping)
    run = read_measured(out).runs[0]
    in_model = run_in_model_units(run, robot_of(run)).joints["gripper"].position
    np.testing.assert_allclose(in_model, -0.2 + 2.0 * (0.5 + 0.6 * LATE), atol=1e-6)


def test_percent_of_no_range_is_refused_in_a_sentence(tmp_path: Path, arm: str) -> None:
    source = table(tmp_path, gripper())
    with pytest.raises(LogError, match=r"no robot's file is given: add robot=my_arm\.yaml, or write low \+"):
        propose_for(source, tmp_path / "out", "percent")
    wheel = {name.replace("gripper", "wheel"): values for name, values in gripper().items()}
    with pytest.raises(LogError, match=r"arm\.xml gives the joint 'wheel' no range"):
        propose_for(table(tmp_path, wheel), tmp_path / "out", "percent", arm)
    with pytest.raises(LogError, match="stay within 0 to 100 and say no other unit, and there is none"):
        propose_for(table(tmp_path, {"time_s": TIME, **RAD}), tmp_path / "out", "percent", arm)


# --- goals that are readings, clocks that repeat ---------------------------------------------------------------------


@pytest.mark.parametrize("ahead", [0, 1])
def test_a_goal_that_is_the_reading_itself_is_asked_about(tmp_path: Path, ahead: int) -> None:
    goal = np.concatenate([LATE[ahead:], LATE[:ahead]])
    source = table(tmp_path, {"time_s": TIME, "goal_rad": goal, "pos_rad": LATE})
    (question,) = propose_for(source, tmp_path / "out").mapping.questions
    assert question.about == ("joint.goal",) and ("of the next row" in question.ask) == bool(ahead)
    assert "log what was sent as the goal" in question.ask
    assert not propose_for(table(tmp_path, {"time_s": TIME, **RAD}), tmp_path / "out").mapping.questions


def test_repeated_stamps_are_left_out_by_a_line_that_is_offered(tmp_path: Path) -> None:
    """The refusal told nobody what to do about them."""
    time = TIME.copy()
    time[[40, 41, 70]] = time[[39, 39, 69]]
    source = table(tmp_path, {"time_s": time, **RAD})
    columns = {"time": "time_s", "joint.goal": "goal_rad", "joint.position": "pos_rad"}
    with pytest.raises(LogError, match="repeats in 3 samples, the first in row 41") as caught:
        import_logs(source, tmp_path / "out", Mapping(columns))
    offered = re.search(r"`where: (.*)`", str(caught.value))
    assert offered and offered[1] == "later(time_s)" and f"keeps {len(TIME) - 3} samples" in str(caught.value)
    import_logs(source, tmp_path / "out", Mapping(columns, where=offered[1]))
    assert len((tmp_path / "out" / "run.csv").read_text().splitlines()) == 1 + len(TIME) - 3


# --- LeRobot ---------------------------------------------------------------------------------------------------------


def test_the_gains_that_lerobot_sets_are_told_of_the_robots_that_have_them(tmp_path: Path) -> None:
    """A diagnosis with the factory's gain found the converter's error."""
    source = data_set(tmp_path / "data", "v3.0", 180.0 / np.pi, NAMES)
    assert "LeRobot sets P 16, I 0, D 32" in propose_for(source, tmp_path / "log").text
    info = source / "meta" / "info.json"
    info.write_text(info.read_text().replace('"so100"', '"koch_follower"'))
    assert "LeRobot sets" not in propose_for(source, tmp_path / "other").text
