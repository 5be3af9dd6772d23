"""Small recordings, headers and units are read as they are meant."""

from __future__ import annotations

import re
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from sealegs.commands.cli import main
from sealegs.gap.checks.columns import check_columns
from sealegs.gap.checks.context import joint_contexts
from sealegs.gap.checks.data_set import check_set, merged
from sealegs.gap.load.robot import robot_of
from sealegs.gap.load.units import run_in_model_units
from sealegs.gap.log import LogError, MeasuredSet, read_measured
from sealegs.gap.log.importers import import_logs, propose_for, read_mapping
from sealegs.gap.log.importers.expression import evaluate, measure, unit_of
from sealegs.gap.log.importers.names import said
from sealegs.gap.log.types import JointLog, MeasuredRun

from benchmarks import import_headers
from benchmarks.import_headers import columns_of, motions, written
from tests.importers.importing import ANGLE, DEG, LATE, RAD, TIME, asked, proposed, table
from tests.importers.test_import_bags import ROBOT_NAMES, data_set

# --- files beside the checkout ---------------------------------------------------------------------------------------


@pytest.fixture
def cases(measured_data: Path) -> Path:
    folder = measured_data / "cases"
    if not folder.is_dir():
        pytest.skip(f"needs the small recordings in {folder.name} of the measured data beside the checkout")
    return folder


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        ("list_cells_a/run.csv", {"joint0.position": "positions[0]", "joint1.goal": "targets[1]"}),
        ("list_cells_b/run.csv", {"joint0.position": "positions[0]", "joint1.goal": "targets[1]"}),
        ("json_runs/runs.json", {"time": "row/config.action_hz"}),
        ("moving_flag/run.csv", {"joint.torque": None}),
        ("pace_pt/chirp_data.pt", {"joint11.position": "dof_pos[11]", "joint0.goal": "des_dof_pos[0]"}),
        ("state_and_command", {"joint.position": "position_rad", "joint.goal": "goal_rad"}),
        ("repeated_stamp/run.csv", {"joint.position": "position", "joint.goal": "goal"}),
        ("zero_velocity_garbage_effort", {"j1.position": "joint_states.j1.position", "j1.velocity": None,
                                          "j2.torque": None}),
        ("registers/run.csv", {"joint.duty": "sign_bit(Present_Load, 10)*1e-3",
                               "joint.current": "sign_bit(Present_Current, 15)*0.0065",
                               "joint.velocity": "sign_bit(Present_Velocity, 15)*2*pi/4096", "joint.torque": None}),
    ],
)  # fmt: skip
def test_a_small_recording_is_read_as_it_is_meant(
    cases: Path, tmp_path: Path, name: str, lines: dict[str, str | None]
) -> None:
    columns = propose_for(cases / "headers" / name, tmp_path / "out").mapping.columns
    assert {column: columns.get(column) for column in lines} == lines


def test_each_row_of_a_bag_has_the_command_in_force_over_most_of_it(cases: Path, tmp_path: Path) -> None:
    """Commands 0.2 ms after the states went to the next row, 9.8 ms old."""
    found = propose_for(cases / "bag_offset" / "bag" / "train", tmp_path / "out", robot="bench", actuator="ideal")
    assert "commands of /joint_command come 0.2 ms (median) after the samples" in " ".join(found.text.split())
    import_logs(cases / "bag_offset" / "bag" / "train", tmp_path / "out", found.mapping)
    (run,), (wanted,) = (read_measured(folder).runs for folder in (tmp_path / "out", cases / "bag_offset" / "as_csv"))
    for joint, log in wanted.joints.items():
        goal = run.joints[joint].goal
        assert goal is not None and log.goal is not None
        np.testing.assert_allclose(goal, log.goal[-len(goal) :], atol=1e-7)


def test_the_mapping_of_so101_has_the_gain_that_its_publisher_set(measured_data: Path, tmp_path: Path) -> None:
    """It knew P 16, and wrote the chain of the factory's P 32."""
    import_logs(measured_data / "so101_arm" / "chirp_sweep.parquet", tmp_path / "out", read_mapping("so101"))
    said = yaml.safe_load((tmp_path / "out" / "log.yaml").read_text())["actuators"]
    assert {chain[1]["position_p"]["gain"] for chain in said.values()} == {2.65} and len(said) == 6


# --- what is set aside by name ---------------------------------------------------------------------------------------


DATA = Path(__file__).resolve().parents[2] / "../shared/data"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"no measured data in {DATA}")


