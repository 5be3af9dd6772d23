"""Units of foreign columns: understood whole or asked about, factors among them, and what ``unit=`` is for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.log import LogError
from sealegs.gap.log.importers import import_logs, propose_for
from sealegs.gap.log.importers.expression import evaluate
from sealegs.gap.log.importers.names import said
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


def test_an_answer_that_every_column_contradicts_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="unit=deg is for positions and goals whose unit is open, and none is"):
        propose_for(table(tmp_path, {"time_s": TIME, **RAD}), tmp_path / "out", "deg")


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
