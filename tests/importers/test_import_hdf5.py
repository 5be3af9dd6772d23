"""HDF5 files, and MATLAB's of version 7.3, which are HDF5: data sets by path, numbered groups as runs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from sealegs.common.extras import MissingPackage
from sealegs.gap.log import LogError
from sealegs.gap.log.importers import propose_for, read_recordings

from tests.importers.test_import_units import ANGLE, LATE, TIME

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
    lengths = (1000, 700)
    runs = [{"t": TIME[:n], "q": (LATE[:n, None] * SCALES), "q_ref": (ANGLE[:n, None] * SCALES)} for n in lengths]
    content = {"data": {"run": runs, "motor": "XL330"}, "joint_names": ["shoulder", "elbow"], "kp": 400.0}
    read = read_recordings(matlab73(tmp_path / "log.mat", content))
    assert [run.length for run in read] == [1000, 700]
    assert set(read[0].columns) == {"t", "shoulder.q", "elbow.q", "shoulder.q_ref", "elbow.q_ref"}
    np.testing.assert_allclose(read[1].columns["elbow.q"], 0.5 * LATE[:700])
    assert read[0].facts == {"data.motor": "XL330", "kp": 400.0}


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
