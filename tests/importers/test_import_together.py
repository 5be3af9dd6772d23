"""Joints by all names of a table: series of several messages, arms that follow others, tools, which are no joint."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.log.importers import propose_for
from sealegs.gap.log.importers.in_table import said_together
from sealegs.gap.log.importers.mapping import Mapping
from sealegs.gap.log.importers.names import said

from tests.importers.test_import_units import ANGLE, LATE, TIME, table

SIZES = (1.0, 0.6)
PUSH = np.gradient(np.gradient(LATE, TIME), TIME) + 3.0 * np.sin(LATE)


def proposed(folder: Path, names: dict[str, np.ndarray], clock: str = "time", stamps: np.ndarray = TIME) -> Mapping:
    """The mapping for joints 1 and 2, from names with ``{}`` for the number and their values."""
    columns = {name.format(k): size * values for k, size in enumerate(SIZES, 1) for name, values in names.items()}
    return propose_for(table(folder, {clock: stamps} | columns), folder / "out", "rad").mapping


def joints(found: Mapping) -> tuple[str, ...]:
    return tuple(name.removesuffix(".position") for name in found.columns if name.endswith(".position"))


def test_an_interpolated_position_is_commanded_and_a_joint_is_one_with_and_without_the_word(tmp_path: Path) -> None:
    """The names of KUKA's FRI made 14 joints, and of seven the interpolated command was the measured position."""
    found = proposed(
        tmp_path,
        {
            "measuredJointPosition_A{}": LATE,
            "ipoJointPosition_A{}": 1.02 * ANGLE,
            "commandedJointPosition_A{}": ANGLE,
            "measuredTorque_A{}": PUSH,
        },
    )
    assert joints(found) == ("A1", "A2") and not found.questions
    assert found.columns["A1.position"] == "measuredJointPosition_A1"
    assert found.columns["A1.goal"] == "commandedJointPosition_A1"
    assert found.columns["A1.torque"] == "measuredTorque_A1"


def test_two_positions_with_and_without_the_word_joint_are_two_joints() -> None:
    found = said_together(["joint_A1_pos", "A1_pos", "A1_cmd"])
    assert [spoken.joint for spoken in found.values()] == ["joint_A1", "A1", "A1"]


def test_a_planned_angle_is_a_goal(tmp_path: Path) -> None:
    found = proposed(tmp_path, {"J{} Actual (rad)": LATE, "J{} Planned (rad)": ANGLE})
    assert joints(found) == ("J1", "J2") and found.columns["J1.goal"] == "`J1 Planned (rad)`"


@pytest.mark.parametrize(
    ("state", "command"),
    [
        ("lowstate.motor_state[{}]", "lowcmd.motor_cmd[{}]"),
        ("armstate.motor[{}]", "armcmd.motor[{}]"),
    ],
)
def test_states_and_commands_of_one_numbered_series_are_of_the_same_joints(state: str, command: str) -> None:
    """Each joint was asked what was commanded to it, and goals and gains were left out."""
    names = [f"{state.format(k)}.{name}" for k in range(3) for name in ("q", "dq", "tau_est", "temperature")]
    goals = [f"{command.format(k)}.{name}" for k in range(3) for name in ("q_des", "kp", "kd")]
    found = said_together([*names, *goals])
    assert {spoken.joint for spoken in found.values()} == {"motor0", "motor1", "motor2"}
    assert [found[name].signal for name in goals if name.endswith("q_des")] == ["goal"] * 3


def test_a_message_s_name_says_which_of_two_angles_is_the_goal(tmp_path: Path) -> None:
    found = proposed(tmp_path, {"lowstate.motor_state[{}].q": LATE, "lowcmd.motor_cmd[{}].q": ANGLE})
    assert joints(found) == ("motor1", "motor2") and not found.questions
    assert found.columns["motor1.goal"] == "lowcmd.motor_cmd[1].q"


def test_series_with_the_same_signal_or_other_numbers_stay_apart() -> None:
    twice = said_together([f"{side}_joint{k}_{name}" for side in ("left", "right") for k in (1, 2) for name in "q tau"])
    assert {spoken.joint for spoken in twice.values() if spoken.signal} >= {"left_joint1", "right_joint1"}
    fewer = said_together(["joint_pos_0", "joint_pos_1", "joint_pos_2", "motor_torque_0", "motor_torque_1"])
    assert fewer["motor_torque_0"].joint == "motor0"


