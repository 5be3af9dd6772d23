"""Tables of any origin: clocks, text, cells and rows for each joint as they come."""

from __future__ import annotations

import json
from collections.abc import Iterable
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from scipy.io import savemat
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


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
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
    strange = written(tmp_path, f"Time,Command,Position,Current\ns,deg,deg,0.1%\n{text}", "strange.csv")
    assert texts_of(strange)[0]["joint.position"] == "`Position [deg]`*pi/180"  # one word that is no unit


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
    assert "column1: 'nobody says what it is" in texts_of(path)[2]


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
    assert "1 cells of pos_deg are no number, the first 'ERR'" in texts_of(path)[2]


@pytest.mark.parametrize("words", [("True", "False"), ("true", "false"), ("TRUE", "FALSE")])
def test_words_for_truth_are_one_and_zero(tmp_path: Path, words: tuple[str, str]) -> None:
    flags = [words[k % 2] for k in range(len(TIME))]
    text = rows(cells(TIME), cells(GOAL), cells(POSITION), flags)
    path = written(tmp_path, "t,goal_deg,pos_deg,torque_enable\n" + text)
    np.testing.assert_array_equal(read(path).columns["torque_enable"], (np.arange(len(TIME)) + 1) % 2)


# --- motors that share a bus: rows polled in turn, and rows that repeat ----------------------------------------------


@pytest.mark.parametrize(
    ("name", "labels", "refused"),
    [
        ("joint", ("shoulder", "elbow"), True),
        ("servo_id", (3, 5), True),
        ("motor_id", (7, 7), False),
        ("mode", ("run", "hold"), False),
    ],
)
def test_a_row_for_each_joint_is_refused_with_what_to_do(
    tmp_path: Path, name: str, labels: tuple[object, object], refused: bool
) -> None:
    lines = [
        f"{t:.3f},{label},{p:.5f},{g:.5f}" for t, p, g in zip(TIME, POSITION, GOAL, strict=True) for label in labels
    ]
    path = written(tmp_path, f"time,{name},pos_rad,goal_rad\n" + "\n".join(lines))
    if refused:
        with pytest.raises(LogError, match=rf"'{name}' names the joint of each row.*pivot_table"):
            read_recordings(path)
    else:
        assert read_recordings(path)


# --- clocks without a unit, stamps in two columns, and structures, names and entries with a clock each ---------------


def swing(time: np.ndarray) -> np.ndarray:
    """A swing [rad] of some seconds."""
    return 0.6 * np.sin(2.0 * time) + 0.2 * np.sin(5.1 * time)


