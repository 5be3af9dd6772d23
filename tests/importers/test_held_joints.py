"""A joint that is held, stalled or sags says nothing of its unit or its direction, and is left as it was recorded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.checks.data_set import check_set, corrected
from sealegs.gap.log.importers import propose_for
from sealegs.gap.log.types import JointLog, MeasuredRun, MeasuredSet
from sealegs.gap.prepare.checking import check_log
from sealegs.gap.prepare.columns import commanded

from tests.importers.importing import motion

MOVED = motion(20.0, 100.0, 0.05, seed=3)
TIME = MOVED["time"]
RNG = np.random.default_rng(0)


def run(name: str, **joints: tuple[np.ndarray, np.ndarray]) -> MeasuredRun:
    logs = {joint: JointLog(goal=goal, position=position) for joint, (goal, position) in joints.items()}
    return MeasuredRun(name, TIME, logs, robot="unknown", actuators=dict.fromkeys(joints, "ideal"))


def shaken(at: float, goal: float, position: float, rate: float = 0.9) -> tuple[np.ndarray, np.ndarray]:
    """Goal and position of a joint that is held, each shaking by so much [rad]."""
    noise = RNG.normal(0.0, 1e-4, len(TIME))
    held = at + goal * np.sin(2.0 * np.pi * 0.3 * TIME)
    return held, at - 0.01 + position * np.sin(2.0 * np.pi * rate * TIME) + noise


def after_checks(*runs: MeasuredRun) -> MeasuredSet:
    data = MeasuredSet(tuple(runs), "log")
    return corrected(data, check_set(data))[0]


@pytest.mark.parametrize("at", [0.9, 0.0])
def test_a_held_joint_that_shakes_more_than_its_goal_is_not_in_degrees(at: float) -> None:
    """0.9 rad became 0.0157 rad, and so did a run in which the joint really moved."""
    held = run("hold", wrist=shaken(at, 5e-5, 2.5e-3), elbow=(MOVED["goal"], MOVED["smooth"]))
    moves = run("move", wrist=(MOVED["goal"], MOVED["smooth"]), elbow=(MOVED["goal"], MOVED["smooth"]))
    found = after_checks(held, moves)
    for before, now in zip((held, moves), found.runs, strict=True):
        np.testing.assert_array_equal(now.joints["wrist"].position, before.joints["wrist"].position)


def test_a_moving_joint_in_degrees_is_still_found() -> None:
    degrees = run("move", wrist=(MOVED["goal"], np.degrees(MOVED["smooth"])))
    np.testing.assert_allclose(after_checks(degrees).runs[0].joints["wrist"].position, MOVED["smooth"])


def test_a_held_joint_that_sags_against_its_goal_is_not_mirrored() -> None:
    """The mean of the position became -0.88 at a goal of 0.9."""
    goal = 0.9 + 0.002 * np.sin(2.0 * np.pi * 0.3 * TIME)
    position = 0.88 - 0.004 * np.sin(2.0 * np.pi * 0.3 * TIME) + RNG.normal(0.0, 1e-4, len(TIME))
    data = MeasuredSet((run("hold", wrist=(goal, position)),), "log")
    found, findings = corrected(data, check_set(data))
    np.testing.assert_array_equal(found.runs[0].joints["wrist"].position, position)
    assert any(f.code == "position.against" and "held" in f.sentence for f in findings)


def test_a_mirrored_joint_is_still_found() -> None:
    mirrored = run("move", wrist=(MOVED["goal"], -MOVED["smooth"]))
    np.testing.assert_allclose(after_checks(mirrored).runs[0].joints["wrist"].position, MOVED["smooth"])


@pytest.mark.parametrize(("goal", "position"), [(0.6, 0.04), (0.0005, 0.006)])
def test_a_stalled_or_sagging_joint_has_no_other_unit_than_its_goal(
    goal: float, position: float, tmp_path: Path
) -> None:
    """0.5 +- 0.04 rad beside a goal of 0.5 +- 0.6 was imported with a goal in degrees, and the gap was gone."""
    swing = np.sin(2.0 * np.pi * 0.3 * TIME)
    columns = {
        "t": TIME, "elbow_goal": MOVED["goal"], "elbow_pos_rad": MOVED["smooth"],
        "wrist_goal": 0.5 + goal * swing, "wrist_pos_rad": 0.5 + position * swing + RNG.normal(0.0, 1e-4, len(TIME)),
    }  # fmt: skip
    source = tmp_path / "log.csv"
    table = np.stack(list(columns.values()), axis=1)
    np.savetxt(source, table, delimiter=",", header=",".join(columns), comments="", fmt="%.7g")
    found = propose_for(source, tmp_path / "out", robot="bench", actuator="ideal")
    assert found.mapping.columns["wrist.goal"] == "wrist_goal", found.text
    assert "is this the goal of the position beside it?" in found.text


def test_runs_that_agree_on_degrees_are_still_all_found() -> None:
    one = run("a", wrist=(MOVED["goal"], np.degrees(MOVED["smooth"])))
    found = after_checks(one, replace(one, name="b"))
    for each in found.runs:
        np.testing.assert_allclose(each.joints["wrist"].position, MOVED["smooth"])


def test_a_joint_whose_goal_echoes_its_state_does_not_refuse_the_others() -> None:
    """A mocked gripper made each joint of the arm unusable, also those that were asked for alone."""
    noise = RNG.normal(0.0, 1e-4, len(TIME))
    arm = run("a", gripper=(MOVED["smooth"], MOVED["smooth"]), elbow=(MOVED["goal"], MOVED["smooth"] + noise))
    data, findings, stop = check_log(MeasuredSet((arm,), "log"), lambda text: None)
    assert stop is None
    assert commanded(data.runs) == ["elbow"] and "gripper" in data.runs[0].joints
    (said,) = [f for f in findings if f.code == "goal.is_position"]
    assert said.severity == "warning" and "not judged" in said.sentence
    _, _, alone = check_log(
        MeasuredSet((run("a", gripper=(MOVED["smooth"], MOVED["smooth"])),), "log"), lambda text: None
    )
    assert alone is not None
