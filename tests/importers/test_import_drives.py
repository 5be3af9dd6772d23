"""Names of drives and simulators: axes of a motor's field, turns of moteus, torques and actions of policies, UR."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.log.importers import Proposed, propose_for
from sealegs.gap.log.importers.in_table import said_together
from sealegs.gap.log.importers.names import said

from tests.importers.test_import_units import ANGLE, LATE, TIME, table

CURRENT = 3.0 * np.gradient(LATE, TIME)
SECOND = np.sin(5.0 * TIME) * 0.4  # a second joint, which moves otherwise
SECOND_LATE = np.interp(TIME - 0.05, TIME, SECOND)
HELD = 0.0 * TIME


def proposed(folder: Path, columns: dict[str, np.ndarray], unit: str | None = None) -> Proposed:
    return propose_for(table(folder, {"time": TIME} | columns), folder / "out", unit=unit)


def asked(found: Proposed) -> list[str]:
    return [name for question in found.mapping.questions for name in question.about]


# --- axes of a motor's field -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("column", "signal", "joint"),
    [
        ("q_axis_current", "current", ""),
        ("axis0.q_axis_current", "current", "axis0"),
        ("d_axis_current", "current of a motor's d axis", ""),
        ("q_axis_voltage", "voltage of a motor's q axis", ""),
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
        (("a_current", "d_current"), "current"),
    ],
)
def test_the_table_tells_whether_q_is_an_axis_or_an_angle(header: tuple[str, ...], signal: str) -> None:
    assert said_together(header)[header[0]].signal == signal


def test_a_motor_d_keeps_its_current() -> None:
    assert said_together(["a_current", "d_current"])["d_current"].joint == "d"


def test_the_current_of_the_q_axis_is_taken_before_that_of_the_supply(tmp_path: Path) -> None:
    """It was the position, for its name was shorter than that of the encoder."""
    currents = {"current_in": 0.4 * CURRENT, "d_axis_current": 0.1 * CURRENT, "q_axis_current": CURRENT}
    found = proposed(tmp_path, currents | {"encoder_position": LATE, "target_position": ANGLE})
    assert found.mapping.columns["joint.position"] == "encoder_position"
    assert found.mapping.columns["joint.current"] == "q_axis_current"
    assert "d_axis_current: current of a motor's d axis" in found.text and "current_in: 0.4 times" in found.text


# --- moteus ----------------------------------------------------------------------------------------------------------

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
    spoken = said_together(["position", "target_rad", *registers])
    assert (spoken["position"].unit, spoken["target_rad"].unit, spoken["velocity"].unit) == ("turn", "rad", "turn/s")
    assert said_together(["position_rad", *registers])["velocity"].unit == ""  # somebody else's header
    assert said_together(["position", "q_current", "d_current"])["position"].unit == ""


# --- simulators ------------------------------------------------------------------------------------------------------


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
    factor = float(found.mapping.columns["joint0.goal"].removeprefix("actions[0]*"))
    assert factor == pytest.approx(0.25, rel=0.1)


def test_actions_that_positions_follow_are_goals(tmp_path: Path) -> None:
    found = proposed(tmp_path, ROBOT | two("actions[{}]", ANGLE, SECOND)).mapping
    assert found.columns["joint0.goal"] == "actions[0]" and not found.questions
    degrees = two("dof_pos_deg[{}]", np.degrees(LATE), np.degrees(SECOND_LATE)) | two("actions[{}]", ANGLE, SECOND)
    assert not asked(proposed(tmp_path, degrees))


# --- torques of a controller's model ---------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["target_moment_{}", "computed_torque_{}"])
def test_a_torque_that_a_controller_computed_is_no_command_beside_a_goal(tmp_path: Path, form: str) -> None:
    """It made an impedance drive of a robot that is told positions."""
    robot, torques = two("actual_q_{}", LATE, SECOND_LATE), two(form, *TORQUES)
    found = proposed(tmp_path, robot | two("target_q_{}", ANGLE, SECOND) | torques)
    assert not any(name.endswith("torque_command") for name in found.mapping.columns)
    assert f"{form.format(1)}: torque that a controller computed" in found.text
    alone = proposed(tmp_path, robot | torques).mapping
    assert alone.columns["joint1.torque_command"] == form.format(1)