def test_torques_of_as_many_motors_are_of_the_joints() -> None:
    """DROID calls them so; each was the torque of a motor without a position."""
    names = [f"{name}[{k}]" for k in range(3) for name in ("joint_positions", "motor_torques_measured")]
    assert {spoken.joint for spoken in said_together(names).values()} == {"joint0", "joint1", "joint2"}
    faster = [f"{name}[{k}]" for k in range(3) for name in ("joint_positions", "motor_velocity")]  # before a gear
    assert "motor0" in {spoken.joint for spoken in said_together(faster).values()}


@pytest.mark.parametrize("names", [("leader_joint{}", "follower_joint{}"), ("master_{}_pos", "puppet_{}_pos")])
def test_an_arm_that_is_led_is_the_goal_of_the_one_that_follows(tmp_path: Path, names: tuple[str, str]) -> None:
    """One joint of two was dropped, for its numbers did not go with a motion."""
    found = proposed(tmp_path, {names[0]: ANGLE, names[1]: LATE})
    assert joints(found) == ("joint1", "joint2") and not found.questions
    assert found.columns["joint2.goal"] == names[0].format(2)
    assert found.columns["joint2.position"] == names[1].format(2)


def test_an_arm_that_leads_is_no_goal_where_the_one_that_follows_has_one_or_none_follows() -> None:
    both = said_together(["leader_1_pos", "leader_1_torque", "follower_1_pos", "follower_1_goal"])
    signals = ["position of the arm that leads", "torque of the arm that leads", "position", "goal"]
    assert [spoken.signal for spoken in both.values()] == signals
    alone = said_together(["leader_1_pos", "leader_1_goal"])
    assert [spoken.signal for spoken in alone.values()] == ["position", "goal"]


@pytest.mark.parametrize(
    "name",
    [
        "observation.robot_state.cartesian_position[0]",
        "action.cartesian_velocity[3]",
        "robot0_eef_pos[1]",
        "ee_pose[2]",
        "actual_TCP_force_1",
        "state.O_T_EE[0]",
        "F_T_NE[4]",
    ],
)
def test_where_a_tool_is_is_no_joint(name: str) -> None:
    """Six coordinates of a tool became six joints in rad with goals, and nobody was asked."""
    assert said(name).signal.endswith("of the tool, no joint")


def test_a_joint_of_a_tool_is_one() -> None:
    assert said("joint_ee_pos").signal == "position" and said("ee_motor_current").signal == "current"


def test_a_latency_that_is_logged_with_an_action_is_no_goal() -> None:
    assert said("action.robot_state.prev_controller_latency_ms").signal == ""


@pytest.mark.parametrize(
    ("name", "signal", "unit"),
    [
        ("Istwinkel / °", "position", "deg"),
        ("Winkel ° 2", "position", "deg"),
        ("Drehzahl / °/s", "velocity", "deg/s"),
        ("Temperatur / °C", "temperature", "degC"),
    ],
)
def test_a_sign_for_degrees_is_a_unit_wherever_it_stands(name: str, signal: str, unit: str) -> None:
    """It was the name of the joint."""
    assert (said(name).signal, said(name).unit) == (signal, unit) and "°" not in said(name).joint


def test_an_indexed_d_beside_a_word_for_commands_is_the_wanted_one(tmp_path: Path) -> None:
    """``cmd.q_d[0]`` was the goal of a joint d0, which has no position."""
    found = proposed(tmp_path, {"state.q[{}]": LATE, "cmd.q_d[{}]": ANGLE})
    assert joints(found) == ("joint1", "joint2") and found.columns["joint1.goal"] == "cmd.q_d[1]"
    assert said("cmd_q_d").joint == "d"


def test_a_t_between_frames_is_no_time_and_a_duration_is_one(tmp_path: Path) -> None:
    """A pose said that it was the time, and the clock beside it was not taken."""
    names = {"state.q[{}]": LATE, "cmd.q_d[{}]": ANGLE, "state.O_T_EE[{}]": np.cos(LATE)}
    found = proposed(tmp_path, names, "duration", np.arange(len(TIME)))
    (question,) = found.questions
    assert question.about == ("time",) and "does it count samples?" in question.ask
    assert found.columns["time"] == "duration*1e-3"
    assert said("t_wall").signal == said("left_t").signal == said("robot.T").signal == "time"


def test_a_duration_of_each_cycle_is_summed(tmp_path: Path) -> None:
    jitter = 0.01 + 1e-4 * np.sin(np.arange(len(TIME)))
    found = proposed(tmp_path, {"q_{}": LATE, "q_des_{}": ANGLE}, "duration", jitter)
    assert found.columns["time"] == "cumsum(duration)"
