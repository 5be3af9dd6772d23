"""Robots of one bag whose joints have the same names, and lists that name no joints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.log import read_measured
from sealegs.gap.log.importers import import_logs, propose_for, read_recordings
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
    assert "nothing tells whose" in found.unused["position_controller.commands.data[0]"]


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


NAMES = ("joint1", "joint2")


def _arms(alike: bool) -> dict[str, list[dict[str, np.ndarray]]]:
    """Motions of the joints of two arms, mirrored or each its own."""
    left = [motion(6.0, 100.0, 0.04, seed=seed) for seed in (3, 4)]
    if alike:
        return {"left": left, "right": [{key: 0.8 * values for key, values in one.items()} for one in left]}
    return {"left": left, "right": [motion(6.0, 100.0, 0.04, seed=seed) for seed in (5, 6)]}


def _goals(path: Path) -> dict[str, str]:
    found = propose(read_recordings(path))
    assert not found.questions
    return {name: read.text for name, read in found.columns.items() if name.endswith(".goal")}


@pytest.mark.long
@pytest.mark.parametrize("alike", [True, False])
@pytest.mark.parametrize("kind", ["states", "trajectory"])
def test_each_of_two_arms_keeps_its_own_goals(tmp_path: Path, alike: bool, kind: str) -> None:
    """The right arm got the goals of the left one, and nobody was asked."""
    arms, source, out = _arms(alike), tmp_path / "run", tmp_path / "log"
    with Bag(source) as bag:
        for k, t in enumerate(TIME):
            for late, (arm, joints) in enumerate(arms.items()):
                goals = [one["goal"][k] for one in joints]
                if kind == "states":
                    bag.state(f"/{arm}/joint_commands", float(t), NAMES, goals)
                else:
                    bag.trajectory(f"/{arm}/arm_controller/joint_trajectory", float(t), NAMES, [(0.0, goals, [])])
                seconds = float(t) + 1e-3 * (1 + late)
                bag.state(f"/{arm}/joint_states", seconds, NAMES, [one["smooth"][k] for one in joints])
    import_logs(source, out, propose_for(source, out, robot="bench", actuator="ideal").mapping)
    run = read_measured(out).runs[0]
    assert set(run.joints) == {f"{arm}_{joint}" for arm in arms for joint in NAMES}
    for arm, joints in arms.items():
        for name, one in zip(NAMES, joints, strict=True):
            goal = run.joints[f"{arm}_{name}"].goal
            assert goal is not None
            np.testing.assert_allclose(goal, one["goal"][: len(goal)], atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize(
    ("states", "commands", "names"),
    [
        (("/joint_states_left", "/joint_states_right"), ("/cmd_left", "/cmd_right"), ("left_", "right_")),
        (("/arm_1/joint_states", "/arm_2/joint_states"), ("/arm_1/goal", "/arm_2/goal"), ("arm_1_", "arm_2_")),
        (("/joint_states", "/right/joint_states"), ("/joint_cmd", "/right/joint_cmd"), ("", "right_")),
    ],
)
def test_what_tells_topics_apart_names_the_joints(
    tmp_path: Path, states: Sequence[str], commands: Sequence[str], names: Sequence[str]
) -> None:
    with Bag(tmp_path / "run") as bag:
        for k, t in enumerate(TIME):
            for state, command, joints in zip(states, commands, _ARMS, strict=True):
                bag.state(command, float(t), NAMES, [one["goal"][k] for one in joints])
                bag.state(state, float(t) + 1e-3, NAMES, [one["smooth"][k] for one in joints])
    found = _goals(tmp_path / "run")
    assert found == {
        f"{name}{joint}.goal": f"{command.strip('/').replace('/', '.')}.{joint}.position"
        for name, command in zip(names, commands, strict=True)
        for joint in NAMES
    }


_ARMS = list(_arms(False).values())


def test_a_command_that_names_no_arm_is_not_given_to_one(tmp_path: Path) -> None:
    with Bag(tmp_path / "run") as bag:
        for k, t in enumerate(TIME):
            bag.state("/joint_commands", float(t), NAMES, [one["goal"][k] for one in _ARMS[0]])
            for arm, joints in zip(("left", "right"), _ARMS, strict=True):
                bag.state(f"/{arm}/joint_states", float(t) + 1e-3, NAMES, [one["smooth"][k] for one in joints])
    found = propose(read_recordings(tmp_path / "run"))
    about = {name for question in found.questions for name in question.about}
    assert {"right_joint1.goal", "right_joint2.goal"} <= about
    assert not {"right_joint1.goal", "right_joint2.goal"} & found.columns.keys()


def test_an_arm_that_is_led_by_hand_is_the_goal_of_the_one_that_follows_it(tmp_path: Path) -> None:
    with Bag(tmp_path / "run") as bag:
        for k, t in enumerate(TIME):
            if k % 4 == 0:
                bag.state("/leader/joint_states", float(t), NAMES, [one["goal"][k] for one in _ARMS[0]])
            bag.state("/follower/joint_states", float(t) + 1e-3, NAMES, [one["smooth"][k] for one in _ARMS[0]])
    (recording,) = read_recordings(tmp_path / "run")
    held = np.repeat(_ARMS[0][0]["goal"][::4], 4)
    np.testing.assert_allclose(recording.columns["leader.joint_states.joint1.position"], held, atol=1e-9)
    assert _goals(tmp_path / "run") == {f"{name}.goal": f"leader.joint_states.{name}.position" for name in NAMES}


def test_joint_states_that_a_second_topic_repeats_are_of_one_robot(tmp_path: Path) -> None:
    with Bag(tmp_path / "run") as bag:
        for k, t in enumerate(TIME):
            positions = [one["smooth"][k] for one in _ARMS[0]]
            bag.state("/joint_commands", float(t), NAMES, [one["goal"][k] for one in _ARMS[0]])
            bag.state("/joint_states", float(t) + 1e-3, NAMES, positions)
            if k % 10 == 0:
                bag.state("/robot/joint_states", float(t) + 1e-3, NAMES, positions)
    assert _goals(tmp_path / "run").keys() == {f"{name}.goal" for name in NAMES}
