"""Units of foreign columns: understood whole or asked about, encoder steps and shares of a range among them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.checks.columns import check_columns
from sealegs.gap.checks.context import joint_contexts
from sealegs.gap.load.robot import robot_of
from sealegs.gap.load.units import run_in_model_units
from sealegs.gap.log import LogError, read_measured
from sealegs.gap.log.importers import import_logs, propose_for
from sealegs.gap.log.importers.expression import evaluate, measure, unit_of
from sealegs.gap.log.importers.names import said
from sealegs.gap.log.types import JointLog, MeasuredRun

from tests.importers.importing import ANGLE, DEG, LATE, RAD, TIME, asked, proposed, table
from tests.importers.test_import_bags import ROBOT_NAMES, data_set


@pytest.mark.parametrize(
    ("name", "joint", "factor"),
    [
        ("current_uA", "current", 1e-6),
        ("current (µA)", "current", 1e-6),
        ("current_cA", "current", 1e-2),
        ("current (10mA)", "current", 1e-2),
        ("current (kA)", "current", 1e3),
        ("voltage (0.1V)", "voltage", 0.1),
        ("voltage_dV", "voltage", 0.1),
        ("voltage_cV", "voltage", 1e-2),
        ("voltage_kV", "voltage", 1e3),
        ("pos (0.1deg)", "position", 0.1 / DEG),
        ("pos (0,1 deg)", "position", 0.1 / DEG),
        ("pos (0.01deg)", "position", 0.01 / DEG),
        ("pos (pi rad)", "position", np.pi),
        ("pos_cdeg", "position", 0.01 / DEG),
        ("pos_mdeg", "position", 1e-3 / DEG),
        ("pos (millideg)", "position", 1e-3 / DEG),
        ("pos_urad", "position", 1e-6),
        ("pos_um", "position", 1e-6),
        ("pos_inch", "position", 0.0254),
        ("velocity (0.229rpm)", "velocity", 0.229 * 2.0 * np.pi / 60.0),
        ("velocity_rad_min", "velocity", 1.0 / 60.0),
        ("velocity_kdeg_s", "velocity", 1e3 / DEG),
        ("time (10ms)", "time", 1e-2),
        ("time (0.1ms)", "time", 1e-4),
        ("time_10us", "time", 1e-5),
        ("time_100us", "time", 1e-4),
        ("time_min", "time", 60.0),
        ("t_min", "time", 60.0),
        ("time (min)", "time", 60.0),
        ("Time [h]", "time", 3600.0),
        ("torque_kgcm", "torque", 0.0980665),
        ("torque_kg_cm", "torque", 0.0980665),
        ("torque (kgf.cm)", "torque", 0.0980665),
        ("torque (kgf·cm)", "torque", 0.0980665),
        ("torque_Ncm", "torque", 1e-2),
        ("torque (N.cm)", "torque", 1e-2),
        ("torque_Nmm", "torque", 1e-3),
        ("torque (lb-in)", "torque", 0.1129848290),
        ("torque (lbf.ft)", "torque", 1.3558179483),
        ("torque (oz-in)", "torque", 0.0070615518),
        ("torque_N_m", "torque", 1.0),
        ("current_2.69mA", "current", 2.69e-3),
        ("current 2.69 mA", "current", 2.69e-3),
        ("torque_2.5mNm", "torque", 2.5e-3),
        ("vel_1.5rpm", "velocity", 1.5 * 2.0 * np.pi / 60.0),
        ("pos_1.5deg", "position", 1.5 / DEG),
        ("pos[10^-3 rad]", "position", 1e-3),
        ("pos [1e-3 rad]", "position", 1e-3),
    ],
)
def test_a_unit_is_understood_with_its_prefix_its_number_and_its_arm(name: str, joint: str, factor: float) -> None:
    spoken = said(name)
    known = measure(spoken.unit)
    assert (spoken.signal, spoken.joint) == (joint, "") and known is not None
    assert known.factor == pytest.approx(factor, rel=1e-8)
    assert evaluate(f"1{known.behind}", {}, "test") == pytest.approx(factor, rel=1e-8)


@pytest.mark.parametrize("text", ["halfturns", "counts/rev", "deg/s^2", "Hz", "fmA", "left"])
def test_a_unit_that_is_not_understood_to_its_last_letter_is_none(text: str) -> None:
    assert unit_of(text) == ""


@pytest.mark.parametrize("unit", ["deg", "ticks"])
def test_an_answer_that_every_column_contradicts_is_refused(tmp_path: Path, unit: str) -> None:
    with pytest.raises(LogError, match=f"unit={unit} is for positions whose unit is open, and there is none"):
        propose_for(table(tmp_path, {"time_s": TIME, **RAD}), tmp_path / "out", unit)


def test_a_few_samples_far_outside_are_left_out_by_a_line_that_is_offered(tmp_path: Path) -> None:
    lost = np.where((TIME > 3.0) & (TIME < 3.1), -1e10, LATE)
    text = propose_for(table(tmp_path, {"time_s": TIME, **RAD, "pos_rad": lost}), tmp_path / "out").text
    assert "`where: 60 - abs(pos_rad)`" in text


@pytest.mark.parametrize("begins", [0, 70])
def test_a_goal_that_stands_only_where_it_changes_is_held(tmp_path: Path, begins: int) -> None:
    places = np.arange(len(TIME))
    held = np.floor(places / 70.0) % 3
    goal = np.where((places % 70 == 0) & (places >= begins), held, np.nan)
    late = np.concatenate([np.zeros(5), held[:-5]])
    source = table(tmp_path, {"time": TIME, "goal_rad": goal, "pos_rad": late + 1e-3 * np.sin(TIME)})
    proposed = propose_for(source, tmp_path / "out")
    assert proposed.certain.columns["joint.goal"] == "hold(goal_rad)"
    assert proposed.certain.where == ("known(hold(goal_rad))" if begins else None)
    import_logs(source, tmp_path / "out", proposed.certain)
    log = (tmp_path / "out" / "run.csv").read_text().splitlines()
    assert len(log) - 1 == len(TIME) - begins


def test_hold_leaves_what_stands_before_the_first_value_unknown() -> None:
    column = np.array([np.nan, 1.0, np.nan, 2.0, np.nan])
    np.testing.assert_array_equal(evaluate("hold(x)", {"x": column}, "test"), [np.nan, 1.0, 1.0, 2.0, 2.0])


A_TURN = 2.0 * np.pi


def test_a_slow_joint_and_one_at_rest_are_not_asked_about(tmp_path: Path) -> None:
    steps = np.where(TIME % 6.0 < 3.0, 0.5, -0.5)
    slow = np.zeros_like(TIME)
    for k in range(1, len(TIME)):
        slow[k] = slow[k - 1] + 0.01 / 1.0 * (steps[k - 1] - slow[k - 1])
    noise = 1e-3 * np.random.default_rng(0).standard_normal(len(TIME))
    for position in (slow, noise):
        assert "joint.goal" not in asked(proposed(tmp_path, {"time": TIME, "q_des": steps, "q": position}))


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


# --- LeRobot ---------------------------------------------------------------------------------------------------------


def test_the_gains_that_lerobot_sets_are_told_of_the_robots_that_have_them(tmp_path: Path) -> None:
    """A diagnosis with the factory's gain found the converter's error."""
    source = data_set(tmp_path / "data", "v3.0", 180.0 / np.pi, ROBOT_NAMES)
    assert "LeRobot sets P 16, I 0, D 32" in propose_for(source, tmp_path / "log").text
    info = source / "meta" / "info.json"
    info.write_text(info.read_text().replace('"so100"', '"koch_follower"'))
    assert "LeRobot sets" not in propose_for(source, tmp_path / "other").text
