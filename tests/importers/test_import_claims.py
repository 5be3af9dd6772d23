"""A column is claimed by its format, a dialect, or its name and unit; what nobody claims is asked about, never
guessed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.commands.cli import main
from sealegs.gap.load.robot import robot_of
from sealegs.gap.log import LogError, read_measured
from sealegs.gap.log.importers import import_logs, propose_for, read_recordings
from sealegs.gap.log.importers.clocks import clock_fault, in_force
from sealegs.gap.log.importers.dialects import dialects
from sealegs.gap.log.importers.expression import evaluate, lost_sign
from sealegs.gap.log.reader import measured_set
from sealegs.gap.prepare.columns import check_robot, commanded

from tests.importers.importing import ANGLE, LATE, RAD, TIME, asked, proposed, spoken, table

MINE = """
title: My drive
needs: ['{joint}_set']
rows:
- {name: '{joint}_set', signal: goal, unit: 0.1 deg}
- {name: '{joint}_ist', signal: position, unit: 0.1 deg}
- {name: '{joint}_load', signal: duty, sign_bit: 10, formula: '{}/1000'}
- {name: 'diag.*', aside: states of the logger}
"""
TENTH = 1800.0 / np.pi


def drive(folder: Path) -> Path:
    load = np.round(400.0 * np.sin(3.0 * TIME))
    columns = {"time_s": TIME, "hip_set": TENTH * ANGLE, "hip_ist": TENTH * LATE}
    return table(folder, columns | {"hip_load": np.where(load < 0.0, 1024.0 - load, load), "diag1": np.sin(TIME)})


def test_a_load_in_percent_is_asked_about_as_the_duty(tmp_path: Path) -> None:
    """It was left out as a register without a unit, and is what tells most of a servo."""
    load = 40.0 * np.sin(3.0 * TIME)
    found = proposed(tmp_path, RAD | {"load_pct": load})
    assert found.mapping.columns["joint.duty"] == "load_pct/100"
    assert asked(found)["joint.duty"].startswith("Is it the duty, as the load of Feetech's servos is?")


# --- dialects from outside -------------------------------------------------------------------------------------------


def test_a_dialect_of_ones_own_claims_columns_by_one_word_of_the_call(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.yaml").write_text(MINE)
    source, out = drive(tmp_path), tmp_path / "log"
    assert main(["import", str(source), f"out={out}", f"dialect={tmp_path / 'mine.yaml'}"]) == 0
    shown = " ".join(capsys.readouterr().out.replace("#", "").split())
    assert "hip.goal: hip_set*0.1*pi/180" in shown and "My drive says 0.1 deg" in shown
    assert "hip.duty: sign_bit(hip_load, 10)/1000" in shown and "diag1: states of the logger" in shown
    assert "hip.duty" not in propose_for(source, out).mapping.columns


def test_an_installed_package_brings_its_dialect_by_an_entry_point(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine.yaml").write_text(MINE)
    (tmp_path / "mine_package.py").write_text(f"DIALECT = {str(tmp_path / 'mine.yaml')!r}\n")
    installed = tmp_path / "mine_package-1.0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: mine-package\nVersion: 1.0\n")
    (installed / "entry_points.txt").write_text("[sealegs.dialects]\nmine = mine_package:DIALECT\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert "My drive" in {one.title for one in dialects()}
    assert propose_for(drive(tmp_path), tmp_path / "out").mapping.columns["hip.position"] == "hip_ist*0.1*pi/180"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("rows: []", "must be a mapping with the key rows"),
        ("rows: [{name: q}]", "row 1 needs either signal, what the column is, or aside"),
        ("rows: [{name: q, signal: positon}]", r"unknown signal 'positon' \(did you mean 'position'\?\)"),
        ("rows: [{name: q, signal: position, unit: furlong}]", "the unit 'furlong' is none that is known"),
        ("rows: [{name: '(', signal: position}]", "is no regular expression"),
        ("rows: [{name: q, signal: position, formula: '{}*'}]", "is no expression of {}"),
        ("rows: [{nme: q, signal: position}]", "must be a mapping with the key name"),
        ("row: [{name: q, signal: position}]", "must be a mapping with the key rows"),
    ],
)
def test_a_wrong_dialect_gets_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(LogError, match=sentence):
        dialects(tmp_path / "mine.yaml")


# --- asked, not guessed ----------------------------------------------------------------------------------------------


def test_memory_that_nobody_wrote_and_stamps_that_repeat_are_left_out_by_name(tmp_path: Path) -> None:
    effort = np.where(np.arange(len(TIME)) % 2, 2.9e-321, 1.04e224)
    time = np.where(np.arange(len(TIME)) == 100, TIME[99], TIME)
    found = proposed(tmp_path, {"time": time, **RAD, "effort": effort, "velocity": 0.0 * TIME})
    assert "effort: it holds" in found.text and "memory that nobody wrote" in found.text
    assert "velocity: a velocity that never changes is not measured" in found.text
    assert found.mapping.where == "later(time)" and not asked(found)
    import_logs(tmp_path / "run.csv", tmp_path / "log", found.mapping)
    assert len((tmp_path / "log" / "run.csv").read_text().splitlines()) == len(TIME)


# --- what is in force ------------------------------------------------------------------------------------------------


def test_a_sample_has_the_command_that_was_in_force_over_most_of_it() -> None:
    at = np.arange(5.0)
    values, late = in_force(at + 0.02, 10.0 * at, at)
    np.testing.assert_array_equal(values, 10.0 * at)
    assert late == pytest.approx(0.02)
    np.testing.assert_array_equal(in_force(at + 0.6, 10.0 * at, at)[0], [np.nan, 0.0, 10.0, 20.0, 30.0])


def test_a_state_and_a_command_in_two_files_are_one_run(tmp_path: Path) -> None:
    table(tmp_path, {"time_s": TIME, "position_rad": LATE}, "state.csv")
    table(tmp_path, {"time_s": TIME + 2e-4, "goal_rad": ANGLE}, "command.csv")
    found = propose_for(tmp_path, tmp_path / "out", robot="bench", actuator="ideal", params={"mass": 0.0})
    assert not asked(found) and "commands of command.csv come 0.0002 (median) after the samples" in found.text
    import_logs(tmp_path, tmp_path / "out", found.mapping)
    joint = read_measured(tmp_path / "out").runs[0].joints["joint"]
    assert joint.goal is not None
    np.testing.assert_allclose(joint.goal, ANGLE, atol=1e-8)


# --- cells, runs and tensors -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("cell", ['"[{:.5f}, {:.5f}]"', "[{:.5f} {:.5f}]"])
def test_cells_that_hold_lists_are_columns_for_each_place(tmp_path: Path, cell: str) -> None:
    rows = (f"{t:.3f},{cell.format(p, -p)},{cell.format(g, -g)}" for t, p, g in zip(TIME, LATE, ANGLE, strict=True))
    (tmp_path / "run.csv").write_text("\n".join(["timestamp,positions,targets", *rows]))
    (recording,) = read_recordings(tmp_path / "run.csv")
    assert list(recording.columns) == ["timestamp", "positions[0]", "positions[1]", "targets[0]", "targets[1]"]
    np.testing.assert_allclose(recording.columns["targets[1]"], -ANGLE, atol=1e-5)


def test_runs_of_json_have_the_rate_that_stands_beside_them(tmp_path: Path) -> None:
    runs = [{"type": name, "actions": ANGLE.tolist(), "angles": LATE.tolist()} for name in ("sine", "steps")]
    (tmp_path / "runs.json").write_text(json.dumps({"config": {"action_hz": 100}, "data": runs}))
    recordings = read_recordings(tmp_path / "runs.json")
    assert [one.name for one in recordings] == ["runs-1", "runs-2"] and recordings[0].facts["type"] == "sine"
    assert propose_for(tmp_path / "runs.json", tmp_path / "out").mapping.columns["time"] == "row/config.action_hz"


def test_tensors_are_read_and_nothing_in_their_file_is_run(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    two = {"time": TIME, "dof_pos": np.stack([LATE, -LATE], 1), "des_dof_pos": np.stack([ANGLE, -ANGLE], 1)}
    tensors = {name: torch.from_numpy(values) for name, values in two.items()}
    torch.save(tensors, tmp_path / "chirp.pt")
    found = propose_for(tmp_path / "chirp.pt", tmp_path / "out")
    assert not asked(found) and "PACE says rad" in " ".join(found.text.split())
    assert found.mapping.columns["joint1.goal"] == "des_dof_pos[1]"
    np.testing.assert_allclose(found.recordings[0].columns["dof_pos[1]"], -LATE)

    class Bad:
        def __reduce__(self) -> tuple[Any, ...]:
            return (Path.touch, (tmp_path / "was_run",))

    torch.save({**tensors, "more": Bad()}, tmp_path / "bad.pt")
    with pytest.raises(LogError, match=r"can run any code; save named arrays"):
        read_recordings(tmp_path / "bad.pt")
    assert not (tmp_path / "was_run").exists()
    (tmp_path / "torn.pt").write_bytes(b"PK\3\4 torn")
    with pytest.raises(LogError, match="is no file of tensors"):
        read_recordings(tmp_path / "torn.pt")


def test_a_tensor_that_repeats_without_an_end_is_refused(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    torch.save({"q": torch.zeros(1).expand(2**40)}, tmp_path / "run.pt")
    with pytest.raises(LogError, match="unpacks to more than"):
        read_recordings(tmp_path / "run.pt")


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
    assert {spoken.joint for spoken in found.values() if spoken.signal} == {"motor0", "motor1", "motor2"}
    assert [found[name].signal for name in goals if name.endswith("q_des")] == ["goal"] * 3


def test_series_with_the_same_signal_or_other_numbers_stay_apart() -> None:
    twice = spoken([f"{side}_joint{k}_{name}" for side in ("left", "right") for k in (1, 2) for name in "q tau"])
    assert {spoken.joint for spoken in twice.values() if spoken.signal} >= {"left_joint1", "right_joint1"}
    fewer = spoken(["joint_pos_0", "joint_pos_1", "joint_pos_2", "motor_torque_0", "motor_torque_1"])
    assert fewer["motor_torque_0"].joint == "motor0"


@pytest.mark.parametrize(
    ("joints", "columns"),
    [
        (("joint_1", "joint_2"), "{}.goal {}.position"),
        (("leftHipYaw", "leftKnee"), "{}_cmd {}_pos"),
        (("Joint-A", "Joint-B"), "{}_cmd {}_pos"),
        (("dof_0", "dof_1"), "{}_pos_target {}_pos"),
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


ARM = """<mujoco><worldbody><body><joint name="shoulder" axis="0 1 0"/><geom size="0.1" pos="0 0 -0.2" mass="1"/>
<body pos="0 0 -0.4"><joint name="gripper" axis="0 1 0"/><geom size="0.1" mass="0.2"/></body></body>
</worldbody></mujoco>"""
GRIPPER = {"gripper.position": 0.5 * LATE, "gripper.torque": 0.1 * ANGLE}
SHOULDER = {"shoulder.goal": ANGLE, "shoulder.position": LATE}


def runs_of(folder: Path, columns: dict[str, np.ndarray]):
    (folder / "arm.xml").write_text(ARM)
    return measured_set([{"time": TIME, **columns}], {"robot": str(folder / "arm.xml")}, "log").runs


def test_only_the_joint_that_was_commanded_is_judged(tmp_path: Path) -> None:
    """The gripper's torque ended the diagnosis of the whole arm."""
    runs = runs_of(tmp_path, SHOULDER | GRIPPER)
    robot = robot_of(runs[0])
    assert robot is not None and commanded(runs) == ["shoulder"]
    (note,) = check_robot(runs, robot)
    assert note.code == "robot.uncommanded" and "gripper was logged (a measured torque is none)" in note.sentence


