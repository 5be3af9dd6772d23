"""Folders as people have them: notes among the recordings, imports that were interrupted, names that are taken."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.commands.cli import main
from sealegs.gap.log import LogError, read_measured
from sealegs.gap.log.importers import import_logs, propose_for, read_recordings
from sealegs.gap.log.importers.expression import evaluate, signed_reading
from sealegs.gap.log.importers.lines import Line, velocity_line
from sealegs.gap.log.importers.mapping import Mapping
from sealegs.gap.log.importers.motion import Relation
from sealegs.gap.log.importers.names import said

from tests.importers.importing import motion, table

M = motion(5.0, 100.0)
COLUMNS = {"time": "t", "joint.goal": "goal_rad", "joint.position": "pos_rad"}
BENCH = {"robot": "bench", "robot_params": {"mass": 0.5, "length": 0.1}, "actuators": {"joint": "sts3215"}}


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


# --- names that are taken --------------------------------------------------------------------------------------------


def test_an_interrupted_import_goes_on_where_it_stopped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, out = runs(tmp_path / "in", "run1", "run2", "run3"), tmp_path / "out"
    call = ["import", str(folder), f"out={out}", "yes=true"]
    assert main(call) == 0
    for file in out.glob("run2.*"):
        file.unlink()
    there = {file: file.stat().st_mtime_ns for file in out.iterdir()}
    runs(folder, "run0")
    capsys.readouterr()
    assert main(call) == 0
    told = capsys.readouterr().out
    assert "Left out: run1 is in" in told and "Left out: run3 is in" in told and "run2 is" not in told
    assert "4 measured logs in" in told
    assert {file: file.stat().st_mtime_ns for file in there} == there
    assert sorted(file.name for file in out.glob("*.csv")) == ["run0.csv", "run1.csv", "run2.csv", "run3.csv"]


def test_a_log_whose_blanks_were_filled_in_is_there_all_the_same(tmp_path: Path) -> None:
    folder, out = runs(tmp_path / "in", "run1"), tmp_path / "out"
    import_logs(folder, out, Mapping(COLUMNS))
    (out / "log.yaml").write_text("robot: bench\nrobot_params: {mass: 0.5, length: 0.1}\nactuators: {joint: ideal}\n")
    own = out / "run1.yaml"
    own.write_text(own.read_text() + "notes: warm\n")
    runs(folder, "run2")
    done = import_logs(folder, out, Mapping(COLUMNS))
    assert [file.name for file in done.files] == ["run1.csv", "run2.csv"] and "warm" in own.read_text()
    assert len(read_measured(out).runs) == 2


@pytest.mark.parametrize(
    "other",
    [
        Mapping({**COLUMNS, "joint.position": "-pos_rad"}, sidecar=BENCH),
        Mapping({**COLUMNS, "joint.velocity": "0*pos_rad"}, sidecar=BENCH),
        Mapping(COLUMNS, sidecar=BENCH | {"actuators": {"joint": "ideal"}}),
    ],
)
def test_a_name_that_another_mapping_has_taken_is_told_before_anything_is_written(
    tmp_path: Path, other: Mapping
) -> None:
    """The runs before it were written."""
    folder, out = runs(tmp_path / "in", "run1", "run2"), tmp_path / "out"
    import_logs(folder, out, Mapping(COLUMNS, sidecar=BENCH))
    runs(folder, "run0")
    there = sorted(out.iterdir())
    with pytest.raises(LogError, match=r"run1\.csv: exists already, .*never overwritten; .*Nothing was written"):
        import_logs(folder, out, other)
    assert sorted(out.iterdir()) == there


def test_a_name_that_another_recording_has_taken_is_told_before_anything_is_written(tmp_path: Path) -> None:
    out = tmp_path / "out"
    import_logs(runs(tmp_path / "monday", "run1"), out, Mapping(COLUMNS))
    folder = runs(tmp_path / "tuesday", "run0", "run1")
    with pytest.raises(LogError, match=r"run1\.csv: exists already"):
        import_logs(folder, out, Mapping(COLUMNS))
    assert not list(out.glob("run0*"))


def test_an_import_that_adds_nothing_is_told(tmp_path: Path) -> None:
    folder = runs(tmp_path / "in", "run1", "run2")
    import_logs(folder, tmp_path / "out", Mapping(COLUMNS))
    with pytest.raises(LogError, match="has all 2 of these logs already, and a recording is never overwritten"):
        import_logs(folder, tmp_path / "out", Mapping(COLUMNS))


def test_a_sidecar_that_was_left_alone_is_taken_with_its_table(tmp_path: Path) -> None:
    """The import was killed between the two."""
    folder, out = runs(tmp_path / "in", "run1", "run2"), tmp_path / "out"
    import_logs(folder, out, Mapping(COLUMNS, sidecar=BENCH))
    (out / "run2.csv").unlink()
    before = (out / "run2.yaml").read_text()
    import_logs(folder, out, Mapping(COLUMNS, sidecar=BENCH))
    assert len(read_measured(out).runs) == 2 and (out / "run2.yaml").read_text() == before
    (out / "run2.csv").unlink()
    (out / "run2.yaml").write_text("notes: of something else\n")
    with pytest.raises(LogError, match=r"run2\.yaml: exists already"):
        import_logs(folder, out, Mapping(COLUMNS, sidecar=BENCH))


def test_a_long_log_that_is_there_as_parquet_is_there(tmp_path: Path) -> None:
    folder, out = runs(tmp_path / "in", "run1"), tmp_path / "out"
    import_logs(folder, out, Mapping(COLUMNS), "parquet")
    runs(folder, "run2")
    done = import_logs(folder, out, Mapping(COLUMNS), "csv")
    assert [file.name for file in done.files] == ["run1.parquet", "run2.csv"]


# --- the machine of a mapping ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sidecar", "sentence"),
    [
        (BENCH | {"robot": "benchh"}, r"robot 'benchh' \(did you mean 'bench'\?\)"),
        ({"robot": "nosuch.yaml"}, r"run1: there is no robot's file nosuch\.yaml; correct the key robot"),
        (BENCH | {"robot": "my_bench"}, r"robot_params are of a bench or of a robot's file, and the robot is my_bench"),
        (BENCH | {"robot_params": {"mas": 0.5, "length": 0.1}}, r"robot_params\.mas .*\(did you mean 'mass'\?\)"),
        (
            BENCH | {"actuators": {"joint": "ideal", "elbow": "ideal"}},
            r"actuator for 'elbow', .* its joints are joint\.",
        ),
        (BENCH | {"actuators": {"joint": "sts32155"}}, r"no actuator 'sts32155' \(did you mean 'sts3215'\?\)"),
    ],
)
def test_a_machine_that_there_is_not_is_told_before_anything_is_written(
    tmp_path: Path, sidecar: dict[str, object], sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        import_logs(runs(tmp_path / "in", "run1"), tmp_path / "out", Mapping(COLUMNS, sidecar=sidecar))
    assert not (tmp_path / "out").exists()


def test_a_robot_of_ones_own_needs_no_file(tmp_path: Path) -> None:
    for k, robot in enumerate(("so101", "arm2", "Testrig")):
        sidecar = {"robot": robot, "actuators": {"joint": "ideal"}}
        done = import_logs(runs(tmp_path / "in", "run1"), tmp_path / f"out{k}", Mapping(COLUMNS, sidecar=sidecar))
        assert read_measured(tmp_path / f"out{k}").runs[0].robot == robot
        assert done.unmodelled == robot  # and the import says what that costs


# --- registers with a bit for their sign -----------------------------------------------------------------------------


def test_a_register_with_a_bit_for_its_sign_is_read() -> None:
    raw = np.array([0.0, 300.0, 32768.0, 32768.0 + 300.0, 32767.0, np.nan])
    np.testing.assert_array_equal(
        evaluate("sign_bit(speed, 15)", {"speed": raw}, ""), [0.0, 300.0, 0.0, -300.0, 32767.0, np.nan]
    )
    np.testing.assert_array_equal(evaluate("sign_bit(load, 10)", {"load": np.array([1023.0, 1074.0])}, ""), [1023, -50])


@pytest.mark.parametrize(("bit", "size"), [(15, 900.0), (10, 400.0)])
def test_the_counts_tell_how_a_register_keeps_its_sign(bit: int, size: float) -> None:
    """A speed of a Feetech servo had no hint, and nothing that read it."""
    signed = np.round(size * np.sin(3.0 * M["time"]) * np.sin(0.7 * M["time"]))
    magnitude = np.where(signed < 0.0, 2.0**bit - signed, signed)
    assert signed_reading("Present_Speed", magnitude) == f"sign_bit(Present_Speed, {bit})"
    assert signed_reading("speed [raw]", np.mod(signed, 2.0**16)) == "signed16(`speed [raw]`)"
    turns = np.mod(np.arange(500.0) * 11.0, 2048.0)
    for other in (signed, np.abs(signed), turns, np.mod(np.arange(500.0) * 7.0, 40_000.0), 0.1 + magnitude):
        assert signed_reading("speed", other) == ""


def test_the_question_for_a_speed_in_counts_says_how_its_sign_is_kept() -> None:
    signed = np.round(900.0 * np.sin(3.0 * M["time"]))
    magnitude = np.where(signed < 0.0, 2.0**15 - signed, signed)
    position = Line("pos", "rad", "sure", "the name says rad")
    asked = velocity_line(said("Present_Speed"), magnitude, Relation(), position)
    assert "With its sign it is sign_bit(Present_Speed, 15)" in asked.ask
    assert "sign_bit" not in velocity_line(said("Present_Speed"), signed, Relation(), position).ask
