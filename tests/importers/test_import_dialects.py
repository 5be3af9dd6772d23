"""Dialects and plain words: which joint and which signal the columns of drives, robots and simulators are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.log.importers import propose_for
from sealegs.gap.log.importers.mapping import Mapping
from sealegs.gap.log.importers.names import said

from tests.importers.importing import ANGLE, LATE, TIME, proposed, spoken, table

CURRENT = 3.0 * np.gradient(LATE, TIME)
SECOND = np.sin(5.0 * TIME) * 0.4  # a second joint, which moves otherwise
SECOND_LATE = np.interp(TIME - 0.05, TIME, SECOND)
HELD = 0.0 * TIME


@pytest.mark.parametrize(
    ("column", "signal", "joint"),
    [
        ("q_axis_current", "current", ""),
        ("axis0.q_axis_current", "current", "axis0"),
        ("q_axis1", "position", "axis1"),
        ("q_current", "position", ""),
    ],
)
def test_an_axis_of_a_motor_s_field_is_no_angle(column: str, signal: str, joint: str) -> None:
    assert (said(column).signal, said(column).joint) == (signal, joint)


@pytest.mark.parametrize(
    ("header", "signal"),
    [
        (("q_current", "d_current"), "current"),
        (("qCurrent", "dCurrent"), "current"),
        (("current.q", "current.d"), "current"),
        (("q_current", "motor_position"), "current"),
        (("q_current", "q_target", "gripper_pos"), "position"),
    ],
)
def test_the_table_tells_whether_q_is_an_axis_or_an_angle(header: tuple[str, ...], signal: str) -> None:
    assert spoken(header)[header[0]].signal == signal


def test_the_current_of_the_q_axis_is_taken_before_that_of_the_supply(tmp_path: Path) -> None:
    """It was the position, for its name was shorter than that of the encoder."""
    currents = {"current_in": 0.4 * CURRENT, "d_axis_current": 0.1 * CURRENT, "q_axis_current": CURRENT}
    found = proposed(tmp_path, currents | {"encoder_position": LATE, "target_position": ANGLE})
    assert found.mapping.columns["joint.position"] == "encoder_position"
    assert found.mapping.columns["joint.current"] == "q_axis_current"
    assert (
        "d_axis_current: current or voltage of a motor's d axis" in found.text
        and "current_in: current as well; q_axis_current is taken" in found.text
    )


MOTEUS = {
    "position": LATE / 6.0,
    "velocity": np.gradient(LATE / 6.0, TIME),
    "torque": 0.3 * CURRENT,
    "q_current": CURRENT,
    "d_current": HELD,
    "control_position": ANGLE / 6.0,
    "mode": HELD + 10.0,
    "fault": HELD,
}


@pytest.mark.parametrize("left_out", ["", "control_position", "q_current"])
def test_moteus_counts_turns(tmp_path: Path, left_out: str) -> None:
    """They were taken for rad."""
    columns = {name: values for name, values in MOTEUS.items() if name != left_out}
    goal = {"goal_position": ANGLE / 6.0} if left_out == "control_position" else {}
    found = proposed(tmp_path, columns | goal).mapping
    assert found.columns["joint.position"] == "position*2*pi" and found.columns["joint.velocity"] == "velocity*2*pi"
    assert found.columns["joint.goal"].endswith("_position*2*pi") and not found.questions
    assert found.columns.get("joint.current") == ("q_current" if left_out != "q_current" else None)


def test_rows_of_moteus_drives_in_turn_are_turns_and_have_their_currents(tmp_path: Path) -> None:
    columns = {"time": np.repeat(TIME, 2), "id": np.tile([1.0, 2.0], len(TIME))}
    columns |= {name: np.stack([values, -values], axis=1).ravel() for name, values in MOTEUS.items()}
    found = propose_for(table(tmp_path, columns), tmp_path / "out").mapping
    assert found.columns["joint2.position"] == "joint2.position*2*pi"
    assert found.columns["joint2.current"] == "joint2.q_current"


def test_a_unit_that_is_said_is_kept_beside_registers_of_moteus() -> None:
    registers = ["velocity", "q_current", "d_current", "mode", "fault"]
    together = spoken(["position", "target_rad", *registers])
    assert (together["position"].unit, together["target_rad"].unit, together["velocity"].unit) == (
        "turn",
        "rad",
        "turn/s",
    )
    assert spoken(["position_rad", *registers])["velocity"].unit == ""  # somebody else's header
    assert spoken(["position", "q_current", "d_current"])["position"].unit == ""


def two(form: str, first: np.ndarray, second: np.ndarray) -> dict[str, np.ndarray]:
    return {form.format(0): first, form.format(1): second}


ROBOT = two("dof_pos[{}]", LATE, SECOND_LATE)
TORQUES = (np.sin(9.0 * TIME), np.cos(9.0 * TIME))


def test_a_dof_names_no_joint(tmp_path: Path) -> None:
    columns = {"dof_pos_FL_hip_joint": LATE, "dof_pos_target_FL_hip_joint": ANGLE}
    columns |= {"dof_pos_FR_hip_joint": SECOND_LATE, "dof_pos_target_FR_hip_joint": SECOND}
    found = proposed(tmp_path, columns).mapping
    assert found.columns["FL_hip_joint.goal"] == "dof_pos_target_FL_hip_joint"


def test_joints_of_a_robot_that_are_called_dof_keep_their_names(tmp_path: Path) -> None:
    inner = '<body pos="0 0 1"><joint name="dof_1"/><geom size="0.1" mass="1"/></body>'
    (tmp_path / "robot.xml").write_text(
        f'<mujoco><worldbody><body><joint name="dof_0"/><geom size="0.1" mass="1"/>{inner}</body></worldbody></mujoco>'
    )
    columns = {"time": TIME} | ROBOT | two("dof_pos_target[{}]", ANGLE, SECOND)
    found = propose_for(table(tmp_path, columns), tmp_path / "out", None, str(tmp_path / "robot.xml")).mapping
    assert {"dof_0.position", "dof_1.goal"} <= found.columns.keys()


@pytest.mark.parametrize("form", ["torques[{}]", "applied_torque[{}]", "applied_torque_{}"])
def test_torques_that_an_index_names_go_to_the_joints(tmp_path: Path, form: str) -> None:
    """They were left out, for 'joint0' and 'applied0' had no position."""
    found = proposed(tmp_path, ROBOT | two("dof_pos_target[{}]", ANGLE, SECOND) | two(form, *TORQUES)).mapping
    assert found.columns["joint1.torque"].strip("`") == form.format(1)


def test_a_series_without_a_name_goes_to_the_only_joints_that_are_numbered_alike(tmp_path: Path) -> None:
    robot = two("leg{}_pos", LATE, SECOND_LATE) | two("leg{}_goal", ANGLE, SECOND)
    found = proposed(tmp_path, robot | two("torques[{}]", *TORQUES)).mapping
    assert found.columns["leg1.torque"] == "torques[1]"
    others = two("arm{}_pos", -LATE, -SECOND_LATE) | two("arm{}_goal", -ANGLE, -SECOND)
    both = proposed(tmp_path, robot | others | two("torques[{}]", *TORQUES))
    assert "torques[1]" not in both.mapping.columns.values()
    assert "torques[1]: torque of 'joint1', which has no position" in both.text


def test_actions_that_are_scaled_are_asked_about(tmp_path: Path) -> None:
    """They became goals four times as far as the robot was told, and nobody was asked."""
    found = proposed(tmp_path, ROBOT | two("actions[{}]", 4.0 * ANGLE, 4.0 * SECOND))
    (question,) = found.mapping.questions
    assert question.about == ("joint0.goal", "joint1.goal") and "by which factor" in question.ask


def test_actions_that_positions_follow_are_goals(tmp_path: Path) -> None:
    found = proposed(tmp_path, ROBOT | two("actions[{}]", ANGLE, SECOND)).mapping
    assert found.columns["joint0.goal"] == "actions[0]" and not found.questions


@pytest.mark.parametrize("form", ["target_moment_{}", "computed_torque_{}"])
def test_a_torque_that_a_controller_computed_is_no_command_beside_a_goal(tmp_path: Path, form: str) -> None:
    """It made an impedance drive of a robot that is told positions."""
    robot, torques = two("actual_q_{}", LATE, SECOND_LATE), two(form, *TORQUES)
    found = proposed(tmp_path, robot | two("target_q_{}", ANGLE, SECOND) | torques)
    assert not any(name.endswith("torque_command") for name in found.mapping.columns)
    assert f"{form.format(1)}: torque" in found.text.partition("unused")[2]
    alone = proposed(tmp_path, robot | torques).mapping
    assert alone.columns["joint1.torque_command"] == form.format(1)


SIZES = (1.0, 0.6)
PUSH = np.gradient(np.gradient(LATE, TIME), TIME) + 3.0 * np.sin(LATE)


def numbered(folder: Path, names: dict[str, np.ndarray], clock: str = "time", stamps: np.ndarray = TIME) -> Mapping:
    """The mapping for joints_of 1 and 2, from names with ``{}`` for the number and their values."""
    columns = {name.format(k): size * values for k, size in enumerate(SIZES, 1) for name, values in names.items()}
    return propose_for(table(folder, {clock: stamps} | columns), folder / "out", "rad").mapping


def joints_of(found: Mapping) -> tuple[str, ...]:
    return tuple(name.removesuffix(".position") for name in found.columns if name.endswith(".position"))


def test_an_interpolated_position_is_commanded_and_a_joint_is_one_with_and_without_the_word(tmp_path: Path) -> None:
    """The names of KUKA's FRI made 14 joints_of, and of seven the interpolated command was the measured position."""
    found = numbered(
        tmp_path,
        {
            "measuredJointPosition_A{}": LATE,
            "ipoJointPosition_A{}": 1.02 * ANGLE,
            "commandedJointPosition_A{}": ANGLE,
            "measuredTorque_A{}": PUSH,
        },
    )
    assert joints_of(found) == ("A1", "A2") and not found.questions
    assert found.columns["A1.position"] == "measuredJointPosition_A1"
    assert found.columns["A1.goal"] == "commandedJointPosition_A1"
    assert found.columns["A1.torque"] == "measuredTorque_A1"


