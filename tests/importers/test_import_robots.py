"""LeRobot data sets and ROS bags: fixtures as their own tools write them, read back joint by joint."""

from __future__ import annotations

import builtins
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from sealegs.commands.cli import main
from sealegs.common.extras import MissingPackage
from sealegs.gap.log import LogError, read_measured
from sealegs.gap.log.importers import Recording, import_logs, propose_for, read_recordings
from sealegs.gap.log.importers.claims import claims_of
from sealegs.gap.log.importers.dialects import dialects
from sealegs.gap.log.importers.proposal import propose

from tests.importers.bags import START, Bag
from tests.importers.importing import motion

NAMES = ["shoulder_pan.pos", "gripper.pos"]


def frames(episode: int, scale: float, turn: float = 4096.0) -> dict[str, Any]:
    """Columns of one episode of two joints: what was measured, in the unit of ``scale`` per rad, and the action."""
    m, n = motion(8.0, 30.0, 0.1, seed=episode), motion(8.0, 30.0, 0.1, seed=episode + 50)
    step = scale * 2.0 * np.pi / turn
    state = np.stack([np.round(scale * one["smooth"] / step) * step for one in (m, n)], axis=1)
    action = scale * np.stack([m["goal"], n["goal"]], axis=1)
    count = len(state)
    return {
        "observation.state": state.astype(np.float32),
        "action": action.astype(np.float32),
        "timestamp": (np.arange(count) / 30.0).astype(np.float32),
        "frame_index": np.arange(count),
        "episode_index": np.full(count, episode),
    }


def write(path: Path, columns: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    arrays = {
        name: pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])
        if values.ndim == 2
        else pa.array(values)
        for name, values in columns.items()
    }
    parquet.write_table(pa.table(arrays), path)


def data_set(folder: Path, version: str, scale: float, names: Any, turn: float = 4096.0, action: Any = None) -> Path:
    """Two episodes as LeRobot 2.1 (a file each) or 3.0 (one file) lays them out; actions may have other names."""
    feature = {"dtype": "float32", "shape": [2], "names": names}
    image = {"dtype": "video", "shape": [480, 640, 3], "names": ["height", "width", "channels"]}
    single = {"dtype": "int64", "shape": [1], "names": None}
    info = {
        "codebase_version": version, "robot_type": "so100", "fps": 30, "total_episodes": 2,
        "features": {
            "action": feature | {"names": action or names}, "observation.state": feature,
            "observation.images.top": image,
            "timestamp": single | {"dtype": "float32"}, "frame_index": single, "episode_index": single,
        },
    }  # fmt: skip
    (folder / "meta").mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    episodes = [frames(k, scale, turn) for k in range(2)]
    if version.startswith("v2"):
        for k, columns in enumerate(episodes):
            write(folder / f"data/chunk-000/episode_{k:06d}.parquet", columns)
    else:
        both = {name: np.concatenate([one[name] for one in episodes]) for name in episodes[0]}
        write(folder / "data/chunk-000/file-000.parquet", both)
    return folder


@pytest.mark.parametrize(("version", "names"), [("v2.1", {"motors": NAMES}), ("v3.0", NAMES)])
def test_episodes_of_a_lerobot_data_set_become_logs(tmp_path: Path, version: str, names: Any) -> None:
    source, out = data_set(tmp_path / "data", version, 180.0 / np.pi, names), tmp_path / "log"
    found = propose_for(source, out, robot="bench", actuator="sts3215")
    assert not found.mapping.questions  # the steps of the encoder are a turn in degrees by 4096
    done = import_logs(source, out, found.mapping)
    assert [path.stem for path in done.files] == ["episode_000000", "episode_000001"]
    second = read_measured(out).runs[1]
    wanted = motion(8.0, 30.0, 0.1, seed=1)
    assert list(second.joints) == ["shoulder_pan", "gripper"]
    np.testing.assert_allclose(second.joints["shoulder_pan"].position, wanted["smooth"], atol=1e-3)
    goal = second.joints["shoulder_pan"].goal
    assert goal is not None
    np.testing.assert_allclose(goal, wanted["goal"], atol=1e-6)


