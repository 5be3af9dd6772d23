"""Clocks without a unit, stamps in two columns, and structures, names and entries with a clock each."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat
from sealegs.gap.log import LogError
from sealegs.gap.log.importers import import_logs, propose_for, read_recordings

from tests.importers.importing import motion, table


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
TIME, GOAL, ANGLE = RUN["time"], RUN["goal"], RUN["smooth"]


def one(time: np.ndarray, of: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {"t": time, "q": of["smooth"][: len(time)], "qref": of["goal"][: len(time)]}


@pytest.mark.parametrize("kind", ["structures", "prefixes", "lengths", "clocks", "within", "numpy"])
def test_siblings_that_have_a_clock_each_are_runs(tmp_path: Path, kind: str) -> None:
    runs = {"exp1": one(TIME, RUN), "exp2": one(TIME, OTHER)}
    if kind == "lengths":
        runs["exp2"] = one(TIME[:600], OTHER)
    if kind == "clocks":
        runs = {"slow": one(TIME, RUN), "fast": one(TIME / 2.0, OTHER)}
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
    third = {key: values for key, values in one(TIME, RUN).items() if key != "qref"}
    savemat(tmp_path / "bench.mat", {"exp1": one(TIME, RUN), "exp2": one(TIME, OTHER), "exp3": third})
    proposed = propose_for(tmp_path / "bench.mat", tmp_path / "out")
    assert len(proposed.recordings) == 2 and "bench-exp3 has other columns" in proposed.left[0]


@pytest.mark.parametrize("names", [("left", "right"), ("joint1", "joint2")])
def test_siblings_with_one_clock_that_nothing_calls_runs_are_joints(tmp_path: Path, names: tuple[str, str]) -> None:
    savemat(tmp_path / "arm.mat", {names[0]: one(TIME, RUN), names[1]: one(TIME, OTHER)})
    (recording,) = read_recordings(tmp_path / "arm.mat")
    assert len(recording.columns) == 5, "one clock"


@pytest.mark.parametrize(("above", "count"), [("test", 1), ("tests", 2)])
def test_what_lies_in_one_test_with_one_clock_is_no_run(tmp_path: Path, above: str, count: int) -> None:
    savemat(tmp_path / "arm.mat", {above: {"a": one(TIME, RUN), "b": one(TIME, OTHER)}})
    assert len(read_recordings(tmp_path / "arm.mat")) == count


def test_structures_that_ran_side_by_side_by_clocks_of_the_day_are_no_runs(tmp_path: Path) -> None:
    since = FIRST + TIME
    savemat(tmp_path / "arm.mat", {"left": one(since, RUN), "right": one(since + 0.003, OTHER)})
    with pytest.raises(LogError, match=r"left\.t and right\.t are clocks that differ, and a log has one"):
        read_recordings(tmp_path / "arm.mat")


def test_signals_with_a_clock_each_are_no_runs(tmp_path: Path) -> None:
    content = {"position": {"time": TIME, "data": ANGLE}, "goal": {"time": TIME / 2.0, "data": GOAL}}
    savemat(tmp_path / "bench.mat", content)
    with pytest.raises(LogError, match=r"position\.time and goal\.time are clocks that differ"):
        read_recordings(tmp_path / "bench.mat")


def bam(path: Path, entries: list[dict[str, object]], encoding: str = "utf-8") -> Path:
    path.write_text(json.dumps({"mass": 0.5, "entries": entries}), encoding=encoding)
    return path


ENTRIES: list[dict[str, object]] = [
    {"timestamp": t, "position": p, "goal_position": g, "temp": 35.0, "state": "on"}
    for t, p, g in zip(TIME.tolist(), ANGLE.tolist(), GOAL.tolist(), strict=True)
]


def test_a_key_that_the_first_entry_lacks_is_a_column(tmp_path: Path) -> None:
    first = {key: value for key, value in ENTRIES[0].items() if key != "temp"}
    (recording,) = read_recordings(bam(tmp_path / "run.json", [first, *ENTRIES[1:]]))
    assert np.isnan(recording.columns["temp"][0]) and recording.columns["temp"][1] == 35.0
    assert "state" in recording.left


def test_json_may_begin_with_the_mark_of_its_encoding(tmp_path: Path) -> None:
    (recording,) = read_recordings(bam(tmp_path / "servo.json", ENTRIES, "utf-8-sig"))
    assert recording.length == len(ENTRIES)
    source = table(tmp_path, {"time": TIME, "pos": ANGLE})
    source.with_suffix(".meta.json").write_text('{"mass": 0.5}', encoding="utf-8-sig")
    assert read_recordings(source)[0].facts["mass"] == 0.5


def test_stamps_of_a_timedelta_run_on_over_days(tmp_path: Path) -> None:
    """pandas writes its index so; the column was left out as text."""
    seconds = 86399.0 + TIME
    cells = [
        f"{int(s // 86400)} days {int(s % 86400) // 3600:02}:{int(s) // 60 % 60:02}:{s % 60:09.6f}" for s in seconds
    ]
    path = tmp_path / "run.csv"
    rows = (f"{cell},{goal},{angle}" for cell, goal, angle in zip(cells, GOAL, ANGLE, strict=True))
    path.write_text("\n".join([",cmd_rad,pos_rad", *rows]))
    (recording,) = read_recordings(path)
    np.testing.assert_allclose(recording.columns["column1_s"], seconds, atol=2e-6)


def test_a_signal_with_a_slower_clock_is_left_out(tmp_path: Path) -> None:
    slow = {"Time": TIME[::5], "Data": ANGLE[::5]}
    savemat(tmp_path / "run.mat", {"q_meas": {"Time": TIME, "Data": ANGLE}, "tau_meas": slow})
    (recording,) = read_recordings(tmp_path / "run.mat")
    assert "tau_meas.Data" not in recording.columns and "left out" in recording.notes[-1]