def test_two_positions_with_and_without_the_word_joint_are_two_joints() -> None:
    found = spoken(["joint_A1_pos", "A1_pos", "A1_cmd"])
    assert [spoken.joint for spoken in found.values()] == ["joint_A1", "A1", "A1"]


def test_a_planned_angle_is_a_goal(tmp_path: Path) -> None:
    found = numbered(tmp_path, {"J{} Actual (rad)": LATE, "J{} Planned (rad)": ANGLE})
    assert joints_of(found) == ("J1", "J2") and found.columns["J1.goal"] == "`J1 Planned (rad)`"


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
    found = spoken([*names, *goals])
    assert {spoken.joint for spoken in found.values()} == {"motor0", "motor1", "motor2"}
    assert [found[name].signal for name in goals if name.endswith("q_des")] == ["goal"] * 3


def test_a_message_s_name_says_which_of_two_angles_is_the_goal(tmp_path: Path) -> None:
    found = numbered(tmp_path, {"lowstate.motor_state[{}].q": LATE, "lowcmd.motor_cmd[{}].q": ANGLE})
    assert joints_of(found) == ("motor1", "motor2") and not found.questions
    assert found.columns["motor1.goal"] == "lowcmd.motor_cmd[1].q"


def test_series_with_the_same_signal_or_other_numbers_stay_apart() -> None:
    twice = spoken([f"{side}_joint{k}_{name}" for side in ("left", "right") for k in (1, 2) for name in "q tau"])
    assert {spoken.joint for spoken in twice.values() if spoken.signal} >= {"left_joint1", "right_joint1"}
    fewer = spoken(["joint_pos_0", "joint_pos_1", "joint_pos_2", "motor_torque_0", "motor_torque_1"])
    assert fewer["motor_torque_0"].joint == "motor0"


