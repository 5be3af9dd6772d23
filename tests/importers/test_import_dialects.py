"""Dialects and plain words: which joint and which signal the columns of drives, robots and simulators are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.log.importers import propose_for
from sealegs.gap.log.importers.mapping import Mapping

from tests.importers.importing import ANGLE, LATE, TIME, spoken, table

CURRENT = 3.0 * np.gradient(LATE, TIME)
SECOND = np.sin(5.0 * TIME) * 0.4  # a second joint, which moves otherwise
SECOND_LATE = np.interp(TIME - 0.05, TIME, SECOND)
HELD = 0.0 * TIME


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


def test_joints_of_a_robot_that_are_called_dof_keep_their_names(tmp_path: Path) -> None:
    inner = '<body pos="0 0 1"><joint name="dof_1"/><geom size="0.1" mass="1"/></body>'
    (tmp_path / "robot.xml").write_text(
        f'<mujoco><worldbody><body><joint name="dof_0"/><geom size="0.1" mass="1"/>{inner}</body></worldbody></mujoco>'
    )
    columns = {"time": TIME} | ROBOT | two("dof_pos_target[{}]", ANGLE, SECOND)
    found = propose_for(table(tmp_path, columns), tmp_path / "out", None, str(tmp_path / "robot.xml")).mapping
    assert {"dof_0.position", "dof_1.goal"} <= found.columns.keys()


SIZES = (1.0, 0.6)
PUSH = np.gradient(np.gradient(LATE, TIME), TIME) + 3.0 * np.sin(LATE)


def numbered(folder: Path, names: dict[str, np.ndarray], clock: str = "time", stamps: np.ndarray = TIME) -> Mapping:
    """The mapping for joints_of 1 and 2, from names with ``{}`` for the number and their values."""
    columns = {name.format(k): size * values for k, size in enumerate(SIZES, 1) for name, values in names.items()}
    return propose_for(table(folder, {clock: stamps} | columns), folder / "out", "rad").mapping


def joints_of(found: Mapping) -> tuple[str, ...]:
    return tuple(name.removesuffix(".position") for name in found.columns if name.endswith(".position"))


def test_two_positions_with_and_without_the_word_joint_are_two_joints() -> None:
    found = spoken(["joint_A1_pos", "A1_pos", "A1_cmd"])
    assert [spoken.joint for spoken in found.values()] == ["joint_A1", "A1", "A1"]


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


def test_series_with_the_same_signal_or_other_numbers_stay_apart() -> None:
    twice = spoken([f"{side}_joint{k}_{name}" for side in ("left", "right") for k in (1, 2) for name in "q tau"])
    assert {spoken.joint for spoken in twice.values() if spoken.signal} >= {"left_joint1", "right_joint1"}
    fewer = spoken(["joint_pos_0", "joint_pos_1", "joint_pos_2", "motor_torque_0", "motor_torque_1"])
    assert fewer["motor_torque_0"].joint == "motor0"


def test_an_arm_that_leads_is_no_goal_where_the_one_that_follows_has_one_or_none_follows() -> None:
    both = spoken(["leader_1_pos", "leader_1_torque", "follower_1_pos", "follower_1_goal"])
    signals = ["position of the arm that leads", "torque of the arm that leads", "position", "goal"]
    assert [one.signal or one.aside for one in both.values()] == signals
    alone = spoken(["leader_1_pos", "leader_1_goal"])
    assert [spoken.signal for spoken in alone.values()] == ["position", "goal"]


GRID = 360.0 / 4096


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
