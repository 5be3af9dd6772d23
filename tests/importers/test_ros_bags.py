"""ROS bags as robots record them: unknown types, drivers that share a topic, trajectories of controllers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.gap.log import LogError, read_measured
from sealegs.gap.log.importers import import_logs, propose_for, read_recordings
from sealegs.gap.log.importers.proposal import propose

from tests.importers.test_import import motion

START = 1.7e9
STATES, TRAJECTORY = "sensor_msgs/msg/JointState", "trajectory_msgs/msg/JointTrajectory"
DYNAMIC = "control_msgs/msg/DynamicJointState"
Points = Sequence[tuple[float, Sequence[float], Sequence[float]]]


class Bag:
    """A bag with sqlite3 storage that carries no definitions, as ROS 2 Humble writes it."""

    def __init__(self, path: Path) -> None:
        pytest.importorskip("rosbags")
        from rosbags.rosbag2 import Writer
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.store = get_typestore(Stores.ROS2_HUMBLE)
        # of the robot that records; who reads the bag has no definition of it
        self.store.register(get_types_from_msg("std_msgs/Header header\nstring[] joint_names\n", DYNAMIC))
        self.path, self.topics = path, dict[str, Any]()
        self.writer = Writer(path, version=8)

    def __enter__(self) -> Bag:
        self.writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        import sqlite3

        self.writer.close()
        with sqlite3.connect(next(self.path.glob("*.db3"))) as data:
            data.execute("DELETE FROM message_definitions")

    def put(self, topic: str, kind: str, seconds: float, **fields: Any) -> None:
        types = self.store.types
        if topic not in self.topics:
            self.topics[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        now = round(1e9 * seconds) + round(1e9 * START)
        stamp = types["builtin_interfaces/msg/Time"](sec=now // 10**9, nanosec=now % 10**9)
        message = types[kind](header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=""), **fields)
        self.writer.write(self.topics[topic], now, self.store.serialize_cdr(message, kind))

    def state(self, topic: str, seconds: float, names: Sequence[str], position: Sequence[float]) -> None:
        none = np.array([])
        self.put(
            topic, STATES, seconds, name=list(names), position=np.array(position, float), velocity=none, effort=none
        )

    def trajectory(self, topic: str, seconds: float, names: Sequence[str], points: Points) -> None:
        """Points as ``(after [s], positions, velocities)``."""
        types, none = self.store.types, np.array([])
        made = [
            types["trajectory_msgs/msg/JointTrajectoryPoint"](
                positions=np.array(positions, float),
                velocities=np.array(velocities, float),
                accelerations=none,
                effort=none,
                time_from_start=types["builtin_interfaces/msg/Duration"](
                    sec=int(after), nanosec=round(1e9 * (after - int(after)))
                ),
            )
            for after, positions, velocities in points
        ]
        self.put(topic, TRAJECTORY, seconds, joint_names=list(names), points=made)


def test_a_topic_of_an_unknown_type_is_named_and_the_rest_is_read(tmp_path: Path) -> None:
    """``ros2 bag record -a`` holds ``/dynamic_joint_states``; the whole bag was refused for it."""
    m, source, out = motion(6.0, 100.0, 0.05, seed=3), tmp_path / "run", tmp_path / "log"
    with Bag(source) as bag:
        for k, t in enumerate(m["time"]):
            bag.state("/joint_states", float(t), ["elbow"], [m["smooth"][k]])
            bag.state("/arm/joint_command", float(t), ["elbow"], [m["goal"][k]])
            bag.put("/dynamic_joint_states", DYNAMIC, float(t), joint_names=["elbow"])
    found = propose_for(source, out, robot="bench", actuator="ideal")
    assert "dynamic_joint_states: the bag does not say how control_msgs/msg/DynamicJointState" in found.text
    assert "MCAP" in found.text
    import_logs(source, out, found.mapping)
    np.testing.assert_allclose(read_measured(out).runs[0].joints["elbow"].position, m["smooth"], atol=1e-9)


def test_a_bag_of_unknown_types_alone_says_which_and_what_to_do(tmp_path: Path) -> None:
    with Bag(tmp_path / "run") as bag:
        bag.put("/dynamic_joint_states", DYNAMIC, 0.0, joint_names=["elbow"])
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


def test_points_of_a_trajectory_are_laid_out_after_its_message(tmp_path: Path) -> None:
    """A topic without a word of a command was not read, and of a message its first point alone."""
    goal = led(tmp_path / "run", [(1.0, [(1.0, [1.0], []), (2.0, [0.0], [])])], rest=0.5)
    time = 0.01 * np.arange(601)
    assert np.isnan(goal[:100]).all()
    np.testing.assert_allclose(goal[100:], np.interp(time, [1.0, 2.0, 3.0], [0.5, 1.0, 0.0])[100:], atol=1e-6)


def test_a_later_trajectory_replaces_the_rest_of_an_earlier_one(tmp_path: Path) -> None:
    first: Points = [(0.0, [0.0], []), (2.0, [2.0], [])]
    goal = led(tmp_path / "run", [(1.0, first), (2.0, [(1.0, [0.0], [])])])
    wanted = np.interp(0.01 * np.arange(601), [1.0, 2.0, 3.0], [0.0, 1.0, 0.0])
    np.testing.assert_allclose(goal[100:], wanted[100:], atol=1e-6)


def test_a_stream_of_points_that_are_never_due_moves_the_goal(tmp_path: Path) -> None:
    """Teleoperation replaces each message before its point: a controller is on the way to it all the same."""
    goal = led(tmp_path / "run", [(0.02 * k, [(0.1, [0.02 * k + 0.1], [])]) for k in range(250)])
    assert goal[240] == pytest.approx(2.4, abs=0.15)


def test_points_with_velocities_are_joined_by_cubics(tmp_path: Path) -> None:
    after = np.linspace(0.0, 4.0, 9)
    points = [(float(t), [float(np.sin(t))], [float(np.cos(t))]) for t in after]
    goal = led(tmp_path / "run", [(1.0, points)])
    np.testing.assert_allclose(goal[100:501], np.sin(0.01 * np.arange(401)), atol=5e-4)
    np.testing.assert_allclose(goal[501:], np.sin(4.0), atol=1e-6)


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