def test_torques_of_as_many_motors_are_of_the_joints(tmp_path: Path) -> None:
    """Each was the torque of a motor without a position."""
    columns = {f"{name}[{k}]": LATE for k in range(3) for name in ("joint_positions", "motor_torques_measured")}
    goals = {f"joint_goals[{k}]": ANGLE for k in range(3)}
    assert proposed(tmp_path, columns | goals).mapping.columns["joint2.torque"] == "motor_torques_measured[2]"
    faster = {f"motor_velocity[{k}]": np.gradient(LATE, TIME) for k in range(3)}  # before a gear
    positions = {name: values for name, values in columns.items() if "positions" in name}
    assert "joint2.velocity" not in proposed(tmp_path, positions | goals | faster).mapping.columns


@pytest.mark.parametrize("names", [("leader_joint{}", "follower_joint{}"), ("master_{}_pos", "puppet_{}_pos")])
def test_an_arm_that_is_led_is_the_goal_of_the_one_that_follows(tmp_path: Path, names: tuple[str, str]) -> None:
    """One joint of two was dropped, for its numbers did not go with a motion."""
    found = numbered(tmp_path, {names[0]: ANGLE, names[1]: LATE})
    assert joints_of(found) == ("joint1", "joint2") and not found.questions
    assert found.columns["joint2.goal"] == names[0].format(2)
    assert found.columns["joint2.position"] == names[1].format(2)