def test_normalised_positions_are_asked_about_together(tmp_path: Path) -> None:
    source = data_set(tmp_path / "data", "v3.0", 100.0 / 1.7, NAMES, turn=3456.7)
    proposal = propose(read_recordings(source))
    (question,) = proposal.questions
    assert question.about == ("shoulder_pan.position", "shoulder_pan.goal", "gripper.position", "gripper.goal")
    assert "degrees (unit=deg)" in question.ask and "calibrated" in question.ask
    assert main(["import", str(source), f"out={tmp_path / 'log'}", "yes=true"]) == 2
    assert main(["import", str(source), f"out={tmp_path / 'log'}", "yes=true", "unit=deg"]) == 0


def test_a_data_set_without_joints_or_whole_files_gets_one_sentence(tmp_path: Path) -> None:
    source = data_set(tmp_path / "data", "v1.6", 1.0, NAMES)
    with pytest.raises(LogError, match=r"version v1\.6; 2\.x and 3\.x are read"):
        read_recordings(source)


@pytest.mark.parametrize(
    "names", [[["hip", "knee"]], {"motors": [["hip", "knee"]]}, {"hip": 0, "knee": 1}, [["hip"], ["knee"]]]
)
def test_names_within_lists_and_mappings_name_the_joints(tmp_path: Path, names: object) -> None:
    (recording,) = read_recordings(data_set(tmp_path / "set", "v2.1", 1.0, names))[:1]
    claims = claims_of(recording, dialects())
    assert {claims[name].joint for name in recording.columns} == {"", "hip", "knee"}
    assert not any("joint0" in note for note in recording.notes)


# --- ROS -------------------------------------------------------------------------------------------------------------


def recorded(folder: Path, kind: str) -> Path:
    """Joint states at 100 Hz and commands at 50 Hz."""
    m, n = motion(6.0, 100.0, 0.05, seed=3), motion(6.0, 100.0, 0.05, seed=4)
    path = folder / (f"run.{kind}" if kind == "bag" else "run")
    with Bag(path, kind) as bag:
        for k, t in enumerate(m["time"]):
            both, speed = ([one[word][k] for one in (m, n)] for word in ("smooth", "velocity"))
            bag.state("/joint_states", t, ["elbow", "wrist"], both, velocity=speed, effort=[0.1 * s for s in speed])
            if k % 2 == 0 and k >= 10:
                bag.state("/arm/joint_command", t, ["elbow", "wrist"], [m["goal"][k], n["goal"][k]])
    return next(path.glob("*.mcap")) if kind == "mcap" else path


@pytest.mark.long
@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_joint_states_and_their_commands_become_a_log(tmp_path: Path, kind: str) -> None:
    source, out = recorded(tmp_path, kind), tmp_path / "log"
    found = propose_for(source, out, robot="bench", actuator="ideal")
    assert not found.mapping.questions
    assert "the first 10 samples, before the first command, are left out" in found.text
    import_logs(source, out, found.mapping)
    run = read_measured(out).runs[0]
    wanted = motion(6.0, 100.0, 0.05, seed=4)
    wrist = run.joints["wrist"]
    assert list(run.joints) == ["elbow", "wrist"] and wrist.torque is not None and wrist.velocity is not None
    assert wrist.goal is not None
    np.testing.assert_allclose(wrist.position, wanted["smooth"][10:], atol=1e-9)
    np.testing.assert_allclose(wrist.goal, np.repeat(wanted["goal"][10::2], 2), atol=1e-9)
    assert run.time[0] == pytest.approx(0.1, abs=1e-6)


