"""Tables of any origin: clocks, text, cells and rows for each joint as they come."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime, timedelta
from decimal import Decimal
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from sealegs.gap.log import LogError, read_measured
from sealegs.gap.log.importers import Recording, import_logs, propose_for, read_recordings

from tests.importers.importing import motion, table

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")
M = motion(5.0, 100.0)
TIME, GOAL, POSITION = M["time"], np.degrees(M["goal"]), np.degrees(M["smooth"])


def rows(*columns: Iterable[object], separator: str = ",") -> str:
    return "\n".join(separator.join(map(str, row)) for row in zip(*columns, strict=True)) + "\n"


def cells(values: np.ndarray, comma: bool = False, form: str = ".4f") -> list[str]:
    text = [f"{value:{form}}" for value in values]
    return [cell.replace(".", ",") for cell in text] if comma else text


def written(folder: Path, text: str, name: str = "run.csv", encoding: str = "utf-8") -> Path:
    (folder / name).write_bytes(text.encode(encoding))
    return folder / name


def read(path: Path) -> Recording:
    (recording,) = read_recordings(path)
    return recording


def texts_of(path: Path) -> tuple[dict[str, str], list[str], str]:
    """Expressions, what is in question, and the proposal as it is shown."""
    found = propose_for(path, path.parent / f"log_{path.stem}")
    asked = [name for question in found.mapping.questions for name in question.about]
    return found.mapping.columns, asked, found.text


def check(path: Path, time: str = "t") -> Path:
    """The file is understood without a question, and imported as it was recorded."""
    found = propose_for(path, path.parent / f"log_{path.stem}", robot="bench", actuator="sts3215", params={"mass": 0.0})
    assert not found.mapping.questions, found.text
    assert found.mapping.columns["time"] == time
    import_logs(path, path.parent / f"log_{path.stem}", found.mapping)
    run = read_measured(path.parent / f"log_{path.stem}").runs[0]
    np.testing.assert_allclose(run.time - run.time[0], TIME[: len(run.time)], atol=2e-6)
    (joint,) = run.joints.values()
    assert joint.goal is not None
    np.testing.assert_allclose(joint.position, M["smooth"][: len(run.time)], atol=2e-5)
    np.testing.assert_allclose(joint.goal, M["goal"][: len(run.time)], atol=2e-5)
    return path


STAMPS = 1_714_560_000_000_000_000 + np.round(1e9 * TIME).astype(np.int64)


def test_integer_nanoseconds_since_1970_are_a_clock(tmp_path: Path) -> None:
    """They do not fit float64: the import ended in a traceback."""
    check(written(tmp_path, "unix_ns,goal_deg,pos_deg\n" + rows(STAMPS, cells(GOAL), cells(POSITION))), "unix_ns*1e-9")
    columns = {"timestamp": STAMPS, "goal_deg": GOAL, "pos_deg": POSITION}
    (tmp_path / "parquet").mkdir()
    path = tmp_path / "parquet" / "run.parquet"
    parquet.write_table(pa.table(columns), path)
    check(path, "timestamp*1e-9")
    lists = pa.FixedSizeListArray.from_arrays(pa.array(np.stack([STAMPS, STAMPS], axis=1).ravel()), 2)
    parquet.write_table(pa.table({"stamps": lists}), path)
    np.testing.assert_allclose(read(path).columns["stamps[1]"], np.round(1e9 * TIME))


def test_a_stamp_that_is_missing_is_no_value_and_no_warning(tmp_path: Path) -> None:
    stamps = pa.array([None if k == 7 else int(stamp) for k, stamp in enumerate(STAMPS)], pa.timestamp("ns"))
    parquet.write_table(pa.table({"ts": stamps, "goal_deg": GOAL, "pos_deg": POSITION}), tmp_path / "run.parquet")
    columns, asked, _ = texts_of(tmp_path / "run.parquet")
    assert columns["time"] == "ts_s" and not asked
    assert np.flatnonzero(np.isnan(read(tmp_path / "run.parquet").columns["ts_s"])).tolist() == [7]


@pytest.mark.parametrize(
    ("start", "form"),
    [
        ("2024-05-01 12:00:00", "%H:%M:%S.%f"),
        ("2024-05-01 23:59:58", "%H:%M:%S.%f"),
        ("2024-05-01 12:59:58", "%I:%M:%S.%f %p"),
        ("2024-05-01 12:00:00", "%M:%S.%f"),
        ("2024-05-01 12:00:00", "%d.%m.%Y %H:%M:%S,%f"),
        ("2024-05-13 23:59:58", "%m/%d/%Y %I:%M:%S.%f %p"),
        ("2024-05-01 12:00:00", "%Y-%m-%dT%H:%M:%S.%fZ"),
    ],
)
def test_times_of_day_and_dates_are_seconds(tmp_path: Path, start: str, form: str) -> None:
    begin = datetime.fromisoformat(start)
    stamps = [(begin + timedelta(seconds=float(t))).strftime(form) for t in TIME]
    check(
        written(tmp_path, "Time;goal_deg;pos_deg\n" + rows(stamps, cells(GOAL), cells(POSITION), separator=";")),
        "Time_s",
    )


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16", "utf-16-le"])
def test_what_a_german_excel_writes_is_read(tmp_path: Path, encoding: str) -> None:
    text = rows(cells(TIME, True), cells(GOAL, True), cells(POSITION, True), separator=";")
    path = written(tmp_path, "Zeit [s];Sollwert [°];Istwert [°]\n" + text.replace("\n", "\r\n"), encoding=encoding)
    check(path, "`Zeit [s]`")
    assert ("cp1252" in propose_for(path, tmp_path / "log").text) == (encoding == "cp1252")


def test_bytes_are_no_text(tmp_path: Path) -> None:
    for content in (bytes(range(256)) * 20, b"\0\1\2\3" * 100):
        (tmp_path / "run.csv").write_bytes(content)
        with pytest.raises(LogError, match="is not a text file"):
            read_recordings(tmp_path / "run.csv")


def test_decimal_commas_between_commas_are_read(tmp_path: Path) -> None:
    quoted = ([f'"{cell}"' for cell in cells(values, True)] for values in (TIME, GOAL, POSITION))
    check(written(tmp_path, "t,goal_deg,pos_deg\n" + rows(*quoted)))


def test_a_row_of_units_below_the_names_is_taken_for_units(tmp_path: Path) -> None:
    text = rows(cells(TIME), cells(GOAL), cells(POSITION), cells(100 * GOAL))
    for name, units in (("bare.csv", "s,deg,deg,mA"), ("bracketed.csv", "[s],[°],[°],[mA]")):
        path = written(tmp_path, f"Time,Command,Position,Current\n{units}\n{text}", name)
        check(path, "`Time [s]`")
        assert texts_of(path)[0]["joint.current"] == "`Current [mA]`*1e-3"


def test_aligned_columns_are_parted_by_runs_of_blanks(tmp_path: Path) -> None:
    text = "".join(f"{t:8.3f} {g:12.5f}   {q:12.5f}  \n" for t, g, q in zip(TIME, GOAL, POSITION, strict=True))
    for name, head in (("names", "t  goal_deg pos_deg"), ("comment", "# t  goal_deg  pos_deg")):
        check(written(tmp_path, f"{head}\n{text}", f"{name}.dat"))
    check(written(tmp_path, f"Time (s)   Goal (deg)   Pos (deg)\n{text}", "spaced.dat"), "`Time (s)`")


def test_a_table_without_samples_is_told(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"has names, but no samples; record the log again or leave the file out\."):
        read_recordings(written(tmp_path, "t,goal_deg,pos_deg\n"))


def test_what_stands_above_the_names_is_skipped(tmp_path: Path) -> None:
    head = 'sep=,\nRecorder 2.1\nDate,2024-05-01\nRate,100,Hz\n\n"t","goal_deg","pos_deg"\n'
    check(written(tmp_path, head + rows(cells(TIME), cells(GOAL), cells(POSITION))))


def test_cells_that_end_with_a_separator_and_numbered_rows_are_read(tmp_path: Path) -> None:
    text = rows(cells(TIME), cells(GOAL), (f"{cell}," for cell in cells(POSITION)))
    check(written(tmp_path, "t,goal_deg,pos_deg\n" + text, "ends.csv"))
    text = rows(range(len(TIME)), cells(TIME), cells(GOAL), cells(POSITION))
    check(written(tmp_path, "t,goal_deg,pos_deg\n" + text, "short.csv"))
    path = check(written(tmp_path, ",t,goal_deg,pos_deg\n" + text, "pandas.csv"))
    assert "column1: it counts the samples" in texts_of(path)[2]


def test_prints_of_a_microcontroller_are_read(tmp_path: Path) -> None:
    text = "".join(
        f"t:{t:.3f},goal_deg:{g:.4f},pos_deg:{q:.4f}\n" for t, g, q in zip(TIME, GOAL, POSITION, strict=True)
    )
    check(written(tmp_path, text, "plotter.txt"))
    check(written(tmp_path, text.replace(",", "\t").replace(":", ": "), "tabs.txt"))
    json = (
        f'{{"t":{t:.3f},"goal_deg":{g:.4f},"pos_deg":{q:.4f}}}\n' for t, g, q in zip(TIME, GOAL, POSITION, strict=True)
    )
    check(written(tmp_path, "".join(json), "lines.txt"))
    brackets = (f"[{t:.3f}, {g:.4f}, {q:.4f}]\n" for t, g, q in zip(TIME, GOAL, POSITION, strict=True))
    check(written(tmp_path, "t,goal_deg,pos_deg\n" + "".join(brackets), "brackets.txt"))


def test_a_last_line_that_was_cut_off_is_left_out_and_a_bad_one_is_named(tmp_path: Path) -> None:
    text = "t,goal_deg,pos_deg\n" + rows(cells(TIME), cells(GOAL), cells(POSITION))
    path = check(written(tmp_path, text.rstrip().rpartition(",")[0], "cut.csv"))
    assert "the last line has 2 of 3 values and is left out" in propose_for(path, tmp_path / "x").text
    lines = text.splitlines()
    lines[99] = lines[99].rpartition(",")[0]
    with pytest.raises(LogError, match=r"line 100 has 2 values for 3 columns; complete or remove it\."):
        read_recordings(written(tmp_path, "\n".join(lines), "ragged.csv"))
    with pytest.raises(LogError, match=r"line 1 has 2 names for 4 columns; name each column\."):
        read_recordings(written(tmp_path, "t,goal\n" + rows(TIME, TIME, GOAL, POSITION), "names.csv"))


def test_every_column_that_is_not_used_is_listed_with_its_reason(tmp_path: Path) -> None:
    states = ["RUN", "HOLD"] * (len(TIME) // 2)
    text = rows(cells(TIME), cells(GOAL), cells(POSITION), states, [""] * len(TIME))
    _, _, shown = texts_of(check(written(tmp_path, "t,goal_deg,pos_deg,mode,remark\n" + text)))
    assert "mode: 'it holds text, no numbers: ''RUN'', ''HOLD''" in shown and "remark: it is empty" in shown
    with pytest.raises(LogError, match="has no column of numbers"):
        read_recordings(written(tmp_path, "a\nx\nx\n"))


def test_single_cells_that_are_no_numbers_are_told(tmp_path: Path) -> None:
    text = rows(cells(TIME), cells(GOAL), ["ERR" if k == 7 else cell for k, cell in enumerate(cells(POSITION))])
    path = written(tmp_path, "t,goal_deg,pos_deg\n" + text)
    assert "1 cell of pos_deg is no number and read as no value, the first 'ERR'" in texts_of(path)[2]


@pytest.mark.parametrize("words", [("True", "False"), ("true", "false"), ("TRUE", "FALSE")])
def test_words_for_truth_are_one_and_zero(tmp_path: Path, words: tuple[str, str]) -> None:
    flags = [words[k % 2] for k in range(len(TIME))]
    text = rows(cells(TIME), cells(GOAL), cells(POSITION), flags)
    path = written(tmp_path, "t,goal_deg,pos_deg,torque_enable\n" + text)
    np.testing.assert_array_equal(read(path).columns["torque_enable"], (np.arange(len(TIME)) + 1) % 2)


def test_decimals_and_structures_of_parquet_are_numbers(tmp_path: Path) -> None:
    goal = pa.array([Decimal(cell) for cell in cells(GOAL)])
    arm = pa.StructArray.from_arrays([goal, pa.array(POSITION)], ["goal_deg", "pos_deg"])
    parquet.write_table(pa.table({"t": TIME, "arm": arm}), tmp_path / "run.parquet")
    columns, asked, _ = texts_of(tmp_path / "run.parquet")
    assert columns["joint.goal"] == "arm.goal_deg*pi/180" and not asked


N = motion(5.0, 100.0, seed=7)


def long_form(folder: Path, head: str, names: tuple[object, object], apart: float = 0.0, sort: bool = False) -> Path:
    """Two joints, with a row for each and time; the second is read so much later [s]."""
    lines = [
        (k, f"{t + k * apart:.6f},{name},{position:.6f},{goal:.6f}")
        for t, *both in zip(TIME, M["smooth"], M["goal"], N["smooth"], N["goal"], strict=True)
        for k, (name, position, goal) in enumerate(zip(names, both[::2], both[1::2], strict=True))
    ]
    rows_of = (line for _, line in (sorted(lines, key=lambda line: line[0]) if sort else lines))
    return written(folder, f"{head}\n" + "\n".join(rows_of) + "\n")


@pytest.mark.parametrize("sort", [False, True])
@pytest.mark.parametrize(
    ("head", "names", "joints"),
    [
        ("t,name,pos_rad,cmd", ("shoulder", "elbow"), ["shoulder", "elbow"]),
        ("time,servo_id,position [rad],goal", (3, 5), ["joint3", "joint5"]),
        ("t,Joint,q,q_des", ("link1", "left arm"), ["link1", "left_arm"]),
    ],
)
def test_a_row_for_each_joint_is_one_sample_of_all(
    tmp_path: Path, head: str, names: tuple[object, object], joints: list[str], sort: bool
) -> None:
    path = long_form(tmp_path, head, names, sort=sort)
    found = propose_for(path, tmp_path / "log", robot="bench", actuator="ideal")
    column = head.split(",")[1]
    assert not found.mapping.questions, found.text
    assert f"# Note: '{column}' names the joint of each row: {', '.join(joints)}" in found.text
    import_logs(path, tmp_path / "log", found.mapping)
    run = read_measured(tmp_path / "log").runs[0]
    assert list(run.joints) == joints
    np.testing.assert_allclose(run.time, TIME, atol=1e-9)
    for log, true in zip(run.joints.values(), (M, N), strict=True):
        assert log.goal is not None
        np.testing.assert_allclose(log.position, true["smooth"], atol=1e-6)
        np.testing.assert_allclose(log.goal, true["goal"], atol=1e-6)


def test_joints_that_are_read_one_after_the_other_stand_at_their_mean_time_where_they_are_near(tmp_path: Path) -> None:
    path = long_form(tmp_path, "t,name,pos,cmd", ("shoulder", "elbow"), apart=0.0006)
    assert "rows of one sample are up to 0.0006 apart in t and stand at their mean" in texts_of(path)[2]
    np.testing.assert_allclose(read(path).columns["t"], TIME + 0.0003, atol=1e-9)


def test_joints_that_are_read_at_different_times_are_refused(tmp_path: Path) -> None:
    path = long_form(tmp_path, "t,name,pos,cmd", ("shoulder", "elbow"), apart=0.004)
    said = r"'name' names the joint of each row, and its joints were read at different times in t; a log"
    with pytest.raises(LogError, match=said):
        read_recordings(path)


def test_a_joint_that_is_missing_from_a_sample_has_no_value_there(tmp_path: Path) -> None:
    path = long_form(tmp_path, "t,name,pos,cmd", ("shoulder", "elbow"))
    lines = path.read_text().splitlines()
    recording = read(written(tmp_path, "\n".join([*lines[:8], *lines[9:]]) + "\n"))
    assert np.flatnonzero(np.isnan(recording.columns["elbow.pos"])).tolist() == [3]
    assert np.isfinite(recording.columns["shoulder.pos"]).all() and recording.length == len(TIME)


@pytest.mark.parametrize(
    ("words", "apart", "sort"), [(("RUN", "HOLD"), 0.005, False), (("first", "second"), 0.0, True)]
)
def test_states_that_take_turns_and_runs_below_each_other_are_no_joints(
    tmp_path: Path, words: tuple[str, str], apart: float, sort: bool
) -> None:
    recording = read(long_form(tmp_path, "t,phase,pos,cmd", words, apart, sort))
    assert list(recording.columns) == ["t", "pos", "cmd"] and "it holds text" in recording.left["phase"]


# --- motors that share a bus: rows polled in turn, and rows that repeat ----------------------------------------------


def polled(folder: Path, head: str, apart: float = 0.0) -> Path:
    """Motors with a row for each and time, each read so much later [s] than the one before it."""
    lines = [
        f"{time + k * apart:.6f},{k + 1},{late + 0.1 * k:.6f},{goal:.6f}"
        for time, late, goal in zip(TIME, M["smooth"], M["goal"], strict=True)
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
    held = table(
        tmp_path,
        {"time": TIME, "state_id": (TIME % 2.0 > 1.0).astype(float), "goal_rad": M["goal"], "pos_rad": M["smooth"]},
        "held.csv",
    )
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
    np.testing.assert_allclose(recording.columns["joint2.pos_rad"], M["smooth"] + 0.1, atol=1e-6)


def test_rows_of_one_joint_and_time_that_differ_are_refused_with_the_joint_and_the_time(tmp_path: Path) -> None:
    head, *lines = polled(tmp_path, "time,motor_id,pos_rad,cmd_rad").read_text().splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith("4.200000,2,"))
    path = written(tmp_path, "\n".join([head, *lines[: at + 1], "4.200000,2,9.5,0.25", *lines[at + 1 :]]) + "\n")
    said = r"'motor_id' names the joint of each row, and joint2 has two rows that differ at time = 4\.2"
    with pytest.raises(LogError, match=said):
        read_recordings(path)
