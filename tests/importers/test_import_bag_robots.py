"""Robots of a bag whose joints have the same names, and lists that name no joints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.log import LogError
from sealegs.gap.log.importers import propose_for, read_recordings
from sealegs.gap.log.importers.lines import ASK
from sealegs.gap.log.importers.proposal import propose

from tests.importers.bags import Bag
from tests.importers.importing import motion

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
