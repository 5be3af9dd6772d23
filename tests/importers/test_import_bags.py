"""ROS bags: joint states, trajectories and states of controllers as one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from sealegs.gap.log import LogError, read_measured
from sealegs.gap.log.importers import import_logs, propose_for, read_recordings
from sealegs.gap.log.importers.proposal import propose

from tests.importers.bags import NEW, OLD, Bag, Points
from tests.importers.importing import motion


def test_a_topic_of_an_unknown_type_is_named_and_the_rest_is_read(tmp_path: Path) -> None:
    """``ros2 bag record -a`` holds ``/dynamic_joint_states``; the whole bag was refused for it."""
    m, source, out = motion(6.0, 100.0, 0.05, seed=3), tmp_path / "run", tmp_path / "log"
    with Bag(source) as bag:
        for k, t in enumerate(m["time"]):
            bag.state("/joint_states", float(t), ["elbow"], [m["smooth"][k]])
            bag.state("/arm/joint_command", float(t), ["elbow"], [m["goal"][k]])
            bag.dynamic("/dynamic_joint_states", float(t), {"elbow": {"position": 0.0}})
    found = propose_for(source, out, robot="bench", actuator="ideal")
    assert "dynamic_joint_states: the bag does not say how control_msgs/msg/DynamicJointState" in found.text
    assert "MCAP" in found.text
    import_logs(source, out, found.mapping)
    np.testing.assert_allclose(read_measured(out).runs[0].joints["elbow"].position, m["smooth"], atol=1e-9)


def test_a_bag_of_unknown_types_alone_says_which_and_what_to_do(tmp_path: Path) -> None:
    with Bag(tmp_path / "run") as bag:
        bag.dynamic("/dynamic_joint_states", 0.0, {"elbow": {"position": 0.0}})
    with pytest.raises(LogError, match=r"how /dynamic_joint_states \(control_msgs.*\) is laid out; .* MCAP") as raised:
        read_recordings(tmp_path / "run")
    assert "\n" not in str(raised.value)


@pytest.mark.long
def test_drivers_that_share_a_topic_stand_in_common_rows(tmp_path: Path) -> None:
    """An arm and its gripper publish in turn: no row had all positions, and a goal that is held was blamed."""
    m, n = motion(6.0, 100.0, 0.05, seed=3), motion(6.0, 100.0, 0.05, seed=4)
    source, out, time = tmp_path / "run", tmp_path / "log", m["time"]
    with Bag(source) as bag:
        for k, t in enumerate(time):
            bag.state("/joint_states", float(t), ["shoulder", "elbow"], [m["smooth"][k], n["smooth"][k]])
            if k % 2 == 0:
                bag.state("/joint_states", float(t) + 0.003, ["finger"], [float(np.sin(t + 0.003))])
            bag.state("/arm/joint_command", float(t), ["shoulder", "elbow", "finger"], [m["goal"][k], n["goal"][k], 0])
    found = propose_for(source, out, robot="bench", actuator="ideal")
    assert "samples are those of the most joints, and finger of other messages is linear between its own" in found.text
    import_logs(source, out, found.mapping)
    run = read_measured(out).runs[0]
    rows = np.round((run.time - run.time[0]) * 100.0).astype(int) + 1  # the first message of the finger is late
    assert len(run.time) >= len(time) - 4
    np.testing.assert_allclose(run.joints["elbow"].position, n["smooth"][rows], atol=1e-9)
    np.testing.assert_allclose(run.joints["finger"].position, np.sin(time[rows]), atol=1e-4)


@pytest.mark.long
def test_a_pause_of_one_driver_is_no_motion(tmp_path: Path) -> None:
    """Nothing is interpolated where a driver was silent: these rows are left out."""
    with Bag(tmp_path / "run") as bag:
        for k in range(600):
            bag.state("/joint_states", 0.01 * k, ["shoulder", "elbow"], [0.01 * k, 0.0])
            if not 200 <= k < 300:
                bag.state("/joint_states", 0.01 * k, ["finger"], [0.02 * k])
    (found,) = read_recordings(tmp_path / "run")
    assert "100 samples, at which not all joints were measured, are left out" in found.notes
    shoulder, finger = (found.columns[f"joint_states.{joint}.position"] for joint in ("shoulder", "finger"))
    np.testing.assert_allclose(finger, 2.0 * shoulder, atol=1e-9)
    assert np.diff(found.columns["stamp"]).max() > 1.0


def led(path: Path, sent: Sequence[tuple[float, Points]], rest: float = 0.0) -> np.ndarray[Any, Any]:
    """Goals of the elbow at 100 Hz where ``/arm_controller/joint_trajectory`` got messages at some times [s]."""
    with Bag(path) as bag:
        for k in range(601):
            bag.state("/joint_states", 0.01 * k, ["elbow"], [rest])
        for seconds, points in sent:
            bag.trajectory("/arm_controller/joint_trajectory", seconds, ["elbow"], points)
    (found,) = read_recordings(path)
    name = "arm_controller.joint_trajectory.elbow.goal"
    assert found.roles[name] == "elbow.goal" and found.units[name] == "rad"
    assert any("`time_from_start`" in note for note in found.notes)
    full = np.full(601, np.nan)
    full[-len(found.columns[name]) :] = found.columns[name]
    return full


WAVE: Points = [(float(t), [float(np.sin(t))], [float(np.cos(t))]) for t in np.linspace(0.0, 4.0, 9)]
AT = 0.01 * np.arange(601)


@pytest.mark.parametrize(
    ("sent", "rest", "wanted"),
    [
        ([(1.0, [(1.0, [1.0], []), (2.0, [0.0], [])])], 0.5, np.interp(AT, [1.0, 2.0, 3.0], [0.5, 1.0, 0.0])),
        # a later message replaces the rest of an earlier one
        ([(1.0, [(0.0, [0.0], []), (2.0, [2.0], [])]), (2.0, [(1.0, [0.0], [])])], 0.0,
         np.interp(AT, [1.0, 2.0, 3.0], [0.0, 1.0, 0.0])),
        # points with velocities are joined by cubics
        ([(1.0, WAVE)], 0.0, np.sin(np.clip(AT - 1.0, 0.0, 4.0))),
    ],
)  # fmt: skip
def test_points_of_a_trajectory_are_laid_out_after_its_message(
    tmp_path: Path, sent: Sequence[tuple[float, Points]], rest: float, wanted: np.ndarray[Any, Any]
) -> None:
    """A topic without a word of a command was not read, and of a message its first point alone."""
    goal = led(tmp_path / "run", sent, rest)
    assert np.isnan(goal[:100]).all()
    np.testing.assert_allclose(goal[100:], wanted[100:], atol=5e-4)


def test_a_stream_of_points_that_are_never_due_moves_the_goal(tmp_path: Path) -> None:
    """Teleoperation replaces each message before its point: a controller is on the way to it all the same."""
    goal = led(tmp_path / "run", [(0.02 * k, [(0.1, [0.02 * k + 0.1], [])]) for k in range(250)])
    assert goal[240] == pytest.approx(2.4, abs=0.15)


def test_a_trajectory_becomes_the_goal_of_its_joint(tmp_path: Path) -> None:
    m, source, out = motion(6.0, 100.0, 0.05, seed=3), tmp_path / "run", tmp_path / "log"
    points = [(float(t), [float(g)], []) for t, g in zip(m["time"], m["goal"], strict=True)]
    with Bag(source) as bag:
        for k, t in enumerate(m["time"]):
            bag.state("/joint_states", float(t), ["shoulder_joint"], [m["smooth"][k]])
        bag.trajectory("/arm_controller/joint_trajectory", 0.0, ["shoulder_joint"], points)
    found = propose_for(source, out, robot="bench", actuator="ideal")
    assert not found.mapping.questions and "points_" not in found.text
    import_logs(source, out, found.mapping)
    run = read_measured(out).runs[0]
    goal = run.joints["shoulder_joint"].goal
    assert list(run.joints) == ["shoulder_joint"] and goal is not None
    np.testing.assert_allclose(goal, m["goal"], atol=1e-4)


def test_a_trajectory_without_points_is_listed(tmp_path: Path) -> None:
    with Bag(tmp_path / "run") as bag:
        for k in range(100):
            bag.state("/joint_states", 0.01 * k, ["elbow"], [0.01 * k])
        bag.trajectory("/arm_controller/joint_trajectory", 0.5, ["elbow"], [])
    (found,) = read_recordings(tmp_path / "run")
    assert "no numbers of joints" in found.left["arm_controller.joint_trajectory"]
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


def test_the_first_stamps_of_a_simulation_may_be_missing(tmp_path: Path) -> None:
    """With ``use_sim_time`` they are zero until the clock is heard: all went by the times of the bag, at half speed."""
    with Bag(tmp_path / "run", parts=NEW) as bag:
        for k in range(400):
            stamp = 1.0 + 0.005 * k
            bag.joints("/joint_states", 0.01 * k, {"elbow": 0.005 * k}, 0.0 if k < 3 else stamp)
            bag.joints("/joint_command", 0.01 * k, {"elbow": 0.005 * k}, stamp)
    (found,) = read_recordings(tmp_path / "run")
    assert "times are the stamps of the messages" in found.notes
    assert "3 messages of /joint_states without a stamp are left out" in found.notes
    np.testing.assert_allclose(found.columns["stamp"], 0.005 * np.arange(397), atol=1e-9)
    np.testing.assert_allclose(found.columns["joint_states.elbow.position"], 0.005 * np.arange(3, 400))


def test_where_most_stamps_are_missing_the_bag_says_the_times(tmp_path: Path) -> None:
    with Bag(tmp_path / "run", parts=NEW) as bag:
        for k in range(100):
            bag.joints("/joint_states", 0.01 * k, {"elbow": 0.01 * k}, 0.0 if k < 60 else 5.0 + 0.02 * k)
    (found,) = read_recordings(tmp_path / "run")
    assert any("have no stamp" in note for note in found.notes)
    np.testing.assert_allclose(found.columns["stamp"], 0.01 * np.arange(100), atol=1e-6)


def test_dynamic_joint_states_stand_in_for_joint_states(tmp_path: Path) -> None:
    m, source, out = moves(), tmp_path / "run", tmp_path / "log"
    with Bag(source, parts=NEW) as bag:
        for k, t in enumerate(m.time):
            values = {name: {"position": p, "effort": 2.0 * p} for name, p in named(m.position[k]).items()}
            bag.dynamic("/dynamic_joint_states", float(t), values)
            bag.joints("/joint_command", float(t), named(m.goal[k]))
    found = propose_for(source, out, robot="bench", actuator="ideal")
    assert not found.mapping.questions and "/dynamic_joint_states stands in" in found.text
    import_logs(source, out, found.mapping)
    run = read_measured(out).runs[0]
    assert set(run.joints) == set(NAMES)
    for k, name in enumerate(NAMES):
        torque = run.joints[name].torque
        assert torque is not None
        np.testing.assert_allclose(run.joints[name].position, m.position[:, k], atol=1e-9)
        np.testing.assert_allclose(torque, 2.0 * m.position[:, k], atol=1e-9)


def test_dynamic_joint_states_beside_joint_states_are_left_out_with_a_reason(tmp_path: Path) -> None:
    with Bag(tmp_path / "run", parts=NEW) as bag:
        for k in range(100):
            bag.joints("/joint_states", 0.01 * k, {"elbow": 0.01 * k})
            bag.dynamic("/dynamic_joint_states", 0.01 * k, {"elbow": {"position": 0.01 * k}})
    (found,) = read_recordings(tmp_path / "run")
    assert found.left["dynamic_joint_states"] == "/joint_states is taken: it has its joints"
    assert not any(name.startswith("dynamic") for name in found.columns)


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


def test_controllers_that_each_measured_some_joints_stand_in_together(tmp_path: Path) -> None:
    with Bag(tmp_path / "run", parts=NEW) as bag:
        for k in range(300):
            bag.controller("/arm/state", 0.01 * k, {"shoulder": 0.0, "elbow": 1.0}, [0.01 * k, 0.0])
            if k % 2 == 0:
                bag.controller("/gripper/state", 0.01 * k + 0.003, {"finger": 2.0}, [0.02 * k + 0.006])
    (found,) = read_recordings(tmp_path / "run")
    assert set(found.roles.values()) == {"time"} | {
        f"{joint}.{signal}" for joint in ("shoulder", "elbow", "finger") for signal in ("position", "goal")
    }
    shoulder, finger = (found.columns[f"controllers.feedback.{joint}.position"] for joint in ("shoulder", "finger"))
    np.testing.assert_allclose(finger, 2.0 * shoulder, atol=1e-6)  # stamps since 1970 go by 0.2 us
    assert len(found.columns["stamp"]) > 290
