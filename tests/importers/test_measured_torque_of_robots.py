"""A joint of a robot of which only a measured torque was logged tells how it moved, and takes no other joint along."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.load.robot import robot_of
from sealegs.gap.log import LogError
from sealegs.gap.log.arrays import measured_set
from sealegs.gap.log.importers import propose_for
from sealegs.gap.prepare.columns import check_robot, commanded

from tests.importers.importing import ANGLE, LATE, TIME, table

ARM = """<mujoco><worldbody><body><joint name="shoulder" axis="0 1 0"/><geom size="0.1" pos="0 0 -0.2" mass="1"/>
<body pos="0 0 -0.4"><joint name="gripper" axis="0 1 0"/><geom size="0.1" mass="0.2"/></body></body>
</worldbody></mujoco>"""
GRIPPER = {"gripper.position": 0.5 * LATE, "gripper.torque": 0.1 * ANGLE}
SHOULDER = {"shoulder.goal": ANGLE, "shoulder.position": LATE}


def runs_of(folder: Path, columns: dict[str, np.ndarray]):
    (folder / "arm.xml").write_text(ARM)
    return measured_set([{"time": TIME, **columns}], {"robot": str(folder / "arm.xml")}, "log").runs


def test_only_the_joint_that_was_commanded_is_judged(tmp_path: Path) -> None:
    """The gripper's torque ended the diagnosis of the whole arm."""
    runs = runs_of(tmp_path, SHOULDER | GRIPPER)
    robot = robot_of(runs[0])
    assert robot is not None and commanded(runs) == ["shoulder"]
    (note,) = check_robot(runs, robot)
    assert note.code == "robot.uncommanded" and "gripper was logged (a measured torque is none)" in note.sentence


def test_a_robot_without_any_command_is_refused_with_what_to_log(tmp_path: Path) -> None:
    runs = runs_of(tmp_path, {"shoulder.position": LATE, "shoulder.torque": ANGLE} | GRIPPER)
    robot = robot_of(runs[0])
    assert robot is not None
    with pytest.raises(LogError, match=r"no joint can be judged; log what each joint was told as shoulder\.goal"):
        check_robot(runs, robot)


def test_an_import_asks_what_was_commanded_to_a_joint_with_a_torque_alone(tmp_path: Path) -> None:
    found = propose_for(table(tmp_path, {"time": TIME} | SHOULDER | GRIPPER), tmp_path / "out", "rad").mapping
    (question,) = found.questions
    assert question.about == ("gripper.goal",) and "gripper.goal or gripper.torque_command" in question.ask


def test_a_measured_torque_of_one_joint_is_enough_for_a_bench(tmp_path: Path) -> None:
    found = propose_for(table(tmp_path, {"time": TIME} | GRIPPER), tmp_path / "out", "rad").mapping
    assert not found.questions and "gripper.torque" in found.columns