def two_topics(
    path: Path, offset: float, command: str, names: Sequence[Sequence[str]] = (("elbow", "wrist"),), late: float = 0.0
) -> Recording:
    """Joint states at 100 Hz whose stamps are ``offset`` from the bag's clock, and commands at 20 Hz that lead by 1 ms.

    Commands of joint states name the joints of ``names`` in turn, and their stamps are ``late`` after those of states.
    """
    with Bag(path) as bag:
        for k in range(600):
            seconds = 0.01 * k
            if k % 5 == 0 and command.endswith("commands"):
                bag.numbers(command, seconds - 1e-3, [seconds])
            elif k % 5 == 0:
                who = names[k // 5 % len(names)]
                bag.state(command, seconds - 1e-3, who, [seconds] * len(who), START + seconds - 1e-3 + offset + late)
            bag.state("/joint_states", seconds, ["elbow", "wrist"], [seconds, 0.0], START + seconds + offset)
    (found,) = read_recordings(path)
    return found


@pytest.mark.parametrize("offset", [0.0, -0.2, 10.0 - 1.7e9])
def test_commands_without_a_stamp_stand_where_the_bag_received_them(tmp_path: Path, offset: float) -> None:
    """They vanished beside stamps of a simulation, and were shifted beside those of another computer's clock."""
    found = two_topics(tmp_path / "run", offset, "/position_controller/commands")
    goal = found.columns["position_controller.commands.data"]
    np.testing.assert_allclose(goal, 0.05 * np.floor(np.arange(600) / 5.0), atol=1e-9)
    assert any("since messages of /position_controller/commands have no stamp" in note for note in found.notes)
    assert not found.left


def test_stamps_are_the_clock_where_every_message_has_one(tmp_path: Path) -> None:
    found = two_topics(tmp_path / "run", -0.2, "/arm/joint_command")
    np.testing.assert_allclose(np.diff(found.columns["stamp"]), 0.01, atol=1e-6)
    assert "times are the stamps of the messages" in found.notes


@pytest.mark.parametrize("late", [100.0, -100.0])
def test_a_topic_of_another_time_is_left_out_with_the_reason(tmp_path: Path, late: float) -> None:
    """One of later times vanished without a word; one of earlier times held its last value throughout."""
    found = two_topics(tmp_path / "run", 0.0, "/arm/joint_command", late=late)
    assert not [name for name in found.columns if "command" in name]
    assert "do not overlap" in found.left["arm.joint_command.elbow.position"]
    assert "arm.joint_command.elbow.position" in propose([found]).unused


def test_a_joint_that_a_command_does_not_name_holds_its_last_one(tmp_path: Path) -> None:
    found = two_topics(tmp_path / "run", 0.0, "/arm/joint_command", names=(["elbow"], ["wrist"]))
    elbow, wrist = (found.columns[f"arm.joint_command.{joint}.position"] for joint in ("elbow", "wrist"))
    rows = np.arange(5, 600)  # the first command of the wrist is the second message
    assert any("the first 5 samples, before the first command" in note for note in found.notes)
    np.testing.assert_allclose(elbow, 0.1 * np.floor(rows / 10.0), atol=1e-9)
    np.testing.assert_allclose(wrist, 0.1 * np.floor((rows - 5) / 10.0) + 0.05, atol=1e-9)


def test_without_the_library_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usual = builtins.__import__

    def absent(name: str, *rest: Any, **named: Any) -> Any:
        if name.startswith("rosbags"):
            raise ModuleNotFoundError("No module named 'rosbags'", name="rosbags")
        return usual(name, *rest, **named)

    monkeypatch.setattr(builtins, "__import__", absent)
    (tmp_path / "run.bag").write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(MissingPackage, match=r"pip install 'sealegs\[ros\]'"):
        read_recordings(tmp_path / "run.bag")


def test_a_damaged_bag_gets_one_sentence(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    for name in ("run.bag", "run.mcap", "run.db3"):
        (tmp_path / name).write_bytes(b"nothing of the kind" * 20)
        with pytest.raises(LogError, match="cannot be read as a bag"):
            read_recordings(tmp_path / name)
