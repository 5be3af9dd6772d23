"""Motors that share a bus: rows polled in turn, rows that repeat, and the units of their registers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.log import LogError
from sealegs.gap.log.importers import read_recordings

from tests.importers.importing import ANGLE, LATE, RAD, TIME, table
from tests.importers.test_import_tables import texts_of, written


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
    said = rf"'{name}' names the joint of each row, and its joints were read at different times in time"
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
    said = r"'motor_id' names the joint of each row, and joint2 has two rows that differ at time = 4\.2"
    with pytest.raises(LogError, match=said):
        read_recordings(path)


def test_a_table_with_many_repeats_is_read_without_them(tmp_path: Path) -> None:
    head, *lines = polled(tmp_path, "time,motor_id,pos_rad,cmd_rad").read_text().splitlines()
    often = (line for k, line in enumerate(lines) for _ in range(1 + (k % 5 == 0)))
    recording = read_recordings(written(tmp_path, "\n".join([head, *often]) + "\n"))[0]
    np.testing.assert_allclose(recording.columns["joint2.pos_rad"], LATE + 0.1, atol=1e-6)
