"""Accelerations that smoothing flattened are put back from the replays of the joints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sealegs.actuators.chain import load_chain
from sealegs.gap.load.robot import Machine
from sealegs.gap.log.parts import Unit
from sealegs.gap.log.types import JointLog, MeasuredRun
from sealegs.gap.prepare.pieces import cut_joint
from sealegs.gap.replay.flattened import flattened
from sealegs.gap.replay.free import free_problem
from sealegs.gap.replay.joint_model import JointModel

from tests.logged_robots import two_link_run

TIME = np.arange(0.0, 12.0, 0.005)


def chain(stiffness: float) -> list[dict[str, dict[str, float]]]:
    return [
        {"position_p": {"gain": 12.0}},
        {"supply": {"volts": 7.4, "resistance": 0.0}},
        {"dc_motor": {"motor_constant": 0.664, "resistance": 2.723, "armature": 0.01}},
        {"friction": {"coulomb": 0.03, "viscous": 0.02}},
        {"spring": {"stiffness": stiffness, "damping": 0.03}},
    ]


@pytest.mark.parametrize("stiffness", [3.0, 20.0])
def test_what_lies_behind_a_spring_is_sharpened_as_the_link_moved(stiffness: float) -> None:
    """The motor's flattened steps were put back on the link's motion, which left its error as it was."""
    goal = np.repeat(np.random.default_rng(0).uniform(-0.8, 0.8, 20), 120)
    model, unit = JointModel(load_chain(chain(stiffness))), Unit(0, 0, 0, len(TIME), 1, (goal[0], 0.0))

    def run(motor: np.ndarray, link: np.ndarray) -> MeasuredRun:
        params = {"mass": 0.3, "length": 0.12, "arm_mass": 0.03}
        log = JointLog(goal, motor, link_position=link)
        return MeasuredRun("a", TIME, {"s": log}, robot_params=params, actuators={"s": chain(stiffness)})

    still = np.zeros_like(TIME)
    moved = free_problem([run(still, still)], "s", [model], [unit], {"position": 1e4}).simulate([{}])[0]
    logged = run(moved[:, 0], moved[:, 1])
    problem = free_problem([logged], "s", [model], [unit], {"position": 1e4})
    put_back = flattened([logged], {"s": problem}, {})[0]["s"]
    link = np.gradient(np.gradient(moved[:, 1], TIME), TIME)
    motor = np.gradient(np.gradient(moved[:, 0], TIME), TIME)
    inner = slice(20, -20)
    alike = [float(np.corrcoef(put_back[inner, 2], each[inner])[0, 1]) for each in (link, motor)]
    assert alike[0] > alike[1]


def test_a_log_that_was_edited_is_not_taken_for_the_one_before(tmp_path: Path) -> None:
    """How the robot moved was kept by the objects that hold a log, whose columns anybody may replace."""
    run = two_link_run(tmp_path, 3.0)
    before = cut_joint(Machine.of([run]), "shoulder", None).terms
    elbow = run.joints["elbow"]
    assert isinstance(run.joints, dict)
    run.joints["elbow"] = replace(elbow, position=elbow.position + 0.3)
    after = cut_joint(Machine.of([run]), "shoulder", None).terms
    assert before is not None and after is not None and np.abs(before[0] - after[0]).max() > 1e-3
