"""Logs of hidden arms, and the robot that a log names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from sealegs.actuators.chain import load_chain
from sealegs.gap.load.robot import LoggedRobot, robot_of
from sealegs.gap.load.terms import T_OWN, T_SIZE
from sealegs.gap.log.parts import cut
from sealegs.gap.log.types import MeasuredRun
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.tree import joint_of_tree, terms_of

from testbed.bench import NOISE_FLOOR
from testbed.logs import hidden_arm

JOINTS = ("shoulder", "elbow")


def two_link_run(folder: Path, duration: float) -> MeasuredRun:
    """A run [s] of the two-link arm that is as believed."""
    data, _ = hidden_arm(folder, "two_link", {}, 5, runs=1, duration=duration, nominal_error=0.0)
    return data.runs[0]


def robot(run: MeasuredRun) -> LoggedRobot:
    """The robot of a run that names one."""
    found = robot_of(run)
    assert found is not None
    return found


def free_replay(run: MeasuredRun, joint: str) -> FreeProblem:
    """A joint of a run that is replayed alone, as its file and its chain believe it to be."""
    machine = robot(run)
    terms = terms_of(machine, joint, [run])
    model = joint_of_tree(machine, joint, load_chain(run.actuators[joint]), [run], terms)
    return free_problem([run], joint, [model], cut([run], joint), {"position": 1.0 / NOISE_FLOOR}, terms)


def block_of(terms: np.ndarray, number: int) -> np.ndarray:
    """One of the blocks of a joint's terms (samples, columns)."""
    return terms[:, T_OWN + number * T_SIZE :][:, :T_SIZE]


def nominal_error(problem: FreeProblem) -> float:
    """Root of the mean square of its position error [rad]."""
    return float(np.sqrt(np.mean(problem.position_error(problem.simulate([{}], 1e-3)[0]) ** 2)))
