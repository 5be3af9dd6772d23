"""How a host recorded is told as what it is, and no sound log is accused of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from sealegs.gap.checks.data_set import check_set, corrected
from sealegs.gap.log.types import JointLog, MeasuredRun, MeasuredSet

from testbed import hidden_bench

CODES = ("column.held", "goal.interpolated", "goal.knots", "column.behind", "position.late", "clock.late_stamps")


@cache
def bench(latency: float = 0.0) -> MeasuredSet:
    return hidden_bench({"sensor.delay": latency} if latency else {}, 7, ("light", "heavy"), runs=2, duration=12.0)[0]


def changed(data: MeasuredSet, change: Callable[[MeasuredRun, JointLog], JointLog]) -> MeasuredSet:
    runs = tuple(replace(run, joints={"servo": change(run, run.joints["servo"])}) for run in data.runs)
    return replace(data, runs=runs)


def held(run: MeasuredRun, log: JointLog) -> JointLog:
    """Read in every second row only."""
    names = ("position", "velocity", "duty", "current")
    return replace(log, **{name: np.repeat(getattr(log, name)[::2], 2)[: len(run.time)] for name in names})


def behind(run: MeasuredRun, log: JointLog) -> JointLog:
    """Duty and current of the row before."""
    return replace(log, **{n: np.concatenate([getattr(log, n)[:1], getattr(log, n)[:-1]]) for n in ("duty", "current")})


def interpolated(run: MeasuredRun, log: JointLog) -> JointLog:
    """Goals of every fourth row, joined by lines, as tools that resample do."""
    assert log.goal is not None
    at = np.arange(len(log.goal))
    return replace(log, goal=np.interp(run.time, run.time[at[::4]], log.goal[::4]))


def codes(data: MeasuredSet) -> set[str]:
    return {finding.code for finding in corrected(data, check_set(data))[1]} & set(CODES)


def test_a_column_that_holds_each_value_for_two_rows_is_read_at_half_the_rate():
    data = changed(bench(), held)
    mended, findings = corrected(data, check_set(data))
    named = [finding for finding in findings if finding.code == "column.held"]
    assert {str(finding.column) for finding in named} >= {"servo.position", "servo.duty", "servo.current"}
    assert all(finding.value == 2.0 for finding in named)
    true, log = bench().runs[0].joints["servo"], mended.runs[0].joints["servo"]
    assert np.std(log.position - true.position) < 0.3 * np.std(data.runs[0].joints["servo"].position - true.position)
    assert log.duty is not None and np.isnan(log.duty).mean() == pytest.approx(0.5, abs=0.01)


def test_columns_that_are_a_row_behind_are_brought_back():
    data = changed(bench(), behind)
    mended, findings = corrected(data, check_set(data))
    assert {f.column for f in findings if f.code == "column.behind"} == {"servo.duty", "servo.current"}
    duty, true = mended.runs[0].joints["servo"].duty, bench().runs[0].joints["servo"].duty
    assert duty is not None and true is not None and np.array_equal(duty[:-1], true[:-1])


def test_a_position_that_is_late_of_the_duty_is_told_from_a_late_command():
    assert "position.late" in codes(bench(0.010))
    slow, _ = hidden_bench({"drive.delay": 0.010}, 7, ("light", "heavy"), runs=2, duration=12.0)
    assert not codes(slow)


def test_goals_that_a_tool_interpolated_are_held_again_where_the_duty_shows_it():
    # the machine got goals that were held for four rows
    wanted = [(run.joints["servo"].goal, len(run.time)) for run in bench().runs]
    goals = [np.repeat(goal[::4], 4)[:count] for goal, count in wanted if goal is not None]
    data, _ = hidden_bench({}, 7, ("light", "heavy"), runs=2, duration=12.0, schedules=tuple(_held(g) for g in goals))
    assert not codes(data)
    wrong = changed(data, interpolated)
    mended, findings = corrected(wrong, check_set(wrong))
    assert "goal.interpolated" in {finding.code for finding in findings}
    for run, right in zip(mended.runs, data.runs, strict=True):
        goal, true = run.joints["servo"].goal, right.joints["servo"].goal
        assert goal is not None and true is not None and (np.abs(goal - true) < 1e-9).mean() > 0.98
    alone = changed(wrong, lambda run, log: replace(log, duty=None, current=None))
    assert "goal.knots" in codes(alone)


def _held(goal: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    return lambda time: goal[: len(time)]


def test_stamps_that_jitter_while_the_readings_do_not_are_told():
    steady, _ = hidden_bench({}, 7, ("light", "heavy"), runs=2, duration=12.0)
    rng = np.random.default_rng(3)
    runs = []
    for run in steady.runs:
        late = rng.uniform(0.0, 0.003, len(run.time))
        runs.append(replace(run, time=np.maximum.accumulate(run.time + late) + 1e-7 * np.arange(len(late))))
    data = replace(steady, runs=tuple(runs))
    assert "clock.late_stamps" in codes(data)


@pytest.mark.parametrize("latency", [0.0])
def test_a_sound_log_is_not_accused(latency: float):
    assert not codes(bench(latency))
    assert not codes(changed(bench(latency), lambda run, log: replace(log, duty=None)))
    assert not codes(changed(bench(latency), lambda run, log: replace(log, duty=None, current=None)))