def test_a_robot_without_any_command_is_refused_with_what_to_log(tmp_path: Path) -> None:
    runs = runs_of(tmp_path, {"shoulder.position": LATE, "shoulder.torque": ANGLE} | GRIPPER)
    robot = robot_of(runs[0])
    assert robot is not None
    with pytest.raises(LogError, match=r"no joint can be judged; log what each joint was told as shoulder\.goal"):
        check_robot(runs, robot)


SLOW = np.interp(TIME, TIME, np.where(np.sin(2.0 * TIME) > 0.0, 0.6, -0.6))


@pytest.mark.parametrize("order", [1, -1])
def test_of_two_positions_the_one_that_goes_as_far_as_the_goal_is_the_joints(tmp_path: Path, order: int) -> None:
    """A motor before a gear of 50 was taken for its joint where its column came first."""
    columns = {"goal_rad": ANGLE, "motor_pos_rad": 50.0 * LATE, "joint_pos_rad": LATE}
    found = proposed(tmp_path, dict([*columns.items()][::order])).mapping
    assert found.columns["joint.position"] == "joint_pos_rad" and not found.questions


@pytest.mark.parametrize("order", [1, -1])
def test_of_two_goals_the_one_that_the_position_follows_drove_it(tmp_path: Path, order: int) -> None:
    """The end points of a motion were taken for the goals that led there."""
    columns = {"target_rad": SLOW, "setpoint_rad": ANGLE, "pos_rad": LATE}
    found = proposed(tmp_path, dict([*columns.items()][::order])).mapping
    assert found.columns["joint.goal"] == "setpoint_rad" and not found.questions


