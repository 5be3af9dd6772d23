"""Factors beside the units of columns: understood with their unit, or asked about, and never dropped."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.log.importers import propose_for
from sealegs.gap.log.importers.expression import evaluate
from sealegs.gap.log.importers.names import said
from sealegs.gap.log.importers.unit_words import measure

from tests.importers.test_import_units import ANGLE, DEG, LATE, RAD, TIME, table

COUNTS = np.round(30.0 + 5.0 * np.sin(TIME))


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("current_2.69mA", 2.69e-3),
        ("current 2.69 mA", 2.69e-3),
        ("torque_2.5mNm", 2.5e-3),
        ("vel_1.5rpm", 1.5 * 2.0 * np.pi / 60.0),
        ("pos_1.5deg", 1.5 / DEG),
        ("pos_tenth_deg", 0.1 / DEG),
        ("pos_hundredths_deg", 0.01 / DEG),
        ("pos_deg_tenths", 0.1 / DEG),
        ("pos 1/100 deg", 0.01 / DEG),
        ("pos_1/100deg", 0.01 / DEG),
        ("pos_milli_rad", 1e-3),
        ("pos[10^-3 rad]", 1e-3),
        ("pos [1e-3 rad]", 1e-3),
    ],
)
def test_a_number_before_a_unit_and_a_share_of_a_unit_belong_to_it(name: str, factor: float) -> None:
    spoken = said(name)
    known = measure(spoken.unit)
    assert known is not None and spoken.joint == ""
    assert evaluate(f"1{known.behind}", {}, "test") == pytest.approx(factor, rel=1e-8)


@pytest.mark.parametrize(
    "form",
    [
        "{}_deg_x10", "{}_deg10", "{}_deg_div10", "{}_deg_scaled", "{}_deg_e2", "{}DegX100", "{}_deg_times_100",
        "{} deg (x10)", "{}_deg (0.01)", "{}_deg (10)", "100*{}_deg", "{}_deg*10", "{}_degx10", "{}_rad_per_pi",
        "{}_pi_rad", "{} [0x1 rad]", "{} [rad^-3 deg]",
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
    found = propose_for(table(tmp_path, columns), tmp_path / "out").mapping
    assert not found.questions and len([name for name in found.columns if name.endswith(".goal")]) == 2


def test_a_number_at_the_end_of_the_only_joint_is_its_own_where_another_column_has_it(tmp_path: Path) -> None:
    columns = {"time_s": TIME, "goal_deg10": DEG * ANGLE, "pos_deg10": DEG * LATE, "current10": np.sin(TIME)}
    found = propose_for(table(tmp_path, columns), tmp_path / "out").mapping
    assert not found.questions and found.columns["joint10.position"] == "pos_deg10*pi/180"
