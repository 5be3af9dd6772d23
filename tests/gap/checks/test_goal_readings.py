"""Goals that are readings are found, those of servos that follow well are not, and wrapped ones are put back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from sealegs.gap.checks.data_set import check_run, check_set, corrected, unusable
from sealegs.gap.log.types import MeasuredRun, MeasuredSet

from testbed import hidden_bench
from tests.changed_logs import JOINT, signal, with_log
from tests.quick import quick

CODE = "goal.is_position"
STEP = 2.0 * np.pi / 4096


def runs(seed: int = 0) -> tuple[MeasuredRun, ...]:
    return hidden_bench({}, seed)[0].runs


def codes(run: MeasuredRun) -> list[str]:
    return [finding.code for finding in check_run(run)]


def next_reading(position: np.ndarray) -> np.ndarray:
    return np.append(position[1:], position[-1])


def in_tenths_of_degrees(position: np.ndarray) -> np.ndarray:
    return np.radians(np.round(np.degrees(position), 1))


@pytest.mark.long
@pytest.mark.parametrize("copied", [np.copy, next_reading, in_tenths_of_degrees])
def test_a_reading_that_was_logged_as_the_goal_makes_a_log_unusable(copied: Callable[[np.ndarray], np.ndarray]) -> None:
    """It went unnoticed, and a diagnosis fitted a servo without any lag."""
    for run in runs():
        wrong = with_log(run, goal=copied(signal(run, "position")))
        (finding,) = [finding for finding in check_run(wrong) if finding.code == CODE]
        assert finding.column == f"{JOINT}.goal" and "log the goal as it was sent" in finding.sentence
        assert ("of the next row" in finding.sentence) == (copied is next_reading)
        assert unusable([finding], MeasuredSet((wrong,), "x")) == finding


@pytest.mark.parametrize("every", [1, 4, 10])
@pytest.mark.parametrize("seed", quick(range(3), 3))
def test_goals_of_a_bench_are_none_of_its_readings_at_any_rate(seed: int, every: int) -> None:
    for run in runs(seed):
        log = run.joints[JOINT]
        fewer = {name: values[::every] for name, values in log.signals().items()}
        assert CODE not in codes(replace(run, time=run.time[::every], joints={JOINT: replace(log, **fewer)}))


@pytest.mark.long
@pytest.mark.parametrize("lag", [0.004, 0.008])
@pytest.mark.parametrize("rate", [50.0, 200.0])
def test_a_servo_that_lags_by_a_few_milliseconds_alone_is_none(lag: float, rate: float) -> None:
    """A stiffer servo than any that is sold: the lag of a loop of the bus, no error beside it."""
    run = runs()[0]
    time = np.arange(0.0, 20.0, 1.0 / rate)

    def goal(at: np.ndarray) -> np.ndarray:
        return 0.6 * np.sin(2.0 * at) + 0.2 * np.sin(5.1 * at)

    position = STEP * np.round(goal(time - lag) / STEP)
    log = replace(run.joints[JOINT], goal=goal(time), position=position, velocity=None, duty=None, current=None)
    bare = replace(log, voltage=None, temperature=None, torque=None, link_position=None, enabled=None)
    assert CODE not in codes(replace(run, time=time, joints={JOINT: bare}, host={}, base={}))


def test_a_joint_at_rest_or_without_torque_is_none() -> None:
    run = runs()[0]
    rest = np.zeros(len(run.time))
    assert CODE not in codes(with_log(run, goal=rest, position=rest))
    position = signal(run, "position")
    assert CODE not in codes(with_log(run, goal=position, enabled=rest, duty=None, current=None))


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
