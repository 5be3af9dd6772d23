"""Tables as JSON, lines of JSON and named arrays, and columns of Parquet and MATLAB that are no vectors of numbers."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from scipy.io import savemat
from sealegs.gap.log import LogError
from sealegs.gap.log.importers import propose_for, read_recordings

from tests.importers.test_import_units import ANGLE, LATE, RAD, TIME, table

ROWS = [{"t": t, "arm": {"pos": p, "cmd": g}, "q": [p, g]} for t, g, p in zip(TIME, ANGLE, LATE, strict=True)]


@pytest.mark.parametrize("name", ["run.json", "run.jsonl", "lines.json", "columns.json"])
def test_json_is_a_table_by_rows_by_columns_and_by_lines(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    lines = "\n".join(json.dumps(row) for row in ROWS)
    columns = {"t": list(TIME), "arm": {"pos": list(LATE), "cmd": list(ANGLE)}, "q": [row["q"] for row in ROWS]}
    texts = {"run.json": json.dumps(ROWS), "columns.json": json.dumps({**columns, "mass": 0.5})}
    path.write_text(texts.get(name, lines))
    (recording,) = read_recordings(path)
    assert list(recording.columns) == ["t", "arm.pos", "arm.cmd", "q[0]", "q[1]"]
    np.testing.assert_allclose(recording.columns["arm.pos"], LATE)
    assert recording.facts == ({"mass": 0.5} if name == "columns.json" else {})


def test_a_line_that_is_no_json_is_named_and_a_last_one_that_was_cut_off_left_out(tmp_path: Path) -> None:
    path = tmp_path / "run.jsonl"
    lines = [json.dumps(row) for row in ROWS]
    path.write_text("\n".join([*lines, lines[0][:12]]))
    assert read_recordings(path)[0].length == len(ROWS)
    path.write_text("\n".join([lines[0], lines[0][:12], *lines]))
    with pytest.raises(LogError, match="line 2 is not JSON"):
        read_recordings(path)


def test_named_arrays_of_numpy_are_read_as_matlabs(tmp_path: Path) -> None:
    np.savez(tmp_path / "run.npz", t=TIME, q=np.stack([ANGLE, LATE], 1), mass=0.5, who=np.array("me"))
    (recording,) = read_recordings(tmp_path / "run.npz")
    assert list(recording.columns) == ["t", "q[0]", "q[1]"] and recording.facts == {"mass": 0.5, "who": "me"}
    (tmp_path / "bad.npz").write_bytes(b"no arrays")
    with pytest.raises(LogError, match="is no file of named arrays"):
        read_recordings(tmp_path / "bad.npz")


@pytest.mark.parametrize("cells", [[["a", "b"]] * len(TIME), [[0.1] * (1 + k % 3) for k in range(len(TIME))]])
def test_lists_of_words_or_of_changing_length_are_unused(tmp_path: Path, cells: list[list[object]]) -> None:
    columns = {"time_s": TIME, **RAD, "tags": cells}
    parquet.write_table(pa.table(columns), tmp_path / "run.parquet")
    assert (
        "tags: lists of different lengths, or not of numbers"
        in propose_for(tmp_path / "run.parquet", tmp_path / "out").text
    )


def test_complex_numbers_of_matlab_are_told_without_a_warning(tmp_path: Path) -> None:
    savemat(tmp_path / "run.mat", {"t": TIME, "pos": LATE, "q": LATE * (1.0 + 1.0j)})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        text = propose_for(tmp_path / "run.mat", tmp_path / "out").text
    assert "q: complex numbers, where a log has real ones" in text


@pytest.mark.parametrize("content", ["[1, 2]", '{"a": [1, 2]}', "no json"])
def test_a_neighbour_that_has_no_numbers_by_name_is_noted_and_not_read(tmp_path: Path, content: str) -> None:
    source = table(tmp_path, {"time_s": TIME, **RAD})
    source.with_suffix(".json").write_text(content)
    assert (
        "# Note: run.json has no numbers by their names and is not read." in propose_for(source, tmp_path / "out").text
    )
    assert len(read_recordings(tmp_path)) == 1


def test_a_clock_that_jumps_back_once_is_parted_there(tmp_path: Path) -> None:
    time = np.where(TIME < 5.0, TIME, TIME - 5.0)
    text = propose_for(table(tmp_path, {"time_s": time, **RAD}), tmp_path / "out").text
    assert "it jumps back in row 501, from 4.99 to 0: there one recording ends and the next begins" in text
    assert "`where: 500 - row`" in text and "`where: row - 499`" in text and "sort" not in text


def cell(items: list[object]) -> np.ndarray:
    out = np.empty(len(items), object)
    out[:] = items
    return out


@pytest.mark.parametrize("kind", ["cells", "structures", "structures in a structure"])
def test_a_cell_or_structure_for_each_run_becomes_runs(tmp_path: Path, kind: str) -> None:
    runs = [{"t": TIME[:n], "pos": LATE[:n], "cmd": ANGLE[:n]} for n in (1000, 700, 900)]
    contents: dict[str, dict[str, object]] = {
        "cells": {key: cell([run[key] for run in runs]) for key in runs[0]},
        "structures": {"run": cell(list(runs))},
        "structures in a structure": {"data": {"run": cell(list(runs)), "kp": 400.0}},
    }
    savemat(tmp_path / "log.mat", {**contents[kind], "mass": 0.5})
    recordings = read_recordings(tmp_path / "log.mat")
    assert [one.name for one in recordings] == ["log-1", "log-2", "log-3"]
    assert [one.length for one in recordings] == [1000, 700, 900]
    assert all(one.facts["mass"] == 0.5 for one in recordings)
    np.testing.assert_allclose(recordings[1].columns["pos"], LATE[:700])
    assert "joint.position: " in propose_for(tmp_path / "log.mat", tmp_path / "out").text


def test_columns_of_a_matrix_have_the_names_that_stand_beside_it(tmp_path: Path) -> None:
    content = {"q": np.stack([LATE, 0.5 * LATE], 1), "q_ref": np.stack([ANGLE, 0.5 * ANGLE], 1), "Ts": 0.01}
    savemat(tmp_path / "log.mat", {**content, "joint_names": cell(["shoulder", "elbow"])})
    np.savez(tmp_path / "log.npz", **content, joint_names=np.array(["shoulder", "elbow"]))
    for name in ("log.mat", "log.npz"):
        text = propose_for(tmp_path / name, tmp_path / "out").text
        for line in ("elbow.position: elbow.q ", "shoulder.goal: shoulder.q_ref ", "time: row*Ts "):
            assert line in text, text
        assert "questions" not in text.partition("unused")[0] or "time" not in text.partition("questions")[2]


@pytest.mark.parametrize(
    "name, value, text",
    [
        ("Ts", 0.01, "row*Ts"),
        ("dt_ms", 10.0, "row*dt_ms*1e-3"),
        ("fs", 100.0, "row/fs"),
        ("sampling_rate", 100, "row/sampling_rate"),
    ],
)
def test_a_sample_period_or_rate_of_the_file_is_the_time_where_no_clock_is(
    tmp_path: Path, name: str, value: float, text: str
) -> None:
    savemat(tmp_path / "log.mat", {"pos_deg": LATE, "cmd_deg": ANGLE, name: value})
    shown = propose_for(tmp_path / "log.mat", tmp_path / "out").text
    assert f"time: {text} " in shown and "100 Hz" in shown
    savemat(tmp_path / "other.mat", {"pos_deg": LATE, "cmd_deg": ANGLE, "frequency": 5.0})
    assert "which column is the time?" in propose_for(tmp_path / "other.mat", tmp_path / "out").text


def test_one_array_is_read_by_its_columns_or_fields(tmp_path: Path) -> None:
    np.save(tmp_path / "run.npy", np.stack([TIME, ANGLE, LATE], 1))
    (recording,) = read_recordings(tmp_path / "run.npy")
    assert list(recording.columns) == ["run[0]", "run[1]", "run[2]"]
    rows = np.array(list(zip(TIME, ANGLE, strict=True)), [("time", "f8"), ("cmd_rad", "f4")])
    np.save(tmp_path / "rows.npy", rows)
    (recording,) = read_recordings(tmp_path / "rows.npy")
    assert list(recording.columns) == ["time", "cmd_rad"]


@pytest.mark.parametrize("name", ["run.npy", "run.pkl"])
def test_objects_of_python_are_refused_with_the_way_to_save_them(tmp_path: Path, name: str) -> None:
    with open(tmp_path / name, "wb") as file:
        np.save(file, np.array({"time": TIME}, object), allow_pickle=True)
    with pytest.raises(LogError, match=r"can run any code; .*np\.savez\('run\.npz', \*\*arrays\)"):
        read_recordings(tmp_path / name)


def test_a_table_of_text_may_be_called_log(tmp_path: Path) -> None:
    table(tmp_path, {"time": TIME, **RAD}).rename(tmp_path / "run.log")
    assert list(read_recordings(tmp_path / "run.log")[0].columns) == ["time", *RAD]


def test_recordings_of_folders_in_a_folder_are_called_by_their_paths(tmp_path: Path) -> None:
    """A folder for each episode was refused as one without recordings."""
    for episode in ("train/episode_0", "train/episode_1", "val/episode_0"):
        (tmp_path / episode).mkdir(parents=True)
        table(tmp_path / episode, {"time": TIME, **RAD}, "data.csv")
        (tmp_path / episode / "meta.json").write_text('{"task": "lift"}')
    (tmp_path / "imported").mkdir()
    (tmp_path / "imported" / "log.yaml").write_text("robot: bench\n")
    table(tmp_path / "imported", {"time": TIME}, "old.csv")
    names = [recording.name for recording in read_recordings(tmp_path)]
    assert names == ["train-episode_0-data", "train-episode_1-data", "val-episode_0-data"]
    table(tmp_path, {"time": TIME, **RAD}, "top.csv")
    assert [recording.name for recording in read_recordings(tmp_path)] == ["top"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(LogError, match=r"holds no recording .* nor do the folders in it"):
        read_recordings(tmp_path / "empty")
