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
