"""The reference of a task on virtual servos, without a policy: a gait is tried before anything is trained."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.commands import deploy
from sealegs.common.errors import SealegsError
from sealegs.configs.compose import compose
from sealegs.envs.any_robot.track import TrackTask
from sealegs.gap.log import read_measured
from sealegs.hw.machine.own_robot import READERS
from sealegs.hw.machine.robot import build_robot
from sealegs.hw.run.task_reference import TaskReference

STEPPED = ["hw.virtual.time=stepped", "live=false"]


def test_a_quadruped_walks_on_its_gait_under_the_guard_and_into_a_log(tmp_path: Path) -> None:
    words = ["reference={walk: {cadence: 2.0, lift: 0.02}}", "robot=quadruped", "command={forward: 0.2}"]
    deploy.main([*words, *STEPPED, "duration=1.0", f"out={tmp_path}", "name=gait"])
    run = read_measured(tmp_path / "gait.csv").runs[0]
    assert run.meta["command"] == {
        "reference": {"walk": {"cadence": 2.0, "lift": 0.02}},
        "command": [0.2, 0.0, 0.0],
    }
    goals = np.stack([joint.goal for joint in run.joints.values() if joint.goal is not None], axis=1)
    assert goals.shape == (50, 12) and np.ptp(goals, axis=0).max() > 0.2, "its legs swing"
    np.testing.assert_allclose(goals[:24], goals[25:49], atol=2e-2)  # twice in a second
    assert {"imu.w", "imu.turn_x", "switch.front_left", "switch.rear_right"} <= set(run.base)


def test_a_trajectory_of_track_leads_by_what_the_servos_are_late() -> None:
    robot = build_robot(compose("deploy", {"robot": "bench"}, readers=READERS)["robot"])
    reference = TaskReference("track", robot)
    assert isinstance(reference.task, TrackTask) and reference.task.lead is not None
    assert reference.task.lead > 0.02 and reference.rate == 50.0
    assert reference.pose["joint"] == pytest.approx(reference.start()[0])


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["reference=wlak"], r"no task 'wlak' .did you mean 'walk'"),
        (["reference=reach"], r"'reach' has no reference; walk and track have one"),
        (["reference=hexapod"], r"'hexapod' has a robot of its own"),
        (["reference=walk"], r"robot 'bench' has no free base, and cannot walk"),
        (["reference={track: {correctoin: 1}}"], r"'correctoin' .did you mean 'correction'"),
        (["reference=[walk]"], r"reference is \['walk'\]; it is a word such as walk"),
        (["reference=track", "command={knee: 1}"], r"names 'knee'; the task asks for joint"),
        (["reference=true", "robot=hopper", "command=[1]"], r"what a policy or a task's reference is asked for"),
    ],
)
def test_what_is_no_reference_is_refused_in_a_sentence(words: list[str], sentence: str) -> None:
    with pytest.raises(SealegsError, match=sentence):
        deploy.main([*words, *STEPPED])
