"""Folders as people have them: notes among the recordings, imports that were interrupted, names that are taken."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.log import LogError, read_measured
from sealegs.gap.log.importers import import_logs, propose_for, read_recordings
from sealegs.gap.log.importers.expression import evaluate, shows_sign
from sealegs.gap.log.importers.mapping import Mapping

from tests.importers.importing import motion, table

M = motion(5.0, 100.0)
COLUMNS = {"time": "t", "joint.goal": "goal_rad", "joint.position": "pos_rad"}


def runs(folder: Path, *names: str) -> Path:
    """A folder with recordings that differ."""
    folder.mkdir(exist_ok=True)
    for name in names:
        size = 1.0 + 0.1 * (sum(map(ord, name)) % 7)
        table(folder, {"t": M["time"], "goal_rad": size * M["goal"], "pos_rad": size * M["smooth"]}, f"{name}.csv")
    return folder


def names_of(folder: Path) -> list[str]:
    return [one.name for one in read_recordings(folder)]


# --- what is no recording --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "bench 3, servo 7\ncharged battery before run 2\n",
        "Notes\n\nThe first run is cold. The second one, warm, has\na longer lead; see the picture, too.\n",
        "",
        "only one line of words",
    ],
)
def test_a_text_without_numbers_among_recordings_is_left_out_and_told(tmp_path: Path, text: str) -> None:
    """One notes.txt stopped the whole folder."""
    folder = runs(tmp_path / "in", "run1", "run2")
    (folder / "notes.txt").write_text(text)
    assert names_of(folder) == ["run1", "run2"]
    proposed = propose_for(folder, tmp_path / "out")
    assert "# Left out: notes.txt " in proposed.text and len(proposed.recordings) == 2
    assert len(import_logs(folder, tmp_path / "out", Mapping(COLUMNS)).files) == 2


def test_a_text_alone_in_a_folder_is_told_as_before(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("bench 3, servo 7\ncharged battery before run 2\n")
    with pytest.raises(LogError, match=r"notes\.txt: has no column of numbers"):
        read_recordings(tmp_path)


def test_a_text_above_folders_of_recordings_does_not_hide_them(tmp_path: Path) -> None:
    for day in ("monday", "tuesday"):
        runs(tmp_path / day, "run")
    (tmp_path / "notes.txt").write_text("cold on Monday\nwarm on Tuesday\n")
    assert names_of(tmp_path) == ["monday-run", "tuesday-run"]


def test_a_recording_with_a_bad_row_is_not_left_out(tmp_path: Path) -> None:
    folder = runs(tmp_path / "in", "run1", "run2")
    lines = (folder / "run2.csv").read_text().splitlines()
    lines[30] = lines[30].rpartition(",")[0]
    (folder / "run2.csv").write_text("\n".join(lines))
    with pytest.raises(LogError, match=r"run2\.csv: line 31 has 2 values for 3 columns"):
        read_recordings(folder)


def test_a_small_table_of_another_kind_does_not_take_the_place_of_a_run(tmp_path: Path) -> None:
    """Of as many files of each kind, the first by name was imported."""
    folder = runs(tmp_path / "in", "run")
    (folder / "calib.csv").write_text("joint,low,high\nshoulder,100,3900\nelbow,200,3800\n")
    proposed = propose_for(folder, tmp_path / "out")
    assert [one.name for one in proposed.recordings] == [
        "run"
    ] and "# Left out: calib has other columns" in proposed.text


# --- the machine of a mapping ----------------------------------------------------------------------------------------


def test_a_robot_of_ones_own_needs_no_file(tmp_path: Path) -> None:
    for k, robot in enumerate(("so101", "arm2", "Testrig")):
        sidecar = {"robot": robot, "actuators": {"joint": "ideal"}}
        import_logs(runs(tmp_path / "in", "run1"), tmp_path / f"out{k}", Mapping(COLUMNS, sidecar=sidecar))
        assert read_measured(tmp_path / f"out{k}").runs[0].robot == robot


# --- registers with a bit for their sign -----------------------------------------------------------------------------


def test_a_register_with_a_bit_for_its_sign_is_read() -> None:
    raw = np.array([0.0, 300.0, 32768.0, 32768.0 + 300.0, 32767.0, np.nan])
    np.testing.assert_array_equal(
        evaluate("sign_bit(speed, 15)", {"speed": raw}, ""), [0.0, 300.0, 0.0, -300.0, 32767.0, np.nan]
    )
    np.testing.assert_array_equal(evaluate("sign_bit(load, 10)", {"load": np.array([1023.0, 1074.0])}, ""), [1023, -50])


@pytest.mark.parametrize(("bit", "size"), [(15, 900.0), (10, 400.0)])
def test_the_counts_tell_how_a_register_keeps_its_sign(bit: int, size: float) -> None:
    signed = np.round(size * np.sin(3.0 * M["time"]) * np.sin(0.7 * M["time"]))
    magnitude = np.where(signed < 0.0, 2.0**bit - signed, signed)
    assert shows_sign(magnitude, bit)
    for other in (signed, np.abs(signed), 0.1 + magnitude, np.mod(signed, 2.0**16)):
        assert not shows_sign(other, bit)
