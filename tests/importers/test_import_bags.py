"""ROS bags: joint states, trajectories and states of controllers as one table."""

from __future__ import annotations

import builtins
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray
from pyarrow import parquet
from sealegs.commands.cli import main
from sealegs.common.extras import MissingPackage
from sealegs.gap.log import LogError, read_measured
from sealegs.gap.log.importers import Recording, import_logs, propose_for, read_recordings
from sealegs.gap.log.importers.claims import claims_of
from sealegs.gap.log.importers.dialects import dialects
from sealegs.gap.log.importers.lines import ASK
from sealegs.gap.log.importers.proposal import propose

from tests.importers.importing import NEW, OLD, START, Bag, motion


@pytest.mark.parametrize("states", [True, False])
def test_a_topic_of_an_unknown_type_is_named_with_what_to_do(tmp_path: Path, states: bool) -> None:
    """The whole bag was refused for it."""
    with Bag(tmp_path / "run") as bag:
        bag.parts = NEW
        for k in range(100):
            bag.controller("/arm/controller_state", 0.01 * k, {"elbow": 0.0}, [0.0])
            if states:
                bag.state("/joint_states", 0.01 * k, ["elbow"], [0.01 * k])
        bag.parts = ()
    why = "the bag does not say how control_msgs/msg/JointTrajectoryControllerState is laid out; converted to MCAP"
    if states:
        assert why in read_recordings(tmp_path / "run")[0].left["arm.controller_state"]
    else:
        with pytest.raises(LogError, match=why):
            read_recordings(tmp_path / "run")


def test_samples_are_the_messages_that_name_the_most_joints(tmp_path: Path) -> None:
    """An arm and its gripper publish in turn on one topic: no row had all positions."""
    with Bag(tmp_path / "run") as bag:
        for k in range(200):
            bag.state("/joint_states", 0.01 * k, ["shoulder", "elbow"], [0.01 * k, 0.02 * k])
            bag.state("/joint_states", 0.01 * k + 0.003, ["finger"], [0.0])
    (found,) = read_recordings(tmp_path / "run")
    np.testing.assert_allclose(found.columns["joint_states.elbow.position"], 0.02 * np.arange(200))
    assert found.left["joint_states.finger.position"] == "it is not in the messages that name the most joints"


def test_a_trajectory_is_a_plan_and_no_command(tmp_path: Path) -> None:
    with Bag(tmp_path / "run") as bag:
        for k in range(100):
            bag.state("/joint_states", 0.01 * k, ["elbow"], [0.01 * k])
        bag.trajectory("/arm_controller/joint_trajectory", 0.5, ["elbow"], [])
    (found,) = read_recordings(tmp_path / "run")
    assert "record the controller's state" in found.left["arm_controller.joint_trajectory"]
    assert "arm_controller.joint_trajectory" in propose([found]).unused


NAMES = ("shoulder_joint", "elbow_joint")


@dataclass(frozen=True, eq=False)
class Moves:
    """Two joints at 200 Hz: times [s], goals and positions [rad], of shape (n,) and (n, 2)."""

    time: NDArray[np.float64]
    goal: NDArray[np.float64]
    position: NDArray[np.float64]


def moves() -> Moves:
    one, two = motion(6.0, 200.0, 0.05, seed=3), motion(6.0, 200.0, 0.05, seed=4)
    goal, position = (np.stack([one[word], two[word]], axis=1) for word in ("goal", "smooth"))
    return Moves(one["time"], goal, position)


def named(values: Sequence[float] | NDArray[np.float64]) -> dict[str, float]:
    return {name: float(value) for name, value in zip(NAMES, values, strict=True)}


