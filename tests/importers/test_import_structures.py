"""Joints in parts: arrays of structures, signals of Simulink, a file for each joint, and a ``d`` for desired."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from sealegs.gap.log import LogError
from sealegs.gap.log.importers import propose_for, read_recordings

from tests.importers.importing import motion

MOTIONS = [motion(5.0, 100.0, seed=seed) for seed in range(3)]
TIME = MOTIONS[0]["time"]
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
    savemat(path, {"t": TIME[:, None], name: structures([signals(k) for k in range(3)])})
    (recording,) = read_recordings(path)
    for k in range(3):
        np.testing.assert_allclose(recording.columns[f"{name}{k + 1}.q"], MOTIONS[k]["smooth"])
    columns = columns_of(path)
    assert sorted(text for key, text in columns.items() if key.endswith(".position")) == [
        f"{name}{k}.q" for k in (1, 2, 3)
    ]
    assert sum(key.endswith(".goal") for key in columns) == 3


def test_an_array_of_structures_beside_the_only_clock_is_one_recording(tmp_path: Path) -> None:
    content = {"time": TIME[:, None], "s": structures([signals(k) for k in range(2)])}
    savemat(tmp_path / "log.mat", {"data": content})
    columns = columns_of(tmp_path / "log.mat")
    assert columns["s1.position"] == "data.s1.q" and columns["s2.goal"] == "data.s2.q_ref"


@pytest.mark.parametrize(
    ("name", "own", "outside"), [("data", True, False), ("data", True, True), ("trial", False, True)]
)
def test_an_array_of_structures_with_a_clock_each_or_called_as_runs_stays_runs(
    tmp_path: Path, name: str, own: bool, outside: bool
) -> None:
    items = [signals(k, **({"t": TIME[:, None]} if own else {})) for k in range(3)]
    savemat(tmp_path / "log.mat", {name: structures(items), **({"t": TIME[:, None]} if outside else {})})
    assert [one.name for one in read_recordings(tmp_path / "log.mat")] == ["log-1", "log-2", "log-3"]


@pytest.mark.parametrize("apart", [0.0, 7.0])
def test_joints_with_a_clock_each_are_of_one_recording_where_the_clocks_are_the_same(
    tmp_path: Path, apart: float
) -> None:
    items = [signals(k, t=(TIME + k * apart)[:, None]) for k in range(3)]
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
        rows = zip(begin + TIME, one["goal"], one["smooth"], strict=True)
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