@pytest.fixture(scope="module")
def xl330(tmp_path_factory: pytest.TempPathFactory) -> MeasuredSet:
    target = tmp_path_factory.mktemp("xl330")
    import_logs(DATA / "xl330_pendulum", target, read_mapping("xl330"))
    return read_measured(target)


@pytest.fixture(scope="module")
def so101(tmp_path_factory: pytest.TempPathFactory) -> MeasuredSet:
    target = tmp_path_factory.mktemp("so101")
    import_logs(DATA / "so101_arm", target, read_mapping("so101"))
    return read_measured(target)


@pytest.fixture(scope="module")
def ak80(tmp_path_factory: pytest.TempPathFactory) -> MeasuredSet:
    target = tmp_path_factory.mktemp("ak80")
    import_logs(DATA / "ak80_pendulum", target, read_mapping("ak80"))
    return read_measured(target)


@needs_data
def test_xl330_firmware_law_holds_to_a_count(xl330: MeasuredSet) -> None:
    assert len(xl330.runs) == 12
    assert {run.meta["group"] for run in xl330.runs} == {"kp100", "kp200", "kp400"}
    for run in (run for run in xl330.runs if run.meta["group"] == "kp100"):
        log = run.joints["servo"]
        chain = run.actuators["servo"]
        assert isinstance(chain, list) and log.goal is not None and log.duty is not None
        on = np.ones(len(run.time), bool) if log.enabled is None else log.enabled > 0.5
        gain = chain[0]["position_p"]["gain"]
        # Position and duty are read one after the other, 2 ms apart, and the firmware counts in whole ticks.
        later = np.interp(run.time + 0.002, run.time, log.position)
        miss = 885 * np.abs(np.clip(gain * (log.goal - later), -1, 1) - log.duty)[on]
        assert np.median(miss) < 1.0, run.name
        assert np.quantile(miss, 0.9) < 1.5, run.name


@needs_data
def test_xl330_drop_is_marked_as_switched_off(xl330: MeasuredSet) -> None:
    run = next(run for run in xl330.runs if run.name == "xl330_kp100_lift_and_drop")
    log = run.joints["servo"]
    assert log.enabled is not None and log.duty is not None
    assert run.time[np.argmin(log.enabled)] == pytest.approx(2.0, abs=0.01)
    assert np.abs(log.duty[log.enabled < 0.5]).max() == 0.0


@needs_data
def test_xl330_supply_reading_is_called_aliased(xl330: MeasuredSet) -> None:
    findings = {finding.code: finding for finding in merged(check_set(xl330))}
    assert "voltage.aliased" in findings
    assert findings["velocity.lag"].value == pytest.approx(0.020, abs=0.002)
    assert not [finding for finding in findings.values() if finding.severity == "error"]


@needs_data
@pytest.mark.long
def test_so101_velocity_scale_and_unsigned_current_are_named(so101: MeasuredSet) -> None:
    findings = check_set(so101)
    scales = {
        joint: [f.value for f in findings if f.code == "velocity.scale" and f.joint == joint and f.value is not None]
        for joint in so101.runs[0].joints
        if joint != "gripper"
    }
    for joint, values in scales.items():
        assert values, joint
        assert np.median(values) == pytest.approx(0.93, abs=0.03), joint
    late = [f.value for f in findings if f.code == "velocity.lag" and f.value is not None]
    assert np.median(late) == pytest.approx(0.018, abs=0.003)
    assert {f.joint for f in findings if f.code == "current.unsigned"} == set(so101.runs[0].joints)


@needs_data
def test_ak80_torque_column_is_out_of_step_by_8_to_12_ms(ak80: MeasuredSet) -> None:
    findings = [finding for finding in check_set(ak80) if finding.cause == "sensor.delay"]
    torque = [finding for finding in findings if finding.column == "servo.torque"]
    assert len(torque) == 1
    assert torque[0].value is not None and 0.006 < torque[0].value < 0.014
    assert torque[0].low is not None and torque[0].high is not None
    assert torque[0].low < 0.012 and torque[0].high > 0.008


@needs_data
def test_the_command_line_converts_once_and_overwrites_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["import", "ak80", str(DATA / "ak80_pendulum"), str(tmp_path)]
    assert main(words) == 0
    assert main(words) == 2
    error = capsys.readouterr().err
    assert "never overwritten" in error and error.count("\n") == 1


