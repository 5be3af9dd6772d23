"""Robots of one bag whose joints have the same names: each keeps its own commands."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.log import read_measured
from sealegs.gap.log.importers import import_logs, propose_for, read_recordings
from sealegs.gap.log.importers.proposal import propose

from tests.importers.test_import import motion
from tests.importers.test_import_nameless import ListBag
from tests.importers.test_ros_bags import Bag

NAMES = ("joint1", "joint2")
TIME = np.arange(600) * 0.01


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
@pytest.mark.parametrize("kind", ["states", "trajectory", "list"])
def test_each_of_two_arms_keeps_its_own_goals(tmp_path: Path, alike: bool, kind: str) -> None:
    """The right arm got the goals of the left one, and nobody was asked."""
    arms, source, out = _arms(alike), tmp_path / "run", tmp_path / "log"
    with ListBag(source) as bag:
        for k, t in enumerate(TIME):
            for late, (arm, joints) in enumerate(arms.items()):
                goals = [one["goal"][k] for one in joints]
                if kind == "states":
                    bag.state(f"/{arm}/joint_commands", float(t), NAMES, goals)
                elif kind == "list":
                    bag.numbers(f"/{arm}/position_controller/commands", float(t), goals)
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
            bag.state("/leader/joint_states", float(t), NAMES, [one["goal"][k] for one in _ARMS[0]])
            bag.state("/follower/joint_states", float(t) + 1e-3, NAMES, [one["smooth"][k] for one in _ARMS[0]])
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


def test_a_goal_that_fits_best_at_the_longest_delay_is_asked_about(tmp_path: Path) -> None:
    made = motion(20.0, 100.0, 0.05, seed=3)
    position = np.interp(made["time"] - 0.6, made["time"], made["goal"])
    rows = np.stack([made["time"], made["goal"], position], axis=1)
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="time_s,goal_rad,pos_rad", comments="", fmt="%.6f")
    found = propose(read_recordings(tmp_path / "run.csv"))
    assert any("the longest delay that is looked at" in question.ask for question in found.questions)
