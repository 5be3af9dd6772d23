"""Motors that share a bus: rows polled in turn, rows that repeat, and the units of their registers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.log import LogError
from sealegs.gap.log.importers import read_recordings

from tests.importers.importing import ANGLE, DEG, LATE, RAD, TIME, table
from tests.importers.test_import_tables import texts_of, written

SPEED = np.gradient(LATE, TIME)  # [rad/s]


def polled(folder: Path, head: str, apart: float = 0.0) -> Path:
    """Motors with a row for each and time, each read so much later [s] than the one before it."""
    lines = [
        f"{time + k * apart:.6f},{k + 1},{late + 0.1 * k:.6f},{goal:.6f}"
        for time, late, goal in zip(TIME, LATE, ANGLE, strict=True)
        for k in range(3)
    ]
    return written(folder, "\n".join([head, *lines]) + "\n")


@pytest.mark.parametrize("name", ["id", "motor_id", "joint", "servo"])
def test_numbered_motors_that_are_polled_in_turn_are_refused_as_named_ones_are(tmp_path: Path, name: str) -> None:
    said = rf"'{name}' names the joint of each row, and joint3 was read up to 0\.004 away from joint1 in time"
    with pytest.raises(LogError, match=said):
        read_recordings(polled(tmp_path, f"time,{name},pos_rad,cmd_rad", apart=0.002))


def test_a_signal_or_a_state_of_a_motor_that_changes_is_no_name_of_a_joint(tmp_path: Path) -> None:
    path = polled(tmp_path, "time,servo_temperature,pos_rad,cmd_rad", apart=0.002)
    assert len(read_recordings(path)[0].columns["time"]) == 3 * len(TIME)
    held = table(tmp_path, {"time": TIME, "state_id": (TIME % 2.0 > 1.0).astype(float), **RAD}, "held.csv")
    assert "joint.position" in texts_of(held)[0], "a state that holds for many rows is not polled"


def test_a_row_that_repeats_another_is_left_out_with_a_note(tmp_path: Path) -> None:
    path = polled(tmp_path, "time,motor_id,pos_rad,cmd_rad")
    lines = path.read_text().splitlines()
    doubled = written(tmp_path, "\n".join([*lines[:30], lines[29], *lines[30:]]) + "\n")
    columns, _, text = texts_of(doubled)
    assert [name for name in columns if name.endswith("position")] == [f"joint{k}.position" for k in (1, 2, 3)]
    rows = len(lines)
    assert f"# Note: 1 of {rows} rows say once more what one of their joint and time says: left out" in text
    recording = read_recordings(doubled)[0]
    np.testing.assert_allclose(recording.columns["joint2.pos_rad"], LATE + 0.1, atol=1e-6)


def test_rows_of_one_joint_and_time_that_differ_are_refused_with_the_joint_and_the_time(tmp_path: Path) -> None:
    head, *lines = polled(tmp_path, "time,motor_id,pos_rad,cmd_rad").read_text().splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith("4.200000,2,"))
    path = written(tmp_path, "\n".join([head, *lines[: at + 1], "4.200000,2,9.5,0.25", *lines[at + 1 :]]) + "\n")
    said = r"'motor_id' names the joint of each row, and joint2 has two rows at time = 4\.2, which differ in pos_rad"
    with pytest.raises(LogError, match=said):
        read_recordings(path)


def test_a_table_with_many_repeats_is_refused(tmp_path: Path) -> None:
    head, *lines = polled(tmp_path, "time,motor_id,pos_rad,cmd_rad").read_text().splitlines()
    often = (line for k, line in enumerate(lines) for _ in range(1 + (k % 5 == 0)))
    twice = written(tmp_path, "\n".join([head, *often]) + "\n")
    with pytest.raises(LogError, match=r"joint1 has two rows at time = 0, as 17% of all rows are repeats; leave one"):
        read_recordings(twice)


@pytest.mark.parametrize(
    ("name", "value"), [("present_volts", 121.0), ("CurVolt", 74.0), ("CurVolt", 51.0), ("battery_volt", 12100.0)]
)
def test_a_voltage_that_only_its_own_word_puts_in_volts_is_asked_about(tmp_path: Path, name: str, value: float) -> None:
    columns, asked, text = texts_of(table(tmp_path, {"time": TIME, **RAD, name: value + 0.0 * TIME}))
    assert columns["joint.voltage"] == name and asked == ["joint.voltage"]
    assert f"in which unit is this voltage? Its name says V, but {value:g} may be tenths or thousandths of it" in text


@pytest.mark.parametrize(
    ("name", "value"), [("present_volts", 12.1), ("input_volts", 12.0), ("supply_V", 325.0), ("voltage [volts]", 325.0)]
)
def test_a_voltage_that_is_plausible_or_has_its_unit_as_such_is_none_to_ask_about(
    tmp_path: Path, name: str, value: float
) -> None:
    columns, asked, _ = texts_of(table(tmp_path, {"time": TIME, **RAD, name: value + 0.0 * TIME}))
    assert columns["joint.voltage"].strip("`") == name and not asked


def test_a_current_that_only_its_own_word_puts_in_amperes_is_asked_about(tmp_path: Path) -> None:
    current = np.round(700.0 * SPEED)
    columns, asked, _ = texts_of(table(tmp_path, {"time": TIME, **RAD, "motor_amps": current}))
    assert columns["joint.current"] == "motor_amps" and asked == ["joint.current"]


@pytest.mark.parametrize("name", ["erpm", "speed_erpm", "motor_erpm"])
def test_electrical_rpm_ask_for_pole_pairs_and_gear(tmp_path: Path, name: str) -> None:
    electrical = 126.0 * SPEED * 60.0 / (2.0 * np.pi)
    columns, asked, text = texts_of(table(tmp_path, {"time": TIME, **RAD, name: electrical}))
    assert columns["joint.velocity"] == f"{name}*2*pi/60"
    assert asked == ["joint.velocity"]
    assert "how many pole pairs times gear ratio make these electrical rpm those of the joint? Divide" in text


@pytest.mark.parametrize(("factor", "sure"), [(1.0, True), (1.03, True), (1.2, False), (1203.0, False)])
def test_a_velocity_is_in_a_unit_that_it_fits_well_or_asked_about(tmp_path: Path, factor: float, sure: bool) -> None:
    _, asked, text = texts_of(table(tmp_path, {"time": TIME, **RAD, "velocity": factor * SPEED}))
    assert bool(asked) is not sure and "mrad" not in text
    assert sure or f"{factor:.3g} times" in text


def test_the_velocity_beside_an_angle_in_mrad_may_be_in_mrad(tmp_path: Path) -> None:
    milli = {"goal_mrad": 1e3 * ANGLE, "pos_mrad": 1e3 * LATE, "velocity": 1e3 * SPEED}
    columns, asked, _ = texts_of(table(tmp_path, {"time": TIME, **milli}))
    assert columns["joint.velocity"] == "velocity*1e-3" and not asked


def counts(turn: float, velocity: np.ndarray, zero: float = 0.0) -> dict[str, np.ndarray]:
    """The columns of a drive that counts, with so many a turn and a count at 0 rad."""
    scale = turn / (2.0 * np.pi)
    return {
        "Time [ms]": 1e3 * TIME,
        "Position Demand Value [inc]": np.round(ANGLE * scale + zero),
        "Position Actual Value [inc]": np.round(LATE * scale + zero),
        "Velocity Actual Value [rpm]": np.round(velocity * 60.0 / (2.0 * np.pi), 1),
    }


@pytest.mark.parametrize("zero", [0.0, 8192.0])
def test_counts_whose_turn_and_zero_nobody_says_are_asked_about(tmp_path: Path, zero: float) -> None:
    columns, asked, text = texts_of(table(tmp_path, counts(16384.0, SPEED, zero)))
    assert asked == ["joint.position", "joint.goal"] and "how many counts are a turn, and which one is 0 rad?" in text
    assert columns["joint.velocity"] == "`Velocity Actual Value [rpm]`*2*pi/60", "the velocity is not doubted"


def test_degrees_a_second_that_are_said_stay_as_they_are(tmp_path: Path) -> None:
    columns, asked, _ = texts_of(table(tmp_path, {"time": TIME, **RAD, "vel_deg_s": 1.2 * DEG * SPEED}))
    assert columns["joint.velocity"] == "vel_deg_s*pi/180" and not asked
