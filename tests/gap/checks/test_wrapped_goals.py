"""Joints without end: goals that wrap around are put back with the angle that follows them."""

from __future__ import annotations

import numpy as np
import pytest
from sealegs.gap.checks.data_set import check_run, check_set, corrected
from sealegs.gap.log.types import MeasuredRun, MeasuredSet

from testbed import hidden_bench
from tests.changed_logs import signal, with_log


def clean() -> MeasuredRun:
    return hidden_bench({}, 3)[0].runs[0]


@pytest.mark.long
@pytest.mark.parametrize("both", [True, False], ids=["goal and encoder wrap", "goal alone wraps"])
def test_goals_that_wrap_are_put_back_with_the_angle_that_follows(both: bool) -> None:
    """The encoder alone was unwrapped, and then moved against its goal."""
    run = clean()
    goal = np.pi + np.sin(1.3 * run.time)
    position = np.pi + np.sin(1.3 * (run.time - 0.05)) + 1e-4 * np.random.default_rng(1).normal(size=len(run.time))
    wrapped = [(angle + np.pi) % (2 * np.pi) - np.pi for angle in (goal, position)]
    log = with_log(run, goal=wrapped[0], position=wrapped[1] if both else position)
    data, findings = corrected(MeasuredSet((log,), "log"), check_set(MeasuredSet((log,), "log")))
    assert {"goal.wrap"} <= {finding.code for finding in findings}
    assert "position.sign" not in {finding.code for finding in findings}
    off = signal(data.runs[0], "goal") - signal(data.runs[0], "position")
    assert np.abs(off).max() < 0.1
    np.testing.assert_allclose(np.ptp(signal(data.runs[0], "goal")), np.ptp(goal), atol=1e-9)


def test_a_goal_that_is_a_whole_turn_further_is_a_step() -> None:
    run = clean()
    goal = np.where(run.time % 4.0 < 2.0, -3.1, 3.1)
    position = goal[0] + np.convolve(goal - goal[0], np.ones(60) / 60.0)[: len(goal)]
    assert "goal.wrap" not in {finding.code for finding in check_run(with_log(run, goal=goal, position=position))}
