"""Logs of hidden arms, and the robot that a log names."""

from __future__ import annotations

from pathlib import Path

from sealegs.gap.load.robot import LoggedRobot, robot_of
from sealegs.gap.log.types import MeasuredRun

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