def test_a_position_that_goes_far_beyond_its_goal_is_asked_about(tmp_path: Path) -> None:
    (ask,) = asked(proposed(tmp_path, {"goal_rad": ANGLE, "pos_rad": 20.0 * LATE})).values()
    assert "moves 20 times as far, as that of a motor before its gear" in ask
    assert not asked(proposed(tmp_path, {"goal_rad": ANGLE, "pos_rad": 0.7 * LATE}))


def test_a_velocity_of_the_other_sign_is_asked_about(tmp_path: Path) -> None:
    speed = np.gradient(LATE, TIME)
    found = asked(proposed(tmp_path, {**RAD, "vel_rad_s": -speed}))
    assert "Write -vel_rad_s" in found["joint.velocity"]
    assert not asked(proposed(tmp_path, {**RAD, "vel_rad_s": speed}))


def test_a_voltage_that_changes_its_sign_is_no_supply(tmp_path: Path) -> None:
    found = proposed(tmp_path, {**RAD, "voltage_V": 4.0 * np.sin(TIME)})
    assert "joint.voltage" not in found.mapping.columns and "no voltage of the supply" in found.text
    assert "joint.voltage" in proposed(tmp_path, {**RAD, "voltage_V": 7.4 + 0.1 * np.sin(TIME)}).mapping.columns


