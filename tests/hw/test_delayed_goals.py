"""A delay that a policy was trained with is kept in simulated and in stepped time too, not on servos alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.log import read_measured
from sealegs.hw.machine.limits import Limits
from sealegs.hw.machine.robot import ServoRobot, build_robot
from sealegs.hw.run import deployment
from sealegs.hw.run.commands import Trajectory
from sealegs.hw.run.simulated import Recording, simulate

from tests.servo_runs import config

RATE, SECONDS, DELAY = 50.0, 0.8, 0.012


class Late(Trajectory):
    """A step whose goals go out a fixed time after the reading that they follow from."""

    def __init__(self, delay: float) -> None:
        time = np.arange(0.0, SECONDS, 1.0 / RATE)
        super().__init__("late", time, np.where(time < 0.3, 0.0, 0.4)[:, None])
        self.delay = delay


def simulated(delay: float) -> Recording:
    settings = config()["robot"]
    return simulate(build_robot(settings), Late(delay), Limits.from_config(settings["safety"]), RATE, SECONDS)


def test_a_simulated_run_keeps_the_delay_of_its_commands() -> None:
    prompt, late = simulated(0.0), simulated(DELAY)
    assert late.sent - late.time == pytest.approx(np.full(len(late.time), DELAY), abs=2e-4), "time of the goals' bytes"
    period = pytest.approx(np.full(len(late.time) - 1, 1.0 / RATE), abs=3e-4)  # some readings ask for more
    assert np.diff(late.time) == period, "the rate is kept"
    behind = prompt.position - late.position
    assert behind.max() > 0.02 and behind.min() > -0.05, "the same motion, later"


@pytest.mark.long
def test_a_run_in_stepped_time_keeps_the_delay_as_a_simulated_one_does(tmp_path: Path) -> None:
    """It was simulated and run without it, and compared with servos that had it."""
    settings = config("hw.virtual.time=stepped", "silence=20", f"rate={RATE}", f"out={tmp_path}", "name=run")

    def source(_: ServoRobot) -> Late:
        return Late(DELAY)

    done = deployment.run(deployment.prepare(settings, source), lambda _: None)
    assert done is not None and done.outcome.ending == "finished"
    log = read_measured(done.log).runs[0]
    assert log.host["goal_sent"] - log.time == pytest.approx(np.full(len(log.time), DELAY), abs=2e-4)
    assert np.diff(log.time) == pytest.approx(np.full(len(log.time) - 1, 1.0 / RATE), abs=3e-4)
    moved, late = log.joints["joint"].position, simulated(DELAY).position[:, 0]
    prompt = simulated(0.0).position[:, 0]
    assert np.abs(moved - late).max() < 0.01 < 0.02 < np.abs(moved - prompt).max()
