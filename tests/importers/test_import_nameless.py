"""Lists that name no joints, beside joint states of a bag: whose goal each of their places is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.log.importers import propose_for, read_recordings
from sealegs.gap.log.importers.proposal import propose
from sealegs.gap.log.importers.units import ASK

from tests.importers.test_import import motion
from tests.importers.test_ros_bags import START, Bag

LIST = "std_msgs/msg/Float64MultiArray"
JOINTS = ("joint1", "joint2", "joint3", "joint4")
TIME = np.arange(600) * 0.01
Signals = Sequence[np.ndarray]


class ListBag(Bag):
    """A bag with lists without names, which have no stamp."""

    def __enter__(self) -> ListBag:
        super().__enter__()
        return self

    def numbers(self, topic: str, seconds: float, values: Sequence[float]) -> None:
        types = self.store.types
        if topic not in self.topics:
            self.topics[topic] = self.writer.add_connection(topic, LIST, typestore=self.store)
        layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        message = types[LIST](layout=layout, data=np.array(values, float))
        self.writer.write(self.topics[topic], round(1e9 * (START + seconds)), self.store.serialize_cdr(message, LIST))


def _record(path: Path, topic: str, goals: Signals, positions: Signals, joints: Sequence[str] = JOINTS) -> Path:
    with ListBag(path) as bag:
        for k, t in enumerate(TIME):
            bag.numbers(topic, float(t), [goal[k] for goal in goals])
            bag.state("/joint_states", float(t) + 1e-4, joints[: len(positions)], [one[k] for one in positions])
    return path


def _moved(seed: int, amplitude: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    made = motion(6.0, 100.0, 0.05, seed=seed)
    return amplitude * made["goal"], amplitude * made["smooth"]


def _goals(path: Path, signal: str = "goal") -> dict[str, str]:
    found = propose(read_recordings(path))
    return {
        name: read.text for name, read in found.columns.items() if name.endswith(f".{signal}") and read.trust != ASK
    }


def _in_order(topic: str, count: int = 4) -> dict[str, str]:
    return {f"{joint}.goal": f"{topic}.data[{k}]" for k, joint in enumerate(JOINTS[:count])}


@pytest.mark.long
@pytest.mark.parametrize("topic", ["position_controller.commands", "forward_position_controller.commands"])
def test_places_of_a_list_go_in_order_to_joints_that_move_together(tmp_path: Path, topic: str) -> None:
    """``data[1]`` was taken for ``joint1``, for their numbers are the same; all joints were driven alike."""
    moved = [_moved(3, amplitude) for amplitude in (0.3, 0.35, 0.4, 0.3)]
    path = _record(tmp_path / "run", f"/{topic.replace('.', '/')}", *zip(*moved, strict=True))
    assert _goals(path) == _in_order(topic)
    assert not propose(read_recordings(path)).questions


def test_a_joint_at_rest_keeps_its_own_place(tmp_path: Path) -> None:
    noise = 1e-4 * np.random.default_rng(0).normal(size=len(TIME))
    rest = [(np.full_like(TIME, at), at + noise) for at in (0.2, -0.4)]
    moved = [rest[0], _moved(3), rest[1]]
    path = _record(tmp_path / "run", "/position_controller/commands", *zip(*moved, strict=True))
    assert _goals(path) == _in_order("position_controller.commands", 3)


def test_a_controller_with_another_order_is_told_by_motion(tmp_path: Path) -> None:
    (first, one), (second, other) = _moved(3), _moved(4)
    path = _record(tmp_path / "run", "/position_controller/commands", [second, first], [one, other])
    topic = "position_controller.commands"
    assert _goals(path) == {"joint1.goal": f"{topic}.data[1]", "joint2.goal": f"{topic}.data[0]"}


def test_an_order_that_motion_speaks_against_is_asked_about(tmp_path: Path) -> None:
    """All joints do the same, but not as far: the list has them the other way round."""
    goals, positions = zip(*[_moved(3, amplitude) for amplitude in (0.3, 0.35, 0.4, 0.45)], strict=True)
    path = _record(tmp_path / "run", "/position_controller/commands", goals[::-1], positions)
    found = propose(read_recordings(path))
    assert [question.about for question in found.questions] == [tuple(f"{joint}.goal" for joint in JOINTS)]
    assert "names no joints" in found.questions[0].ask


def test_torques_of_a_list_that_no_motion_explains_are_asked_about(tmp_path: Path) -> None:
    goals = [np.sin(rate * TIME**1.5) for rate in (2.1, 3.3, 4.7)]
    positions = [_moved(seed)[1] for seed in (3, 4, 5)]
    path = _record(tmp_path / "run", "/effort_controller/commands", goals, positions)
    assert not _goals(path, "torque_command")
    about = propose(read_recordings(path)).questions[0].about
    assert about == tuple(f"{joint}.torque_command" for joint in JOINTS[:3])


def test_torques_that_explain_the_motion_in_order_stay_unasked(tmp_path: Path) -> None:
    positions = [_moved(seed)[1] for seed in (3, 4, 5)]
    torques = []
    for one in positions:
        speed = np.gradient(one, TIME)
        torques.append(0.1 * np.gradient(speed, TIME) + 0.5 * speed + 0.2 * np.sin(one))
    path = _record(tmp_path / "run", "/effort_controller/commands", torques, positions)
    found = _goals(path, "torque_command")
    assert list(found.values()) == [f"effort_controller.commands.data[{k}]" for k in range(3)]


def test_a_list_of_an_arm_goes_to_its_joints_and_not_to_the_gripper(tmp_path: Path) -> None:
    moved = [_moved(seed) for seed in (3, 4, 5)]
    goals, positions = zip(*moved, strict=True)
    path = _record(tmp_path / "run", "/position_controller/commands", goals[1:], positions, ("finger", *JOINTS))
    assert _goals(path) == _in_order("position_controller.commands", 2)


def test_a_list_of_one_place_goes_to_the_joint_of_its_controller(tmp_path: Path) -> None:
    """``data[0]`` of ``joint1_controller`` was read as ``joint10``."""
    first, second = _moved(3), _moved(4)
    with ListBag(tmp_path / "run") as bag:
        for k, t in enumerate(TIME):
            bag.numbers("/joint1_position_controller/commands", float(t), [first[0][k]])
            bag.numbers("/joint2_position_controller/commands", float(t), [second[0][k]])
            bag.state("/joint_states", float(t) + 1e-4, JOINTS[:2], [first[1][k], second[1][k]])
    assert _goals(tmp_path / "run") == {
        f"joint{k}.goal": f"joint{k}_position_controller.commands.data[0]" for k in (1, 2)
    }


def test_measured_lists_without_names_are_left_out_with_a_reason(tmp_path: Path) -> None:
    (goal, position), (other, second) = _moved(3), _moved(4)
    with ListBag(tmp_path / "run") as bag:
        for k, t in enumerate(TIME):
            bag.numbers("/position_controller/commands", float(t), [goal[k], other[k]])
            bag.numbers("/motor_state/temperature", float(t), [30.0 + 0.01 * k, 31.0 + 0.01 * k])
            bag.state("/joint_states", float(t) + 1e-4, JOINTS[:2], [position[k], second[k]])
    found = propose_for(tmp_path / "run", tmp_path / "log")
    assert "temperature of a list that names no joints" in found.text
    assert "joint1.temperature:" not in found.text.partition("unused")[0]
