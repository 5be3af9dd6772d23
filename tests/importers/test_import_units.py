"""Units of foreign columns: understood whole or asked about, factors among them, and what ``unit=`` is for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.log import LogError
from sealegs.gap.log.importers import import_logs, propose_for, read_recordings
from sealegs.gap.log.importers.expression import evaluate
from sealegs.gap.log.importers.names import said
from sealegs.gap.log.importers.proposal import propose
from sealegs.gap.log.importers.units import measure, unit_of

from tests.importers.importing import ANGLE, DEG, LATE, RAD, TIME, table


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


@pytest.mark.parametrize("name", ["pos_2deg", "pos_deg_min", "clamp_pos", "hip_na"])
def test_a_joint_or_a_least_value_is_no_factor_and_no_unit(name: str) -> None:
    assert said(name).unit in ("deg", "") and said(name).joint


def test_a_unit_of_time_that_says_a_number_makes_seconds(tmp_path: Path) -> None:
    for name, per in (("time_100us", 1e4), ("time (min)", 1.0 / 60.0), ("Time [h]", 1.0 / 3600.0)):
        proposed = propose_for(table(tmp_path, {name: TIME * per, **RAD}), tmp_path / "out")
        assert proposed.mapping.questions == ()
        (recording,) = proposed.recordings
        time = evaluate(proposed.mapping.columns["time"], recording.columns, "test")
        assert time[-1] == pytest.approx(TIME[-1], rel=1e-6)


def test_a_unit_word_that_is_not_known_is_asked_about(tmp_path: Path) -> None:
    columns = {"time_s": TIME, "goal_halfturns": ANGLE / np.pi, "pos_halfturns": LATE / np.pi}
    text = propose_for(table(tmp_path, columns), tmp_path / "out").text
    assert "the name says halfturns, which is no unit of an angle or a way" in text
    proposed = propose_for(table(tmp_path, {"time_s": TIME, **RAD, "torque_foot": ANGLE}), tmp_path / "out")
    (question,) = proposed.mapping.questions
    assert question.about == ("joint.torque",) and "is 'foot' in the name of torque_foot its unit?" in question.ask


def test_the_answer_fills_the_unit_that_is_open_and_no_other(tmp_path: Path) -> None:
    columns = {"time_s": TIME, "lift_cmd_mm": 100 * ANGLE, "lift_pos_mm": 100 * LATE}
    columns |= {"pan_cmd": ANGLE * DEG, "pan_pos": LATE * DEG}
    proposal = propose(read_recordings(table(tmp_path, columns)), "deg")
    assert {name: read.text for name, read in proposal.columns.items() if name != "time"} == {
        "lift.position": "lift_pos_mm*1e-3",
        "lift.goal": "lift_cmd_mm*1e-3",
        "pan.position": "pan_pos*pi/180",
        "pan.goal": "pan_cmd*pi/180",
    }
    assert "unit=deg is for columns that say none" in proposal.columns["lift.position"].why
    for name in ("pan.position", "pan.goal"):
        assert proposal.columns[name].why.startswith("unit= says deg")


def test_a_unit_in_one_of_two_columns_is_kept_against_the_answer(tmp_path: Path) -> None:
    columns = {"t [s]": TIME, "goal [rad]": ANGLE, "pos [deg]": LATE * DEG}
    proposal = propose(read_recordings(table(tmp_path, columns)), "deg")
    assert proposal.columns["joint.goal"].text == "`goal [rad]`"


def test_an_answer_that_every_column_contradicts_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="unit=deg is for positions and goals whose unit is open, and none is"):
        propose_for(table(tmp_path, {"time_s": TIME, **RAD}), tmp_path / "out", "deg")


def test_a_few_samples_far_outside_are_left_out_by_a_line_that_is_offered(tmp_path: Path) -> None:
    lost = np.where((TIME > 3.0) & (TIME < 3.1), -1e10, LATE)
    text = propose_for(table(tmp_path, {"time_s": TIME, **RAD, "pos_rad": lost}), tmp_path / "out").text
    assert "`where: 60 - abs(pos_rad)`" in text


@pytest.mark.parametrize("middle", [50.0, 0.0])
def test_a_share_of_the_range_is_asked_with_what_the_range_is_good_for(tmp_path: Path, middle: float) -> None:
    columns = {"time_s": TIME, "goal_pct": middle + 50 * ANGLE, "pos_pct": middle + 50 * LATE}
    (question,) = propose_for(table(tmp_path, columns), tmp_path / "out").mapping.questions
    for words in (
        "low + <column>/100*(high - low)",
        "middle + <column>/100*(high - low)/2",
        "unit=percent beside robot=",
    ):
        assert words in question.ask


def test_a_joint_that_is_called_as_a_group_of_columns_gets_another_name(tmp_path: Path) -> None:
    columns = {"time_s": TIME, "base_goal_rad": ANGLE, "base_pos_rad": LATE, "arm_goal_rad": LATE, "arm_pos_rad": ANGLE}
    proposed = propose_for(table(tmp_path, columns), tmp_path / "out")
    text = " ".join(proposed.text.replace("#", "").split())
    assert "base_joint, for base.* means no joint in a log" in text
    assert "base_joint.goal" in proposed.mapping.columns
    own = {name.replace("base_", "base_joint_"): values for name, values in columns.items()}
    proposed = propose_for(table(tmp_path, own), tmp_path / "out")
    assert "base_joint.goal" in proposed.mapping.columns and "means no joint" not in proposed.text, "it is called so"


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


def test_no_line_is_offered_that_would_keep_no_sample(tmp_path: Path) -> None:
    odd = np.arange(len(TIME)) % 2 == 0
    columns = {"time_s": TIME, "goal_rad": np.where(odd, ANGLE, np.nan), "pos_rad": np.where(odd, np.nan, LATE)}
    source = table(tmp_path, columns)
    proposed = propose_for(source, tmp_path / "out")
    with pytest.raises(LogError, match="no sample has a value of all of") as caught:
        import_logs(source, tmp_path / "out", proposed.certain)
    assert "where:" not in str(caught.value)


COUNTS = np.round(30.0 + 5.0 * np.sin(TIME))


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("current_2.69mA", 2.69e-3),
        ("current 2.69 mA", 2.69e-3),
        ("torque_2.5mNm", 2.5e-3),
        ("vel_1.5rpm", 1.5 * 2.0 * np.pi / 60.0),
        ("pos_1.5deg", 1.5 / DEG),
        ("pos[10^-3 rad]", 1e-3),
        ("pos [1e-3 rad]", 1e-3),
    ],
)
def test_a_number_before_a_unit_belongs_to_it(name: str, factor: float) -> None:
    spoken = said(name)
    known = measure(spoken.unit)
    assert known is not None and spoken.joint == ""
    assert evaluate(f"1{known.behind}", {}, "test") == pytest.approx(factor, rel=1e-8)


@pytest.mark.parametrize(
    "form",
    [
        "{}_deg_x10", "{}_deg10", "{}_deg_div10", "{}_deg_scaled", "{}_deg_e2", "{}DegX100", "{}_deg_times_100",
        "{} deg (x10)", "{}_deg (0.01)", "{}_deg (10)", "100*{}_deg", "{}_deg*10", "{}_degx10", "{}_rad_per_pi",
        "{}_pi_rad", "{} [0x1 rad]", "{} [rad^-3 deg]", "{}_tenth_deg", "{} 1/100 deg", "{}_milli_rad",
    ],
)  # fmt: skip
def test_a_factor_beside_a_unit_is_asked_about_once_and_names_no_joint(tmp_path: Path, form: str) -> None:
    """It became the name of a joint, and its column wrong by ten or a hundred, without a word."""
    columns = {"time_s": TIME, form.format("goal"): DEG * ANGLE, form.format("pos"): DEG * LATE}
    (question,) = propose_for(table(tmp_path, columns), tmp_path / "out").mapping.questions
    assert question.about == ("joint.position", "joint.goal") and "no unit of an angle or a way" in question.ask


@pytest.mark.parametrize("name", ["current_mA_x10", "torque_x100", "temp_x10", "current_2_69mA", "voltage_3.3V"])
def test_a_factor_of_a_drives_column_is_asked_about(tmp_path: Path, name: str) -> None:
    source = table(tmp_path, {"time_s": TIME, **RAD, name: COUNTS})
    (question,) = propose_for(source, tmp_path / "out").mapping.questions
    assert question.about[0].startswith("joint.") and "which is no unit of a" in question.ask


def test_a_whole_number_before_a_unit_belongs_to_it_where_no_joint_has_it(tmp_path: Path) -> None:
    source = table(tmp_path, {"time_s": TIME, **RAD, "current_5mA": COUNTS})
    assert propose_for(source, tmp_path / "out").mapping.columns["joint.current"] == "current_5mA*0.005"
    joints = {f"{word}_{joint}rad": values for joint in (4, 5) for word, values in (("goal", ANGLE), ("pos", LATE))}
    source = table(tmp_path, {"time_s": TIME, **joints, "current_5mA": COUNTS, "current_4mA": COUNTS})
    found = propose_for(source, tmp_path / "out").mapping
    assert not found.questions and found.columns["joint5.current"] == "current_5mA*1e-3"


@pytest.mark.parametrize(
    "names",
    [
        ["{}_deg9", "{}_deg10"], ["{}_deg_E1", "{}_deg_A1"], ["{}_deg[9]", "{}_deg[10]"], ["{}/9", "{}/10"],
        ["{}_x1", "{}_y1"], ["{}1*", "{}2*"], ["{}_x_9", "{}_x_10"], ["x11_{}", "x12_{}"],
    ],
)  # fmt: skip
def test_numbers_that_tell_joints_apart_are_no_factors(tmp_path: Path, names: list[str]) -> None:
    columns = {"time_s": TIME}
    for name in names:
        columns |= {name.format("goal"): ANGLE, name.format("pos"): LATE}
    unit = None if "_deg" in names[0] else "rad"
    found = propose_for(table(tmp_path, columns), tmp_path / "out", unit).mapping
    assert not found.questions and len([name for name in found.columns if name.endswith(".goal")]) == 2


def test_a_number_at_the_end_of_the_only_joint_is_its_own_where_another_column_has_it(tmp_path: Path) -> None:
    columns = {"time_s": TIME, "goal_deg10": DEG * ANGLE, "pos_deg10": DEG * LATE, "current10": np.sin(TIME)}
    found = propose_for(table(tmp_path, columns), tmp_path / "out").mapping
    assert not found.questions and found.columns["joint10.position"] == "pos_deg10*pi/180"