@pytest.mark.parametrize(("bits", "reading"), [(16, "signed16({})"), (32, "signed32({})"), (16, "sign_bit({}, 15)")])
def test_a_register_whose_sign_was_lost_gets_it_back(bits: int, reading: str) -> None:
    """Positions of 51 rad, and a speed that was called memory that nobody wrote."""
    true = np.round(500.0 * ANGLE)
    lost = np.where(true < 0.0, 2.0 ** (bits - 1) - true if "bit" in reading else 2.0**bits + true, true)
    assert lost_sign(lost) == reading
    np.testing.assert_array_equal(evaluate(reading.replace("{}", "x"), {"x": lost}, "here"), true)
    for other in (
        true,
        np.abs(true),
        2.0 ** (bits - 1) + 5000.0 * np.abs(np.round(ANGLE)),
        np.arange(2.0**15, 2.0**16),
    ):
        assert lost_sign(other) == ""


def test_a_lost_sign_is_read_back_in_every_line_of_its_column(tmp_path: Path) -> None:
    true = np.round(300.0 * ANGLE)
    found = proposed(tmp_path, {**RAD, "current_mA": np.where(true < 0.0, 65536.0 + true, true)}).mapping
    assert found.columns["joint.current"].startswith("signed16(current_mA)")


def test_counts_of_several_turns_keep_their_question_whatever_unit_is_answered(tmp_path: Path) -> None:
    """`unit=ticks` moved their zero by half a turn, without a word."""
    counts = np.round(4000.0 * LATE) - 3000.0
    found = proposed(tmp_path, {"goal": np.round(4000.0 * ANGLE) - 3000.0, "pos": counts}, "ticks")
    assert "which one is 0 rad" in asked(found)["joint.position"]
    assert not asked(
        proposed(tmp_path, {"goal": np.round(600.0 * ANGLE) + 2048.0, "pos": np.round(600.0 * LATE) + 2048.0}, "ticks")
    )


