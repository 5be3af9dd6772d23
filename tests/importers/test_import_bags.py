"""ROS bags: joint states, trajectories and states of controllers as one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from sealegs.gap.log import LogError, read_measured
from sealegs.gap.log.importers import import_logs, propose_for, read_recordings
from sealegs.gap.log.importers.lines import ASK
from sealegs.gap.log.importers.proposal import propose

from tests.importers.bags import NEW, OLD, Bag
from tests.importers.importing import motion


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