def test_a_wrong_folder_gets_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["import", "xl330", str(tmp_path / "absent"), str(tmp_path / "out")]) == 2
    assert "no such file or folder" in capsys.readouterr().err
    (tmp_path / "a.csv").write_text("time,position\n0,1\n")
    with pytest.raises(LogError, match="the mapping takes torque, velocity, which it does not have"):
        import_logs(tmp_path, tmp_path / "out", read_mapping("ak80"))
    (tmp_path / "mine.yaml").write_text("columns: {time: time, knee.position: positoin}\n")
    with pytest.raises(LogError, match=r"positoin \(did you mean 'position'\?\), which it does not have"):
        import_logs(tmp_path / "a.csv", tmp_path / "out", read_mapping(tmp_path / "mine.yaml"))


# --- what the import makes of headers, one a row of ``headers.yaml``, and of names, one a line of ``names.yaml`` -----

HERE = Path(__file__).parent
RADIANS = "time_s: t; goal_rad: g; pos_rad: p"
VALUES = motions()


def header_cases() -> list[Any]:
    """Each header as a case, of several forms each of them."""
    found = []
    for case in yaml.safe_load((HERE / "headers.yaml").read_text(encoding="utf-8")):
        for form in case.get("forms", [""]):
            name = f"{case['test']} [{form}]" if form else case["test"]
            found.append(pytest.param(case, form, id=name.replace(" ", "-")))
    return found


def in_form(text: str, form: str) -> str:
    """A text whose ``<word>`` is the form with that word in it; of a form with ``{{}}`` ``<1>`` is its second joint."""
    own = form.replace("{{}}", "{}")

    def filled(match: re.Match[str]) -> str:
        return own.format(match[1]) if match[1] and "{}" in own else own

    return re.sub(r"<(\w*)>", filled, text) if form else text


@pytest.mark.parametrize(("case", "form"), header_cases())
def test_a_header_is_claimed_and_asked_about_as_its_row_says(case: dict[str, Any], form: str, tmp_path: Path) -> None:
    source = written(tmp_path, "run.csv", columns_of(in_form(case["header"].replace("RAD", RADIANS), form), VALUES))
    found = propose_for(source, tmp_path / "out", case.get("unit"))
    lines, text = found.mapping.columns, " ".join(found.text.replace("#", "").replace("''", "'").split())
    for column, line in case.get("lines", {}).items():
        assert fnmatchcase(lines.get(column) or "-", pattern(in_form(line or "-", form))), text
    asked = {name for question in found.mapping.questions for name in question.about}
    if (wanted := case.get("asked", [])) != "any":
        assert len(asked) == len(wanted) or wanted == ["joint.*"], text
        assert all(any(fnmatchcase(name, one) for name in asked) for one in wanted), text
    assert {name.rpartition(".")[2] for name in lines} >= set(case.get("has", []))
    for words in listed(case.get("says", [])):
        assert in_form(words, form) in text, text
    for words in listed(case.get("silent", [])):
        assert words not in text


def pattern(line: str) -> str:
    """A line as a pattern: ``...`` stands for anything, and brackets for themselves."""
    return line.replace("[", "[[]").replace("*", "[*]").replace("...", "*")


def listed(words: Any) -> list[str]:
    return [words] if isinstance(words, str) else [str(one) for one in words]


def names() -> list[tuple[str, str, str, str]]:
    """Name of a column, and signal, joint and unit that it says."""
    content = yaml.safe_load((HERE / "names.yaml").read_text(encoding="utf-8"))
    return [(name, *map(str, meant)) for name, meant in content.items()]  # type: ignore[misc]


@pytest.mark.parametrize(("name", "signal", "joint", "unit"), names())
def test_a_name_says_its_signal_its_joint_and_its_unit(name: str, signal: str, joint: str, unit: str) -> None:
    found = said(name)
    assert (found.signal or found.aside, found.joint, found.unit) == (signal, joint, unit)


@pytest.mark.long
def test_no_column_of_the_collected_headers_is_read_otherwise_than_before(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Four in five that were understood still are; ``python -m benchmarks.import_headers`` tells which."""
    monkeypatch.setattr("sys.argv", ["import_headers"])
    assert import_headers.main() == 0
    counted = re.search(r"(\d+) of (\d+) columns understood as before", capsys.readouterr().out)
    assert counted and int(counted[1]) >= 0.8 * int(counted[2])


# --- units ------------------------------------------------------------------------------------------------------------


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