def test_an_arm_that_leads_is_no_goal_where_the_one_that_follows_has_one_or_none_follows() -> None:
    both = spoken(["leader_1_pos", "leader_1_torque", "follower_1_pos", "follower_1_goal"])
    signals = ["position of the arm that leads", "torque of the arm that leads", "position", "goal"]
    assert [one.signal or one.aside for one in both.values()] == signals
    alone = spoken(["leader_1_pos", "leader_1_goal"])
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
    """Six coordinates of a tool became six joints_of in rad with goals, and nobody was asked."""
    assert said(name).aside.endswith("of the tool, no joint")


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
    found = numbered(tmp_path, {"state.q[{}]": LATE, "cmd.q_d[{}]": ANGLE})
    assert joints_of(found) == ("joint1", "joint2") and found.columns["joint1.goal"] == "cmd.q_d[1]"


def test_a_t_between_frames_is_no_time_and_a_duration_is_one(tmp_path: Path) -> None:
    """A pose said that it was the time, and the clock beside it was not taken."""
    names = {"state.q[{}]": LATE, "cmd.q_d[{}]": ANGLE, "state.O_T_EE[{}]": np.cos(LATE)}
    found = numbered(tmp_path, names, "duration", np.arange(len(TIME)))
    (question,) = found.questions
    assert question.about == ("time",) and "does it count samples?" in question.ask
    assert found.columns["time"] == "duration*1e-3"
    assert said("t_wall").signal == said("left_t").signal == said("robot.T").signal == "time"


def test_a_duration_of_each_cycle_is_summed(tmp_path: Path) -> None:
    jitter = 0.01 + 1e-4 * np.sin(np.arange(len(TIME)))
    found = numbered(tmp_path, {"q_{}": LATE, "q_des_{}": ANGLE}, "duration", jitter)
    assert found.columns["time"] == "cumsum(duration)"


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
    assert any("a share of the calibrated range" in question.ask for question in found.questions)


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
