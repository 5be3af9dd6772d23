"""What an import must not take with confidence: units by a word or without a time, goals that no joint follows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.checks.columns import check_columns
from sealegs.gap.checks.context import joint_contexts
from sealegs.gap.log.importers import Proposed, propose_for
from sealegs.gap.log.importers.evidence import drives
from sealegs.gap.log.types import JointLog, MeasuredRun

from tests.importers.test_import_units import ANGLE, LATE, TIME, table

TURN = 2.0 * np.pi
OTHER = 0.5 * np.cos(3.3 * TIME) + 0.2 * np.sin(7.7 * TIME)
OTHER_LATE = 0.5 * np.cos(3.3 * (TIME - 0.04)) + 0.2 * np.sin(7.7 * (TIME - 0.04))


def proposed(folder: Path, columns: dict[str, np.ndarray], unit: str | None = None) -> Proposed:
    return propose_for(table(folder, columns), folder / "out", unit=unit)


def asked(found: Proposed) -> dict[str, str]:
    return {name: question.ask for question in found.mapping.questions for name in question.about}


# --- units by a word -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["{} (rotations)", "{} [rot]", "{}_revolutions", "{}_rots", "{} (rev)", "{} (cycles)"])
def test_rotations_are_turns(tmp_path: Path, form: str) -> None:
    columns = {"time": TIME, form.format("Target"): ANGLE / TURN, form.format("Position"): LATE / TURN}
    found = proposed(tmp_path, columns)
    assert asked(found) == {}
    assert found.mapping.columns.keys() == {"time", "joint.position", "joint.goal"}
    assert all(found.mapping.columns[f"joint.{signal}"].endswith("*2*pi") for signal in ("position", "goal"))


@pytest.mark.parametrize("form", ["{}_rot", "{}_rotation", "{}_cycles", "{} (gon)", "{} [elbow]"])
def test_a_word_that_may_be_the_unit_of_positions_and_goals_is_asked_about(tmp_path: Path, form: str) -> None:
    found = proposed(tmp_path, {"time": TIME, form.format("target"): ANGLE, form.format("position"): LATE})
    about = asked(found)
    assert about.keys() == {"joint.position", "joint.goal"} and len(found.mapping.questions) == 1
    assert "unit=deg" in about["joint.position"]


def test_the_answer_says_what_such_a_word_means(tmp_path: Path) -> None:
    columns = {"time": TIME, "target_rot": ANGLE / TURN, "position_rot": LATE / TURN}
    for unit, text in (("turn", "position_rot*2*pi"), ("rad", "position_rot")):
        found = proposed(tmp_path, columns, unit)
        assert asked(found) == {} and found.mapping.columns["joint.position"] == text


def test_a_joint_that_is_called_rotation_keeps_its_name(tmp_path: Path) -> None:
    columns = {"time": TIME, "goal_rot": ANGLE, "pos_rot": LATE, "goal_lift": OTHER, "pos_lift": OTHER_LATE}
    found = proposed(tmp_path, columns)
    assert asked(found) == {} and {"rot.position", "rot.goal", "lift.goal"} <= found.mapping.columns.keys()
    columns = {"time": TIME, "goal_rot": ANGLE, "pos_rot": LATE, "torque_rot": OTHER}
    assert "rot.position" in proposed(tmp_path, columns).mapping.columns


# --- no time ---------------------------------------------------------------------------------------------------------


def test_without_a_time_no_derivative_tells_the_unit_of_a_velocity(tmp_path: Path) -> None:
    """At 1 kHz a velocity in rad/s is 10 times what it would be at 100 Hz, which rpm are, nearly."""
    columns = {
        "q_des": ANGLE,
        "q": LATE,
        "dq": 10.0 * np.gradient(LATE, TIME),
        "dq_des": 10.0 * np.gradient(ANGLE, TIME),
    }
    found = proposed(tmp_path, columns)
    assert found.mapping.columns["joint.velocity"] == "dq"
    assert found.mapping.columns["joint.goal_velocity"] == "dq_des"
    assert asked(found).keys() == {"time", "joint.velocity"} and "time is in question" in asked(found)["joint.velocity"]
    named = {"q_des": ANGLE, "q": LATE, "dq_rpm": 10.0 * np.gradient(LATE, TIME)}
    found = proposed(tmp_path, named)
    assert found.mapping.columns["joint.velocity"] == "dq_rpm*2*pi/60" and asked(found).keys() == {"time"}


def test_without_a_time_gains_still_make_a_chain(tmp_path: Path) -> None:
    one = np.ones_like(TIME)
    columns = {"q": LATE, "q_des": ANGLE, "dq_des": 10.0 * np.gradient(ANGLE, TIME), "kp": 40.0 * one, "kd": 2.0 * one}
    assert "stiffness: 40.0" in proposed(tmp_path, columns).text


# --- goals -----------------------------------------------------------------------------------------------------------


def test_a_goal_that_its_position_does_not_follow_is_asked_about(tmp_path: Path) -> None:
    found = proposed(tmp_path, {"time": TIME, "q_des": OTHER, "q": LATE})
    assert "The position does not move as it does" in asked(found)["joint.goal"]


def test_the_position_that_follows_such_a_goal_is_named(tmp_path: Path) -> None:
    columns = {"time": TIME, "q0": LATE, "q1": OTHER_LATE, "q_ref1": ANGLE, "q_ref2": OTHER}
    assert "is q_ref1 the goal of q0, which follows it?" in asked(proposed(tmp_path, columns))["joint1.goal"]


def test_a_slow_joint_and_one_at_rest_are_not_asked_about(tmp_path: Path) -> None:
    steps = np.where(TIME % 6.0 < 3.0, 0.5, -0.5)
    slow = np.zeros_like(TIME)
    for k in range(1, len(TIME)):
        slow[k] = slow[k - 1] + 0.01 / 1.0 * (steps[k - 1] - slow[k - 1])
    noise = 1e-3 * np.random.default_rng(0).standard_normal(len(TIME))
    for position in (slow, noise):
        assert "joint.goal" not in asked(proposed(tmp_path, {"time": TIME, "q_des": steps, "q": position}))


@pytest.mark.parametrize("timed", [True, False])
def test_a_position_that_moves_against_its_goal_is_asked_about(tmp_path: Path, timed: bool) -> None:
    columns = {"time": TIME} if timed else {}
    found = proposed(tmp_path, columns | {"q_des": ANGLE, "q": -LATE})
    assert "moves against this goal. If it counts the other way round, write -q_des" in asked(found)["joint.goal"]


def test_a_swing_goes_along_with_its_goal_rather_than_against_it_half_a_period_earlier(tmp_path: Path) -> None:
    goal, position = (np.sin(9.0 * (TIME - late)) for late in (0.0, 0.04))
    assert "joint.goal" not in asked(proposed(tmp_path, {"time": TIME, "q_des": goal, "q": position}))


# --- what drives -----------------------------------------------------------------------------------------------------


def test_what_the_angle_alone_explains_drives_no_joint() -> None:
    speed = np.gradient(LATE, TIME)
    assert drives(TIME, LATE, 0.4 * LATE + 0.2) == 0.0
    assert drives(TIME, LATE, 0.3 * np.cos(LATE)) == 0.0
    assert drives(TIME, LATE, 0.1 * np.gradient(speed, TIME) + 0.1 * speed + np.sin(LATE)) > 0.9


# --- the check of a log ----------------------------------------------------------------------------------------------


def commanded(scale: float) -> list[tuple[str, str | None, bool]]:
    log = JointLog(position=LATE, goal=ANGLE, goal_velocity=scale * np.gradient(ANGLE, TIME))
    run = MeasuredRun(name="run", time=TIME, joints={"j": log}, meta={}, actuators={})
    return [(f.code, f.column, f.data_error) for f in check_columns(joint_contexts(run)[0])]


@pytest.mark.parametrize("scale", [180.0 / np.pi, 60.0 / TURN, 1.0 / TURN])
def test_a_commanded_velocity_in_another_unit_is_found(scale: float) -> None:
    assert commanded(scale) == [("unit.velocity", "j.goal_velocity", True)]


def test_a_commanded_velocity_in_another_ratio_stays_and_is_told() -> None:
    assert [commanded(scale) for scale in (1.0, 0.7)] == [[], []]
    assert [commanded(scale) for scale in (30.0, -1.0)] == [[("goal_velocity.scale", "j.goal_velocity", False)]] * 2