def test_a_clock_is_told_how_to_go_over_midnight_and_to_leave_out_late_rows() -> None:
    stamps = 86_395.0 + TIME
    over = np.where(stamps >= 86_400.0, stamps - 86_400.0, stamps)
    assert "wrapped(<column>, 86400)" in clock_fault(over)
    np.testing.assert_allclose(evaluate("wrapped(x, 86400)", {"x": over}, "here"), stamps)
    late = TIME.copy()
    late[[40, 41]] = late[[41, 40]]
    assert "later(<column>)" in clock_fault(late)
    again = np.concatenate([TIME, [np.nan], TIME])
    assert f"where: {len(TIME)} - row" in clock_fault(again), "without the row between two recordings"


def test_rows_that_come_twice_are_left_out(tmp_path: Path) -> None:
    often = np.where(np.arange(len(TIME)) % 4, 1, 2)
    twice = {name: np.repeat(values, often) for name, values in {"time": TIME, **RAD}.items()}
    found = proposed(tmp_path, twice).mapping
    assert found.where == "later(time)" and not found.questions


def test_goals_that_come_in_rows_of_their_own_are_held(tmp_path: Path) -> None:
    odd = np.arange(len(TIME)) % 2 == 1
    found = proposed(
        tmp_path, {"goal_rad": np.where(odd, ANGLE, np.nan), "pos_rad": np.where(odd, np.nan, LATE)}
    ).mapping
    assert found.columns["joint.goal"] == "hold(goal_rad)" and "known(pos_rad)" in str(found.where)


def test_an_answer_that_is_none_for_a_column_is_said_to_be_none(tmp_path: Path) -> None:
    """The same question came again after it had been answered."""
    steps = {"goal": np.round(600.0 * ANGLE) + 2048.0, "pos": np.round(600.0 * LATE) + 2048.0}
    assert asked(proposed(tmp_path, steps, "deg"))["joint.position"].startswith("unit=deg does not answer it: ")


@pytest.mark.parametrize(("name", "factor"), [("duty_percent", "/100"), ("duty_permille", "/1000")])
def test_a_duty_in_a_unit_of_shares_becomes_a_share(tmp_path: Path, name: str, factor: str) -> None:
    """A duty in thousandths was called that of a joint 'permille', which has no position."""
    found = proposed(tmp_path, {**RAD, name: 300.0 * ANGLE}).mapping
    assert found.columns["joint.duty"] == f"{name}{factor}" and not found.questions


def test_a_register_that_passes_the_middle_of_its_range_has_no_sign_to_lose(tmp_path: Path) -> None:
    """One recording that crossed 0 made signed16 the reading of another, which then jumped by 65536."""
    near, far = np.round(300.0 * ANGLE) % 65536.0, np.round(2000.0 * ANGLE) + 32768.0
    folder = tmp_path / "runs"
    folder.mkdir()
    for name, values in (("a.csv", near), ("b.csv", far)):
        table(folder, {"time": TIME, **RAD, "current_mA": values}, name)
    found = propose_for(folder, tmp_path / "out").mapping
    assert "signed16" not in found.columns["joint.current"]


def test_a_clock_that_overflows_has_lost_no_sign(tmp_path: Path) -> None:
    stamps = (60_000.0 + 10.0 * np.arange(len(TIME))) % 65536.0
    found = proposed(tmp_path, {"time_ms": stamps, **RAD})
    assert "signed" not in found.text and "counter(<column>)" in asked(found)["time"]


def test_a_reading_is_put_in_for_its_column_alone(tmp_path: Path) -> None:
    lost, late = (np.round(600.0 * values) % 65536.0 for values in (ANGLE, LATE))
    found = proposed(tmp_path, {"goal": lost, "pos": late}, "ticks").mapping
    text = found.columns.get("joint.position", "")
    assert text.count("signed16(pos)") == 1 and "2*pi/4096" in text


def test_a_period_that_is_none_is_told_in_a_sentence() -> None:
    for period in ("x", "0", "-1"):
        with pytest.raises(LogError, match="takes a positive number as its period"):
            evaluate(f"wrapped(x, {period})", {"x": TIME}, "here")