def recorded(period: float, duration: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Time [s], and goal and position of a joint."""
    time = np.arange(0.0, duration, period)
    return time, {"goal_rad": swing(time), "position_rad": swing(time - 0.04)}


@pytest.mark.parametrize(("period", "per"), [(5e-4, 1e3), (1e-4, 1e3), (2.5e-4, 1e6)])
def test_a_clock_of_a_fast_log_is_not_read_as_a_slow_one_in_silence(tmp_path: Path, period: float, per: float) -> None:
    """2 kHz in ms were 2 Hz in s: ten seconds became three hours."""
    time, columns = recorded(period, 1.0)
    (question,) = propose_for(table(tmp_path, {"time": per * time, **columns}), tmp_path / "out").mapping.questions
    unit = {1e3: "ms", 1e6: "us"}[per]
    assert question.about == ("time",) and f"{1.0 / period:.0f} Hz in {unit}" in question.ask
    found = propose_for(table(tmp_path, {f"time_{unit}": per * time, **columns}), tmp_path / "out").mapping
    assert not found.questions


FIRST = 1_714_500_000
RUN = motion(8.0, 100.0)
OTHER = motion(8.0, 100.0, seed=3)
CLOCK_TIME, CLOCK_GOAL, ANGLE = RUN["time"], RUN["goal"], RUN["smooth"]


def one(time: np.ndarray, of: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {"t": time, "q": of["smooth"][: len(time)], "qref": of["goal"][: len(time)]}


@pytest.mark.parametrize("kind", ["structures", "prefixes", "lengths", "clocks", "within", "numpy"])
def test_siblings_that_have_a_clock_each_are_runs(tmp_path: Path, kind: str) -> None:
    runs = {"exp1": one(CLOCK_TIME, RUN), "exp2": one(CLOCK_TIME, OTHER)}
    if kind == "lengths":
        runs["exp2"] = one(CLOCK_TIME[:600], OTHER)
    if kind == "clocks":
        runs = {"slow": one(CLOCK_TIME, RUN), "fast": one(CLOCK_TIME / 2.0, OTHER)}
    flat = {f"{name}_{key}": values for name, own in runs.items() for key, values in own.items()}
    path = tmp_path / ("bench.npz" if kind == "numpy" else "bench.mat")
    if kind == "numpy":
        arrays: dict[str, Any] = {"mass": np.array(0.5), **flat}
        np.savez(path, **arrays)
    else:
        savemat(path, {"mass": 0.5, **(flat if kind == "prefixes" else {"data": runs} if kind == "within" else runs)})
    recordings = read_recordings(path)
    assert [recording.name for recording in recordings] == [f"bench-{name}" for name in runs]
    for recording, own in zip(recordings, runs.values(), strict=True):
        assert set(recording.columns) == {"t", "q", "qref"} and recording.facts == {"mass": 0.5}
        np.testing.assert_allclose(recording.columns["q"], own["q"])
    proposed = propose_for(path, tmp_path / "out")
    files = import_logs(path, tmp_path / "out", proposed.mapping, recordings=proposed.recordings).files
    assert len(files) == 2


def test_a_run_that_lacks_a_signal_is_left_out_with_a_line(tmp_path: Path) -> None:
    third = {key: values for key, values in one(CLOCK_TIME, RUN).items() if key != "qref"}
    savemat(tmp_path / "bench.mat", {"exp1": one(CLOCK_TIME, RUN), "exp2": one(CLOCK_TIME, OTHER), "exp3": third})
    proposed = propose_for(tmp_path / "bench.mat", tmp_path / "out")
    assert len(proposed.recordings) == 2 and "bench-exp3 has other columns" in proposed.left[0]


@pytest.mark.parametrize("names", [("left", "right"), ("joint1", "joint2")])
def test_siblings_with_one_clock_that_nothing_calls_runs_are_joints(tmp_path: Path, names: tuple[str, str]) -> None:
    savemat(tmp_path / "arm.mat", {names[0]: one(CLOCK_TIME, RUN), names[1]: one(CLOCK_TIME, OTHER)})
    (recording,) = read_recordings(tmp_path / "arm.mat")
    assert len(recording.columns) == 5, "one clock"


@pytest.mark.parametrize(("above", "count"), [("test", 1), ("tests", 2)])
def test_what_lies_in_one_test_with_one_clock_is_no_run(tmp_path: Path, above: str, count: int) -> None:
    savemat(tmp_path / "arm.mat", {above: {"a": one(CLOCK_TIME, RUN), "b": one(CLOCK_TIME, OTHER)}})
    assert len(read_recordings(tmp_path / "arm.mat")) == count


def test_structures_that_ran_side_by_side_by_clocks_of_the_day_are_no_runs(tmp_path: Path) -> None:
    since = FIRST + CLOCK_TIME
    savemat(tmp_path / "arm.mat", {"left": one(since, RUN), "right": one(since + 0.003, OTHER)})
    with pytest.raises(LogError, match=r"left\.t and right\.t are clocks that differ, and a log has one"):
        read_recordings(tmp_path / "arm.mat")


def test_signals_with_a_clock_each_are_no_runs(tmp_path: Path) -> None:
    content = {"position": {"time": CLOCK_TIME, "data": ANGLE}, "goal": {"time": CLOCK_TIME / 2.0, "data": CLOCK_GOAL}}
    savemat(tmp_path / "bench.mat", content)
    with pytest.raises(LogError, match=r"position\.time and goal\.time are clocks that differ"):
        read_recordings(tmp_path / "bench.mat")


def bam(path: Path, entries: list[dict[str, object]], encoding: str = "utf-8") -> Path:
    path.write_text(json.dumps({"mass": 0.5, "entries": entries}), encoding=encoding)
    return path


ENTRIES: list[dict[str, object]] = [
    {"timestamp": t, "position": p, "goal_position": g, "temp": 35.0, "state": "on"}
    for t, p, g in zip(CLOCK_TIME.tolist(), ANGLE.tolist(), CLOCK_GOAL.tolist(), strict=True)
]


def test_a_key_that_the_first_entry_lacks_is_a_column(tmp_path: Path) -> None:
    first = {key: value for key, value in ENTRIES[0].items() if key != "temp"}
    (recording,) = read_recordings(bam(tmp_path / "run.json", [first, *ENTRIES[1:]]))
    assert np.isnan(recording.columns["temp"][0]) and recording.columns["temp"][1] == 35.0
    assert "state" in recording.left


def test_json_may_begin_with_the_mark_of_its_encoding(tmp_path: Path) -> None:
    (recording,) = read_recordings(bam(tmp_path / "servo.json", ENTRIES, "utf-8-sig"))
    assert recording.length == len(ENTRIES)
    source = table(tmp_path, {"time": CLOCK_TIME, "pos": ANGLE})
    source.with_suffix(".meta.json").write_text('{"mass": 0.5}', encoding="utf-8-sig")
    assert read_recordings(source)[0].facts["mass"] == 0.5


def test_stamps_of_a_timedelta_run_on_over_days(tmp_path: Path) -> None:
    """pandas writes its index so; the column was left out as text."""
    seconds = 86399.0 + CLOCK_TIME
    cells = [
        f"{int(s // 86400)} days {int(s % 86400) // 3600:02}:{int(s) // 60 % 60:02}:{s % 60:09.6f}" for s in seconds
    ]
    path = tmp_path / "run.csv"
    rows = (f"{cell},{goal},{angle}" for cell, goal, angle in zip(cells, CLOCK_GOAL, ANGLE, strict=True))
    path.write_text("\n".join([",cmd_rad,pos_rad", *rows]))
    (recording,) = read_recordings(path)
    np.testing.assert_allclose(recording.columns["column1_s"], seconds, atol=2e-6)


def test_a_signal_with_a_slower_clock_is_left_out(tmp_path: Path) -> None:
    slow = {"Time": CLOCK_TIME[::5], "Data": ANGLE[::5]}
    savemat(tmp_path / "run.mat", {"q_meas": {"Time": CLOCK_TIME, "Data": ANGLE}, "tau_meas": slow})
    (recording,) = read_recordings(tmp_path / "run.mat")
    assert "tau_meas.Data" not in recording.columns and "left out" in recording.notes[-1]
