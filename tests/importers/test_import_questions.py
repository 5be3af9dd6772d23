"""What an import asks about and never takes: units and goals that nobody says, actions that are no goals."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.checks.columns import check_columns
from sealegs.gap.checks.context import joint_contexts
from sealegs.gap.log.importers import propose_for, read_recordings
from sealegs.gap.log.importers.proposal import Proposal, propose
from sealegs.gap.log.types import JointLog, MeasuredRun

from tests.importers.importing import ANGLE, LATE, TIME, asked, proposed, table
from tests.importers.test_import import motion

A_TURN = 2.0 * np.pi
OTHER = 0.5 * np.cos(3.3 * TIME) + 0.2 * np.sin(7.7 * TIME)
OTHER_LATE = 0.5 * np.cos(3.3 * (TIME - 0.04)) + 0.2 * np.sin(7.7 * (TIME - 0.04))


@pytest.mark.parametrize("form", ["{} (rotations)", "{} [rot]", "{}_revolutions", "{}_rots", "{} (rev)", "{} (cycles)"])
def test_rotations_are_turns(tmp_path: Path, form: str) -> None:
    columns = {"time": TIME, form.format("Target"): ANGLE / A_TURN, form.format("Position"): LATE / A_TURN}
    found = proposed(tmp_path, columns)
    assert asked(found) == {}
    assert found.mapping.columns.keys() == {"time", "joint.position", "joint.goal"}
    assert all(found.mapping.columns[f"joint.{signal}"].endswith("*2*pi") for signal in ("position", "goal"))


@pytest.mark.parametrize("form", ["{}_rot", "{}_rotation", "{}_cycles", "{} (gon)", "{} [elbow]"])
def test_a_word_that_may_be_the_unit_of_positions_and_goals_is_asked_about(tmp_path: Path, form: str) -> None:
    found = proposed(tmp_path, {"time": TIME, form.format("target"): ANGLE, form.format("position"): LATE})
    about = asked(found)
    assert {name.rpartition(".")[2] for name in about} == {"position", "goal"} and len(found.mapping.questions) == 1
    assert "unit=deg" in next(iter(about.values()))


def test_the_answer_says_what_such_a_word_means(tmp_path: Path) -> None:
    columns = {"time": TIME, "target_rot": ANGLE / A_TURN, "position_rot": LATE / A_TURN}
    for unit, text in (("turn", "position_rot*2*pi"), ("rad", "position_rot")):
        found = proposed(tmp_path, columns, unit)
        assert asked(found) == {} and found.mapping.columns["rot.position"] == text


def test_a_joint_that_is_called_rotation_keeps_its_name(tmp_path: Path) -> None:
    columns = {"time": TIME, "goal_rot": ANGLE, "pos_rot": LATE, "goal_lift": OTHER, "pos_lift": OTHER_LATE}
    found = proposed(tmp_path, columns, "rad")
    assert asked(found) == {} and {"rot.position", "rot.goal", "lift.goal"} <= found.mapping.columns.keys()
    columns = {"time": TIME, "goal_rot": ANGLE, "pos_rot": LATE, "torque_rot": OTHER}
    assert "rot.position" in proposed(tmp_path, columns).mapping.columns


def test_without_a_time_no_derivative_tells_the_unit_of_a_velocity(tmp_path: Path) -> None:
    """At 1 kHz a velocity in rad/s is 10 times what it would be at 100 Hz, which rpm are, nearly."""
    columns = {
        "q_des": ANGLE,
        "q": LATE,
        "dq": 10.0 * np.gradient(LATE, TIME),
        "dq_des": 10.0 * np.gradient(ANGLE, TIME),
    }
    found = proposed(tmp_path, columns, timed=False)
    assert found.mapping.columns["joint.velocity"] == "dq"
    assert found.mapping.columns["joint.goal_velocity"] == "dq_des"
    assert asked(found).keys() == {"time", "joint.velocity"} and "time is in question" in asked(found)["joint.velocity"]
    named = {"q_des": ANGLE, "q": LATE, "dq_rpm": 10.0 * np.gradient(LATE, TIME)}
    found = proposed(tmp_path, named, timed=False)
    assert found.mapping.columns["joint.velocity"] == "dq_rpm*2*pi/60" and asked(found).keys() == {"time"}


def test_without_a_time_gains_still_make_a_chain(tmp_path: Path) -> None:
    one = np.ones_like(TIME)
    columns = {"q": LATE, "q_des": ANGLE, "dq_des": 10.0 * np.gradient(ANGLE, TIME), "kp": 40.0 * one, "kd": 2.0 * one}
    assert "stiffness: 40.0" in proposed(tmp_path, columns, timed=False).text


def test_a_goal_that_its_position_does_not_follow_is_asked_about(tmp_path: Path) -> None:
    found = proposed(tmp_path, {"time": TIME, "q_des": OTHER, "q": LATE})
    assert "The position does not move as it does" in asked(found)["joint.goal"]


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
    found = proposed(tmp_path, columns | {"q_des": ANGLE, "q": -LATE}, timed=False)
    assert "moves against this goal. If it counts the other way round, write -q_des" in asked(found)["joint.goal"]


def test_a_swing_goes_along_with_its_goal_rather_than_against_it_half_a_period_earlier(tmp_path: Path) -> None:
    goal, position = (np.sin(9.0 * (TIME - late)) for late in (0.0, 0.04))
    assert "joint.goal" not in asked(proposed(tmp_path, {"time": TIME, "q_des": goal, "q": position}))


def commanded(scale: float) -> list[tuple[str, str | None, bool]]:
    log = JointLog(position=LATE, goal=ANGLE, goal_velocity=scale * np.gradient(ANGLE, TIME))
    run = MeasuredRun(name="run", time=TIME, joints={"j": log}, meta={}, actuators={})
    return [(f.code, f.column, f.data_error) for f in check_columns(joint_contexts(run)[0])]


@pytest.mark.parametrize("scale", [180.0 / np.pi, 60.0 / A_TURN, 1.0 / A_TURN])
def test_a_commanded_velocity_in_another_unit_is_found(scale: float) -> None:
    assert commanded(scale) == [("unit.velocity", "j.goal_velocity", True)]


def test_a_commanded_velocity_in_another_ratio_stays_and_is_told() -> None:
    assert [commanded(scale) for scale in (1.0, 0.7)] == [[], []]
    assert [commanded(scale) for scale in (30.0, -1.0)] == [[("goal_velocity.scale", "j.goal_velocity", False)]] * 2


FAST = np.gradient(LATE, TIME)


def sized(sizes: dict[str, float], form: str = "{}_{}") -> dict[str, np.ndarray]:
    """Goal and position of several sized, by how far each moves beside the angle of the tests."""
    columns = {"time_s": TIME}
    for joint, size in sizes.items():
        columns |= {form.format("goal", joint): size * ANGLE, form.format("pos", joint): size * LATE}
    return columns


@pytest.mark.parametrize("form", ["{}_{}", "{1}_{0}", "{}[{}]"])
def test_positions_whose_names_differ_by_their_joint_get_one_decision(tmp_path: Path, form: str) -> None:
    """One joint came out in degrees, the others in rad."""
    source = table(tmp_path, sized({"0": 150.0, "1": 12.0, "2": 8.0}, form))
    found = propose_for(source, tmp_path / "out")
    (question,) = found.mapping.questions
    assert question.ask.startswith("degrees (unit=deg)") and len(question.about) == 6
    assert set(found.certain.columns) == {"time"}
    answered = propose_for(source, tmp_path / "out", "deg")
    assert not answered.mapping.questions


def test_an_encoder_of_one_joint_tells_the_unit_of_those_that_are_called_alike(tmp_path: Path) -> None:
    columns = sized({"0": 60.0, "1": 3.0})
    columns["pos_0"] = np.round(columns["pos_0"] / (360.0 / 4096)) * 360.0 / 4096
    found = propose_for(table(tmp_path, columns), tmp_path / "out")
    assert not found.mapping.questions and found.mapping.columns["joint1.goal"] == "goal_1*pi/180"
    assert "in the unit of pos_0, whose steps are an encoder's" in " ".join(found.text.replace("#", "").split())


@pytest.mark.parametrize("last", ["gripper", "opening"])
def test_a_share_or_an_opening_of_a_gripper_decides_nothing_for_the_arm(tmp_path: Path, last: str) -> None:
    for low, high in ((0.0, 100.0), (0.0, 1.0)):
        columns = sized({"shoulder": 1.5, "elbow": 1.0})
        share = (LATE - LATE.min()) / np.ptp(LATE)
        columns |= {f"goal_{last}": low + high * np.roll(share, -4), f"pos_{last}": low + high * share}
        (question,) = propose_for(table(tmp_path, columns), tmp_path / "out", "rad").mapping.questions
        assert question.about == (f"{last}.position", f"{last}.goal") and "a share of the calibrated" in question.ask


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
    assert [question.about for question in found.questions] == [("joint.position", "joint.goal"), ("joint.velocity",)]


def test_a_position_that_moves_as_a_goal_in_degrees_is_not_taken_for_rad_in_silence(tmp_path: Path) -> None:
    source = table(tmp_path, {"time_s": TIME, "goal_deg": 4 * ANGLE, "pos": 4 * LATE})
    (question,) = propose_for(source, tmp_path / "out").mapping.questions
    assert question.ask.startswith("degrees (unit=deg)") and question.about == ("joint.position",)
    assert not propose_for(source, tmp_path / "out", "deg").mapping.questions
    source = table(tmp_path, {"time_s": TIME, "goal_deg": 4 * ANGLE, "q": 4 * LATE})
    (question,) = propose_for(source, tmp_path / "out").mapping.questions
    assert question.about == ("joint.goal",) and "in which unit is goal_deg?" in question.ask


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_an_opening_from_0_to_1_is_asked_about_where_other_joints_are_angles(tmp_path: Path, unit: str) -> None:
    """``unit=rad`` took the grippers of an ALOHA for rad."""
    columns = sized({"waist": 60.0 if unit == "deg" else 1.0})
    share = (LATE - LATE.min()) / np.ptp(LATE)
    columns |= {"goal_gripper": np.roll(share, -4), "pos_gripper": share}
    (question,) = propose_for(table(tmp_path, columns), tmp_path / "out", unit).mapping.questions
    assert question.about == ("gripper.position", "gripper.goal") and "opening of 0..1" in question.ask
    columns = sized({"waist": 1.0, "elbow": 1.0})
    columns |= {"goal_elbow": 0.4 + 0.3 * ANGLE, "pos_elbow": 0.4 + 0.3 * LATE}
    assert not propose_for(table(tmp_path, columns), tmp_path / "out", "rad").mapping.questions, "an elbow within 0..1"


DEFAULTS = (0.1, 0.8, -1.5)
MADE = [motion(10.0, 50.0, 0.04, seed=seed) for seed in (3, 4, 5)]


def _proposed(path: Path, columns: Mapping[str, np.ndarray]) -> Proposal:
    table = {"time": MADE[0]["time"], **columns}
    np.savetxt(path / "run.csv", np.stack([*table.values()], axis=1), delimiter=",", header=",".join(table),
               comments="", fmt="%.6f")  # fmt: skip
    return propose(read_recordings(path / "run.csv"))


def _positions(name: str) -> dict[str, np.ndarray]:
    return {name.format(k): made["smooth"] + DEFAULTS[k] for k, made in enumerate(MADE)}


@pytest.mark.parametrize("target", ["dof_target_{}", "joint_pos_setpoints_{}"])
def test_a_target_goes_before_an_action(tmp_path: Path, target: str) -> None:
    """``actions_0`` has the shorter name; it stands 0.8 rad from the position."""
    columns = _positions("dof_pos_{}")
    for k, made in enumerate(MADE):
        columns |= {target.format(k): made["goal"] + DEFAULTS[k], f"actions_{k}": made["goal"]}
    found = _proposed(tmp_path, columns)
    assert [found.columns[f"joint{k}.goal"].text for k in range(3)] == [target.format(k) for k in range(3)]
    assert not found.questions


def test_a_default_angle_between_actions_and_positions_is_asked_about_for_all_of_them(tmp_path: Path) -> None:
    columns = _positions("joint_pos[{}]") | {f"actions[{k}]": made["goal"] for k, made in enumerate(MADE)}
    found = _proposed(tmp_path, columns)
    assert len(found.questions) == 1
    assert set(found.questions[0].about) == {f"joint{k}.goal" for k in range(3)}
    assert found.columns["joint2.goal"].text.replace("`", "") == "actions[2]"


def test_actions_that_are_goals_stay_unasked(tmp_path: Path) -> None:
    columns = {f"joint_pos[{k}]": made["smooth"] for k, made in enumerate(MADE)}
    columns |= {f"actions[{k}]": made["goal"] for k, made in enumerate(MADE)}
    assert not _proposed(tmp_path, columns).questions


def test_axes_of_a_kuka_have_their_torque(tmp_path: Path) -> None:
    columns: dict[str, np.ndarray] = {}
    for k, made in enumerate(MADE, 1):
        columns[f"AxisSoll_A{k} [deg]"] = 57.3 * made["goal"]
        columns[f"AxisIst_A{k} [deg]"] = 57.3 * made["smooth"]
        columns[f"Torque_A{k} [Nm]"] = np.cos(made["time"])
    found = _proposed(tmp_path, columns)
    assert {f"A{k}.{signal}" for k in (1, 2, 3) for signal in ("goal", "position", "torque")} <= found.columns.keys()