@pytest.mark.long
@pytest.mark.parametrize("parts", [NEW, OLD])
def test_a_controller_slower_than_the_joint_states_commands_their_joints(tmp_path: Path, parts: Sequence[str]) -> None:
    """Its held feedback was no joint that is known: phantoms took the goals, and the real joints had none."""
    m, source, out = moves(), tmp_path / "run", tmp_path / "log"
    with Bag(source, parts=parts) as bag:
        for k, t in enumerate(m.time):
            bag.joints("/joint_states", float(t), named(m.position[k]))
            if k % 10 == 0:
                bag.controller("/scaled_arm_controller/state", float(t), named(m.goal[k]), list(m.position[k]))
    found = propose_for(source, out, robot="bench", actuator="ideal")
    assert not found.mapping.questions
    for part in set(parts) - {"reference", "desired"}:
        assert f"scaled_arm_controller.state.{part}: " in found.text
    import_logs(source, out, found.mapping)
    run = read_measured(out).runs[0]
    assert set(run.joints) == set(NAMES)
    held = m.goal[np.arange(len(m.time)) // 10 * 10]
    for k, name in enumerate(NAMES):
        goal = run.joints[name].goal
        assert goal is not None
        np.testing.assert_allclose(goal, held[:, k], atol=1e-9)


def test_velocities_that_a_controller_commands_stand_beside_its_goals(tmp_path: Path) -> None:
    with Bag(tmp_path / "run", parts=NEW) as bag:
        for k in range(300):
            bag.joints("/joint_states", 0.01 * k, {"elbow": np.sin(0.01 * k)})
            bag.controller("/arm/state", 0.01 * k, {"elbow": np.sin(0.01 * k)}, [0.0], [np.cos(0.01 * k)])
    (found,) = read_recordings(tmp_path / "run")
    column = "arm.state.elbow.reference.velocities"
    assert found.roles[column] == "elbow.goal_velocity" and found.units[column] == "rad/s"
    np.testing.assert_allclose(found.columns[column], np.cos(0.01 * np.arange(300)))


def test_of_two_controllers_of_a_joint_the_first_keeps_it(tmp_path: Path) -> None:
    with Bag(tmp_path / "run", parts=NEW) as bag:
        for k in range(300):
            bag.joints("/joint_states", 0.01 * k, {"elbow": np.sin(0.01 * k)})
            bag.controller("/first/state", 0.01 * k, {"elbow": 0.01 * k}, [0.0])
            bag.controller("/second/state", 0.01 * k, {"elbow": 1.0}, [0.0])
    (found,) = read_recordings(tmp_path / "run")
    assert [name for name, role in found.roles.items() if role == "elbow.goal"] == [
        "first.state.elbow.reference.positions"
    ]
    assert "first.state.elbow.reference.positions is its goal" in found.left["second.state.elbow.reference.positions"]


def test_where_a_stamp_is_missing_the_bag_says_the_times(tmp_path: Path) -> None:
    with Bag(tmp_path / "run", parts=NEW) as bag:
        for k in range(100):
            bag.joints("/joint_states", 0.01 * k, {"elbow": 0.01 * k}, 0.0 if k < 3 else 5.0 + 0.02 * k)
    (found,) = read_recordings(tmp_path / "run")
    assert any("have no stamp" in note for note in found.notes)
    np.testing.assert_allclose(found.columns["stamp"], 0.01 * np.arange(100), atol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("parts", [NEW, OLD])
def test_what_a_controller_measured_stands_in_for_joint_states(tmp_path: Path, parts: Sequence[str]) -> None:
    m, source, out = moves(), tmp_path / "run", tmp_path / "log"
    with Bag(source, parts=parts) as bag:
        for k, t in enumerate(m.time):
            bag.controller("/arm_controller/state", float(t), named(m.goal[k]), list(m.position[k]))
    found = propose_for(source, out, robot="bench", actuator="ideal")
    assert not found.mapping.questions
    assert f"/arm_controller/state/{parts[1]} stands in" in " ".join(found.text.replace("#", "").split())
    import_logs(source, out, found.mapping)
    run = read_measured(out).runs[0]
    assert set(run.joints) == set(NAMES)
    for k, name in enumerate(NAMES):
        goal = run.joints[name].goal
        assert goal is not None
        np.testing.assert_allclose(goal, m.goal[:, k], atol=1e-9)
        np.testing.assert_allclose(run.joints[name].position, m.position[:, k], atol=1e-9)


# --- robots of a bag whose joints have the same names, and lists that name no joints ----------------------------------


JOINTS = ("joint1", "joint2", "joint3", "joint4")
TIME = np.arange(600) * 0.01
Signals = Sequence[np.ndarray]


def _record(path: Path, topic: str, goals: Signals, positions: Signals, joints: Sequence[str] = JOINTS) -> Path:
    with Bag(path) as bag:
        for k, t in enumerate(TIME):
            bag.numbers(topic, float(t), [goal[k] for goal in goals])
            bag.state("/joint_states", float(t) + 1e-4, joints[: len(positions)], [one[k] for one in positions])
    return path


def _moved(seed: int, amplitude: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    made = motion(6.0, 100.0, 0.05, seed=seed)
    return amplitude * made["goal"], amplitude * made["smooth"]


def _listed_goals(path: Path, signal: str = "goal") -> dict[str, str]:
    found = propose(read_recordings(path))
    return {
        name: read.text for name, read in found.columns.items() if name.endswith(f".{signal}") and read.trust != ASK
    }


def _in_order(topic: str, count: int = 4) -> dict[str, str]:
    return {f"{joint}.goal": f"{topic}.data[{k}]" for k, joint in enumerate(JOINTS[:count])}


@pytest.mark.parametrize("topic", ["position_controller.commands", "forward_position_controller.commands"])
def test_a_list_that_names_no_joints_is_asked_about_in_the_order_of_the_positions(tmp_path: Path, topic: str) -> None:
    """``data[1]`` was taken for ``joint1``, for their numbers are the same."""
    moved = [_moved(3, amplitude) for amplitude in (0.3, 0.35, 0.4, 0.3)]
    path = _record(tmp_path / "run", f"/{topic.replace('.', '/')}", *zip(*moved, strict=True))
    found = propose(read_recordings(path))
    assert not _listed_goals(path) and {name: found.columns[name].text for name in _in_order(topic)} == _in_order(topic)
    assert [question.about for question in found.questions] == [tuple(_in_order(topic))]
    assert "names no joints" in found.questions[0].ask


def test_a_list_of_fewer_places_than_joints_is_left_out_with_a_reason(tmp_path: Path) -> None:
    goals, positions = zip(*[_moved(seed) for seed in (3, 4, 5)], strict=True)
    path = _record(tmp_path / "run", "/position_controller/commands", goals[1:], positions, ("finger", *JOINTS))
    found = propose(read_recordings(path))
    assert "write <joint>.goal where you know whose" in found.unused["position_controller.commands.data[0]"]


def test_torques_of_a_list_that_no_motion_explains_are_asked_about(tmp_path: Path) -> None:
    goals = [np.sin(rate * TIME**1.5) for rate in (2.1, 3.3, 4.7)]
    positions = [_moved(seed)[1] for seed in (3, 4, 5)]
    path = _record(tmp_path / "run", "/effort_controller/commands", goals, positions)
    assert not _listed_goals(path, "torque_command")
    about = propose(read_recordings(path)).questions[0].about
    assert about == tuple(f"{joint}.torque_command" for joint in JOINTS[:3])


def test_a_list_of_one_place_goes_to_the_joint_of_its_controller(tmp_path: Path) -> None:
    """``data[0]`` of ``joint1_controller`` was read as ``joint10``."""
    first, second = _moved(3), _moved(4)
    with Bag(tmp_path / "run") as bag:
        for k, t in enumerate(TIME):
            bag.numbers("/joint1_position_controller/commands", float(t), [first[0][k]])
            bag.numbers("/joint2_position_controller/commands", float(t), [second[0][k]])
            bag.state("/joint_states", float(t) + 1e-4, JOINTS[:2], [first[1][k], second[1][k]])
    assert _listed_goals(tmp_path / "run") == {
        f"joint{k}.goal": f"joint{k}_position_controller.commands.data" for k in (1, 2)
    }


def test_measured_lists_without_names_are_left_out_with_a_reason(tmp_path: Path) -> None:
    (goal, position), (other, second) = _moved(3), _moved(4)
    with Bag(tmp_path / "run") as bag:
        for k, t in enumerate(TIME):
            bag.numbers("/position_controller/commands", float(t), [goal[k], other[k]])
            bag.numbers("/motor_state/temperature", float(t), [30.0 + 0.01 * k, 31.0 + 0.01 * k])
            bag.state("/joint_states", float(t) + 1e-4, JOINTS[:2], [position[k], second[k]])
    found = propose_for(tmp_path / "run", tmp_path / "log")
    assert "temperature of a list that names no joints" in found.text
    assert "joint1.temperature:" not in found.text.partition("unused")[0]


def test_topics_that_have_the_same_joint_are_refused(tmp_path: Path) -> None:
    """The right arm got the goals of the left one, and nobody was asked."""
    with Bag(tmp_path / "run") as bag:
        for k, t in enumerate(TIME):
            bag.state("/joint_commands", float(t), ["joint1"], [0.01 * k])
            bag.state("/left/joint_states", float(t) + 1e-3, ["joint1"], [0.01 * k])
            bag.state("/right/joint_states", float(t) + 1e-3, ["joint1"], [0.02 * k])
    with pytest.raises(LogError, match="both have the joint 'joint1'; import a bag with one topic of joint states"):
        read_recordings(tmp_path / "run")


# --- leRobot data sets and ROS bags: fixtures as their own tools write them, read back joint by joint ----------------

ROBOT_NAMES = ["shoulder_pan.pos", "gripper.pos"]


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


@pytest.mark.parametrize(("version", "names"), [("v2.1", {"motors": ROBOT_NAMES}), ("v3.0", ROBOT_NAMES)])
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
    source = data_set(tmp_path / "data", "v3.0", 100.0 / 1.7, ROBOT_NAMES, turn=3456.7)
    proposal = propose(read_recordings(source))
    (question,) = proposal.questions
    assert question.about == ("shoulder_pan.position", "shoulder_pan.goal", "gripper.position", "gripper.goal")
    assert "degrees (unit=deg)" in question.ask and "calibrated" in question.ask
    assert main(["import", str(source), f"out={tmp_path / 'log'}", "yes=true"]) == 2
    assert main(["import", str(source), f"out={tmp_path / 'log'}", "yes=true", "unit=deg"]) == 0


def test_a_data_set_without_joints_or_whole_files_gets_one_sentence(tmp_path: Path) -> None:
    source = data_set(tmp_path / "data", "v1.6", 1.0, ROBOT_NAMES)
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
