"""Tables of any origin: clocks, text, cells and rows for each joint as they come."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from sealegs.gap.log import LogError, read_measured
from sealegs.gap.log.importers import Recording, import_logs, propose_for, read_recordings

from tests.importers.importing import motion

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
