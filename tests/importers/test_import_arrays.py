"""Files of arrays: JSON, NumPy, MATLAB of any version, HDF5 and tensors, by the names of their variables."""

from __future__ import annotations

import json
import sys
import warnings
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from scipy.io import savemat
from sealegs.common.extras import MissingPackage
from sealegs.gap.log import LogError
from sealegs.gap.log.importers import propose_for, read_recordings
from sealegs.gap.log.importers.claims import claims_of
from sealegs.gap.log.importers.dialects import dialects

from tests.importers.importing import ANGLE, LATE, RAD, TIME, motion, table

ROWS = [{"t": t, "arm": {"pos": p, "cmd": g}, "q": [p, g]} for t, g, p in zip(TIME, ANGLE, LATE, strict=True)]


@pytest.mark.parametrize("name", ["run.json", "run.jsonl", "columns.json"])
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


def test_a_line_that_is_no_json_is_named(tmp_path: Path) -> None:
    path = tmp_path / "run.jsonl"
    lines = [json.dumps(row) for row in ROWS]
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


def cell(items: list[object]) -> np.ndarray:
    out = np.empty(len(items), object)
    out[:] = items
    return out


@pytest.mark.parametrize("kind", ["structures", "structures in a structure"])
def test_a_structure_for_each_run_becomes_runs(tmp_path: Path, kind: str) -> None:
    runs = [{"t": TIME[:n], "pos": LATE[:n], "cmd": ANGLE[:n]} for n in (1000, 700, 900)]
    contents: dict[str, dict[str, object]] = {
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


SCALES = np.array([1.0, 0.5])


def h5(path: Path, content: dict[str, Any], facts: dict[str, Any] | None = None) -> Path:
    with h5py.File(path, "w") as file:
        for name, value in content.items():
            file[name] = value
        file.attrs.update(facts or {})
    return path


def matlab73(path: Path, content: dict[str, Any]) -> Path:
    """A file as MATLAB writes it with ``-v7.3``: arrays turned, text as numbers, cells and structures as references."""
    with h5py.File(path, "w", userblock_size=512) as file:
        refs = file.create_group("#refs#")

        def put(group: h5py.Group, name: str, value: Any) -> None:
            if isinstance(value, dict):
                own = group.create_group(name)
                own.attrs["MATLAB_class"] = np.bytes_("struct")
                for key, field in value.items():
                    put(own, key, field)
            elif isinstance(value, str):
                group[name] = np.array([[ord(sign)] for sign in value], np.uint16)
                group[name].attrs["MATLAB_class"] = np.bytes_("char")
            elif isinstance(value, list) and isinstance(value[0], dict):  # an array of structures
                own = group.create_group(name)
                own.attrs["MATLAB_class"] = np.bytes_("struct")
                for key in value[0]:
                    own[key] = cells([one[key] for one in value])
            elif isinstance(value, list):
                group[name] = cells(value)
                group[name].attrs["MATLAB_class"] = np.bytes_("cell")
            else:
                group[name] = np.atleast_2d(np.asarray(value, float).T)
                group[name].attrs["MATLAB_class"] = np.bytes_("double")

        def cells(values: list[Any]) -> np.ndarray:
            names = [f"r{len(refs) + k}" for k in range(len(values))]
            for name, value in zip(names, values, strict=True):
                put(refs, name, value)
            return np.array([[refs[name].ref] for name in names], h5py.ref_dtype)

        for name, value in content.items():
            put(file, name, value)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return path


def test_an_episode_of_teleoperation_has_its_joints_by_number(tmp_path: Path) -> None:
    content = {
        "action": ANGLE[:, None] * SCALES,
        "observations/qpos": LATE[:, None] * SCALES,
        "observations/images/top": np.zeros((len(TIME), 4, 4, 3), np.uint8),
    }
    path = h5(tmp_path / "episode_0.hdf5", content, {"sim": False, "fps": 100})
    text = propose_for(path, tmp_path / "out").text
    assert "joint0.position: observations.qpos[0]" in text and "joint1.goal: action[1]" in text
    assert "time: row/fps " in text and "observations.images.top" in text


@pytest.mark.parametrize("lengths", [(1000, 1000), (1000, 700)])
def test_numbered_groups_of_one_form_are_runs(tmp_path: Path, lengths: tuple[int, int]) -> None:
    content: dict[str, Any] = {"mass": 0.5}
    for k, n in zip((2, 10), lengths, strict=True):
        content |= {f"data/demo_{k}/obs/joint_pos": LATE[:n], f"data/demo_{k}/actions": ANGLE[:n]}
    runs = read_recordings(h5(tmp_path / "log.h5", content))
    assert [(run.name, run.length) for run in runs] == [("log-demo_2", lengths[0]), ("log-demo_10", lengths[1])]
    assert set(runs[0].columns) == {"obs.joint_pos", "actions"} and runs[1].facts == {"mass": 0.5}


def test_numbered_groups_of_one_length_that_are_not_called_runs_are_joints(tmp_path: Path) -> None:
    content = {f"motor_{k}/{name}": values for k in (1, 2) for name, values in (("pos", LATE), ("cmd", ANGLE))}
    (run,) = read_recordings(h5(tmp_path / "log.h5", {"time": TIME, **content}))
    assert set(run.columns) == {"time", "motor_1.pos", "motor_1.cmd", "motor_2.pos", "motor_2.cmd"}
    assert "motor2.goal: motor_2.cmd" in propose_for(tmp_path / "log.h5", tmp_path / "out").text


def test_matlab_files_of_version_7_3_are_read_as_those_before(tmp_path: Path) -> None:
    content = {"data": {"t": TIME, "q": LATE[:, None] * SCALES, "motor": "XL330"}, "joint_names": ["shoulder", "elbow"]}
    (run,) = read_recordings(matlab73(tmp_path / "log.mat", {**content, "kp": 400.0}))
    assert set(run.columns) == {"data.t", "shoulder.data.q", "elbow.data.q"}
    np.testing.assert_allclose(run.columns["elbow.data.q"], 0.5 * LATE)
    assert run.facts == {"data.motor": "XL330", "kp": 400.0}


def test_what_is_neither_numbers_nor_words_is_unused_and_words_of_either_kind_name_columns(tmp_path: Path) -> None:
    """References, lists of changing length and empty data sets ended in a traceback."""
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["q"] = LATE[:, None] * SCALES
        file["names"] = np.array([b"shoulder", b"elbow"])
        file["refs"] = np.array([file["q"].ref], h5py.ref_dtype)
        file.create_dataset("lists", (2,), h5py.vlen_dtype(np.float64))
        file["nothing"] = h5py.Empty("f8")
        file["no_words"] = h5py.Empty(h5py.string_dtype())
    (run,) = read_recordings(tmp_path / "log.h5")
    assert set(run.columns) == {"shoulder.q", "elbow.q"} and not run.facts
    assert {"refs", "lists", "nothing", "no_words", "names"} <= set(run.left)


@pytest.mark.parametrize("name", ["log.h5", "log.mat"])
def test_a_damaged_file_gets_one_sentence(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + b"\0" * 600)
    with pytest.raises(LogError, match=r"or a damaged one"):
        read_recordings(tmp_path / name)


def test_without_the_library_the_extra_and_the_other_way_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = matlab73(tmp_path / "log.mat", {"t": TIME, "pos": LATE})
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(MissingPackage, match=r"pip install 'sealegs\[hdf5\]', or save it in MATLAB"):
        read_recordings(path)


MADE = motion(5.0, 100.0)
T, G, Q = (MADE[name].tolist() for name in ("time", "goal", "smooth"))


def entries(per: float = 1.0) -> list[dict[str, float]]:
    return [{"timestamp": t, "goal_position": per * g, "position": per * q} for t, g, q in zip(T, G, Q, strict=True)]


def document(folder: Path, content: Any) -> Path:
    path = folder / "run.json"
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize("own", [{"kp": 32}, {"motor": "sts3215"}, {"mass": 0.5, "length": 0.1}])
def test_entries_with_a_load_a_gain_or_a_motor_are_of_bam(tmp_path: Path, own: dict[str, Any]) -> None:
    (recording,) = read_recordings(document(tmp_path, {**own, "entries": entries()}))
    assert recording.kind == "bam"
    assert claims_of(recording, dialects())["goal_position"].joint == "servo"


IN_DEG = [{"t": t, "goal_deg": g, "pos_deg": q} for t, g, q in zip(T, G, Q, strict=True)]


@pytest.mark.parametrize(
    ("content", "asked"),
    [
        ({"robot": "arm", "unit": "deg", "samples": entries(57.3)}, True),
        ({"motor": "mx28", "units": {"position": "deg"}, "entries": entries(10.0)}, True),
        ({"unit": "rad", "log": IN_DEG}, False),
        ({"entries": entries(57.3)}, True),
    ],
)
def test_any_other_list_of_rows_is_a_table_whose_units_are_in_its_names(
    tmp_path: Path, content: dict[str, Any], asked: bool
) -> None:
    """Its angles were taken for rad, which the format was to say."""
    proposed = propose_for(document(tmp_path, content), tmp_path / "out")
    about = {name for question in proposed.mapping.questions for name in question.about}
    assert proposed.recordings[0].kind == "table" and ("joint.position" in about) == asked


def test_rows_beside_columns_of_their_length_stay_one_table(tmp_path: Path) -> None:
    states = [{"q": q, "goal": g} for g, q in zip(G, Q, strict=True)]
    (recording,) = read_recordings(document(tmp_path, {"time": T, "states": states}))
    assert set(recording.columns) == {"time", "states.q", "states.goal"}


# --- joints in parts: arrays of structures, signals of Simulink, a file for each joint, and a ``d`` for desired ------

MOTIONS = [motion(5.0, 100.0, seed=seed) for seed in range(3)]
STRUCTURE_TIME = MOTIONS[0]["time"]
UNIX = 1.7e9


def structures(items: list[dict[str, object]]) -> np.ndarray:
    """MATLAB's array of structures."""
    out = np.zeros(len(items), [(name, object) for name in items[0]])
    for k, item in enumerate(items):
        out[k] = tuple(item.values())
    return out


def signals(k: int, **more: object) -> dict[str, object]:
    return {"q_ref": MOTIONS[k]["goal"][:, None], "q": MOTIONS[k]["smooth"][:, None], **more}


def columns_of(source: Path, robot: Path | None = None) -> dict[str, str]:
    """Expressions of the proposal, of which nothing is in question."""
    mapping = propose_for(source, source.parent / "out", "rad", robot=str(robot) if robot else None).mapping
    assert not mapping.questions
    return mapping.columns


def robot_of(folder: Path, *joints: str) -> Path:
    inner = ""
    for joint in reversed(joints):
        inner = f'<body pos="0 0 1"><joint name="{joint}"/><geom size="0.1" mass="1"/>{inner}</body>'
    path = folder / "arm.xml"
    path.write_text(f"<mujoco><worldbody>{inner}</worldbody></mujoco>")
    return path


@pytest.mark.parametrize("name", ["joint", "motor", "axis", "leg", "servoLog"])
def test_an_array_of_structures_that_is_called_as_joints_is_one_recording(tmp_path: Path, name: str) -> None:
    """It became three runs of one joint, which were fitted as one motor."""
    path = tmp_path / "log.mat"
    savemat(path, {"t": STRUCTURE_TIME[:, None], name: structures([signals(k) for k in range(3)])})
    (recording,) = read_recordings(path)
    for k in range(3):
        np.testing.assert_allclose(recording.columns[f"{name}{k + 1}.q"], MOTIONS[k]["smooth"])
    columns = columns_of(path)
    assert sorted(text for key, text in columns.items() if key.endswith(".position")) == [
        f"{name}{k}.q" for k in (1, 2, 3)
    ]
    assert sum(key.endswith(".goal") for key in columns) == 3


def test_an_array_of_structures_beside_the_only_clock_is_one_recording(tmp_path: Path) -> None:
    content = {"time": STRUCTURE_TIME[:, None], "s": structures([signals(k) for k in range(2)])}
    savemat(tmp_path / "log.mat", {"data": content})
    columns = columns_of(tmp_path / "log.mat")
    assert columns["s1.position"] == "data.s1.q" and columns["s2.goal"] == "data.s2.q_ref"


@pytest.mark.parametrize(
    ("name", "own", "outside"), [("data", True, False), ("data", True, True), ("trial", False, True)]
)
def test_an_array_of_structures_with_a_clock_each_or_called_as_runs_stays_runs(
    tmp_path: Path, name: str, own: bool, outside: bool
) -> None:
    items = [signals(k, **({"t": STRUCTURE_TIME[:, None]} if own else {})) for k in range(3)]
    savemat(tmp_path / "log.mat", {name: structures(items), **({"t": STRUCTURE_TIME[:, None]} if outside else {})})
    assert [one.name for one in read_recordings(tmp_path / "log.mat")] == ["log-1", "log-2", "log-3"]


@pytest.mark.parametrize("apart", [0.0, 7.0])
def test_joints_with_a_clock_each_are_of_one_recording_where_the_clocks_are_the_same(
    tmp_path: Path, apart: float
) -> None:
    items = [signals(k, t=(STRUCTURE_TIME + k * apart)[:, None]) for k in range(3)]
    savemat(tmp_path / "log.mat", {"joint": structures(items)})
    if apart:
        with pytest.raises(LogError, match=r"joint1\.t and joint2\.t are clocks that differ"):
            read_recordings(tmp_path / "log.mat")
    else:
        assert len(read_recordings(tmp_path / "log.mat")) == 1


def files_of(folder: Path, names: tuple[str, ...], begins: tuple[float, ...]) -> Path:
    """A folder of files with the same columns."""
    folder.mkdir()
    for name, begin, one in zip(names, begins, MOTIONS, strict=False):
        rows = zip(begin + STRUCTURE_TIME, one["goal"], one["smooth"], strict=True)
        lines = [f"{at:.3f},{goal:.9f},{position:.9f}" for at, goal, position in rows]
        (folder / f"{name}.csv").write_text("\n".join(["time,goal,position", *lines]))
    return folder


@pytest.mark.parametrize("begins", [(0.0, 0.0), (0.0, 0.004), (UNIX, UNIX + 0.104)])
def test_files_that_are_called_as_joints_of_the_robot_are_refused(tmp_path: Path, begins: tuple[float, float]) -> None:
    """They became two runs of one joint."""
    source = files_of(tmp_path / "arm", ("elbow", "shoulder"), begins)
    with pytest.raises(LogError, match=r"elbow.csv, shoulder.csv look like a file for each joint .*elbow.position"):
        propose_for(source, tmp_path / "out", "rad", robot=str(robot_of(tmp_path, "shoulder", "elbow")))


def test_files_of_one_time_of_the_day_that_no_robot_names_are_refused(tmp_path: Path) -> None:
    source = files_of(tmp_path / "arm", ("left", "right"), (UNIX, UNIX + 0.5))
    with pytest.raises(LogError, match=r"left.csv, right.csv look like a file for each joint of one recording"):
        propose_for(source, tmp_path / "out", "rad")


@pytest.mark.parametrize("begins", [(0.0, 0.0), (UNIX, UNIX + 600.0)])
def test_files_of_separate_times_or_with_clocks_from_zero_stay_runs(
    tmp_path: Path, begins: tuple[float, float]
) -> None:
    source = files_of(tmp_path / "arm", ("sine", "steps"), begins)
    assert len(propose_for(source, tmp_path / "out", "rad").recordings) == 2


def test_a_copy_of_a_recording_is_no_joint(tmp_path: Path) -> None:
    source = files_of(tmp_path / "arm", ("one",), (UNIX,))
    (source / "copy.csv").write_text((source / "one.csv").read_text())
    assert len(propose_for(source, tmp_path / "out", "rad").recordings) == 2
