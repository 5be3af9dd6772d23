"""How a host recorded is told as what it is: late readings, rows that are one behind; no sound log is accused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.checks.data_set import check_run, check_set, corrected, unusable
from sealegs.gap.checks.recording import DRIVE_LOOP_PERIOD
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.parts import cut
from sealegs.gap.log.types import JointLog, MeasuredRun, MeasuredSet
from sealegs.gap.measure.named import CERTAIN
from sealegs.gap.replay.driven import driven_problem
from sealegs.gap.replay.joint_model import JointModel

from testbed import NOISE_FLOOR, hidden_bench
from tests.logged_robots import JOINT, signal, with_log
from tests.quick import quick

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


def test_a_sound_log_is_not_accused():
    assert not codes(bench())
    assert not codes(changed(bench(), lambda run, log: replace(log, duty=None)))
    assert not codes(changed(bench(), lambda run, log: replace(log, duty=None, current=None)))


TIMING = ("sensor.delay", "drive.delay", "drive.rate_limit", "drive.gain", "drive.deadband")


def driven(data: MeasuredSet, *, delay: bool = True) -> MeasuredSet:
    """The log of a machine that no model stands for, so that its link is moved as measured."""
    runs = []
    for run in data.runs:
        chain = [stage for stage in run.actuators["servo"] if delay or "delay" not in stage]
        runs.append(replace(run, robot="crane", robot_params={}, actuators={"servo": chain}))
    return replace(data, runs=tuple(runs))


def at_once() -> MeasuredSet:
    """A drive without delay, read a moment before the goal of the same row acts."""
    data, _ = hidden_bench({}, 5, ("light", "medium"), runs=2, duration=9.0, constants={"command_delay": 0.0})
    return driven(data, delay=False)


def test_what_is_read_before_the_goal_of_its_row_acts_is_told() -> None:
    data = at_once()
    _, findings = corrected(data, check_set(data))
    assert "columns.before_goal" in {finding.code for finding in findings}
    plain, _ = hidden_bench({}, 5, ("light", "medium"), runs=2, duration=9.0)
    _, findings = corrected(plain, check_set(plain))
    assert "columns.before_goal" not in {finding.code for finding in findings}


def errors(data: MeasuredSet, *models: dict[str, float]) -> tuple[list[float], float]:
    """Rms errors of models along a driven log, and the noise."""
    chains = [JointModel(load_chain(run.actuators["servo"])) for run in data.runs]
    problem = driven_problem(data.runs, "servo", chains, cut(data.runs, "servo"), NOISE_FLOOR)
    found = [problem.position_error(channels) for channels in problem.simulate(models)]
    return [float(np.sqrt(np.mean(error**2))) for error in found], problem.noise


def test_the_moment_of_reading_is_all_that_a_command_behind_lacks() -> None:
    (believed, read_before, slow), _ = errors(
        at_once(), {}, {"delay.seconds": DRIVE_LOOP_PERIOD}, {"delay.seconds": DRIVE_LOOP_PERIOD + 0.005}
    )
    assert read_before < 0.3 * believed and read_before < 0.5 * slow


def test_along_a_measured_motion_only_a_late_reading_brings_the_current_to_its_noise() -> None:
    data, _ = hidden_bench({"sensor.delay": 0.010}, 3, ("light", "medium"), runs=2, duration=9.0)
    (late, *others), noise = errors(
        driven(data), {"encoder.latency": 0.010}, {}, {"rate_limit.speed": 5.0}, {"delay.seconds": 0.015}
    )
    assert late < 1.2 * noise and min(others) > 2.0 * noise


@pytest.mark.long
def test_a_command_behind_is_neither_delay_nor_rate_limit_on_a_driven_joint() -> None:
    """It came out as a delay or a rate limit, with confidence 1.00, on a machine with nothing hidden."""
    (found,) = diagnose(at_once(), causes=TIMING)
    assert not found.causes, found.text


@pytest.mark.long
def test_a_reading_two_samples_late_is_named_on_a_driven_joint() -> None:
    """It came out as a rate limit with confidence 1.00."""
    data, _ = hidden_bench({"sensor.delay": 0.010}, 3, ("light", "medium"), runs=2, duration=9.0)
    (found,) = diagnose(driven(data), causes=TIMING)
    assert [cause.name for cause in found.causes] == ["sensor.delay"], found.text
    late = found.causes[0].parameters["encoder.latency"]
    assert late.value == pytest.approx(0.010, abs=0.001)


@pytest.mark.long
def test_a_late_reading_is_told_from_a_late_command_on_a_bench() -> None:
    data, _ = hidden_bench({"sensor.delay": 0.008}, 4, ("light", "medium"), runs=2, duration=9.0)
    (found,) = diagnose(data, causes=TIMING)
    assert "sensor.delay" in [cause.name for cause in found.causes], found.text
    assert all(cause.standing != CERTAIN for cause in found.causes if cause.name == "drive.delay"), found.text


# --- goals that are readings: not those of servos that follow well; and wrapped ones, which are put back -------------


CODE = "goal.is_position"
STEP = 2.0 * np.pi / 4096


def bench_runs(seed: int = 0) -> tuple[MeasuredRun, ...]:
    return hidden_bench({}, seed)[0].runs


def codes_of(run: MeasuredRun) -> list[str]:
    return [finding.code for finding in check_run(run)]


def next_reading(position: np.ndarray) -> np.ndarray:
    return np.append(position[1:], position[-1])


def in_tenths_of_degrees(position: np.ndarray) -> np.ndarray:
    return np.radians(np.round(np.degrees(position), 1))


@pytest.mark.long
@pytest.mark.parametrize("copied", [np.copy, next_reading, in_tenths_of_degrees])
def test_a_reading_that_was_logged_as_the_goal_makes_a_log_unusable(copied: Callable[[np.ndarray], np.ndarray]) -> None:
    """It went unnoticed, and a diagnosis fitted a servo without any lag."""
    for run in bench_runs():
        wrong = with_log(run, goal=copied(signal(run, "position")))
        (finding,) = [finding for finding in check_run(wrong) if finding.code == CODE]
        assert finding.column == f"{JOINT}.goal" and "log the goal as it was sent" in finding.sentence
        assert ("of the next row" in finding.sentence) == (copied is next_reading)
        assert unusable([finding], MeasuredSet((wrong,), "x")) == finding


@pytest.mark.parametrize("every", [1, 4, 10])
@pytest.mark.parametrize("seed", quick(range(3), 3))
def test_goals_of_a_bench_are_none_of_its_readings_at_any_rate(seed: int, every: int) -> None:
    for run in bench_runs(seed):
        log = run.joints[JOINT]
        fewer = {name: values[::every] for name, values in log.signals().items()}
        assert CODE not in codes_of(replace(run, time=run.time[::every], joints={JOINT: replace(log, **fewer)}))


@pytest.mark.long
@pytest.mark.parametrize("lag", [0.004, 0.008])
@pytest.mark.parametrize("rate", [50.0, 200.0])
def test_a_servo_that_lags_by_a_few_milliseconds_alone_is_none(lag: float, rate: float) -> None:
    """A stiffer servo than any that is sold: the lag of a loop of the bus, no error beside it."""
    run = bench_runs()[0]
    time = np.arange(0.0, 20.0, 1.0 / rate)

    def goal(at: np.ndarray) -> np.ndarray:
        return 0.6 * np.sin(2.0 * at) + 0.2 * np.sin(5.1 * at)

    position = STEP * np.round(goal(time - lag) / STEP)
    log = replace(run.joints[JOINT], goal=goal(time), position=position, velocity=None, duty=None, current=None)
    bare = replace(log, voltage=None, temperature=None, torque=None, link_position=None, enabled=None)
    assert CODE not in codes_of(replace(run, time=time, joints={JOINT: bare}, host={}, base={}))


def test_a_joint_at_rest_or_without_torque_is_none() -> None:
    run = bench_runs()[0]
    rest = np.zeros(len(run.time))
    assert CODE not in codes_of(with_log(run, goal=rest, position=rest))
    position = signal(run, "position")
    assert CODE not in codes_of(with_log(run, goal=position, enabled=rest, duty=None, current=None))


@pytest.mark.long
@pytest.mark.parametrize("both", [True, False], ids=["goal and encoder wrap", "goal alone wraps"])
def test_goals_that_wrap_are_put_back_with_the_angle_that_follows(both: bool) -> None:
    """The encoder alone was unwrapped, and then moved against its goal."""
    run = bench_runs(3)[0]
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
    run = bench_runs(3)[0]
    goal = np.where(run.time % 4.0 < 2.0, -3.1, 3.1)
    position = goal[0] + np.convolve(goal - goal[0], np.ones(60) / 60.0)[: len(goal)]
    assert "goal.wrap" not in {finding.code for finding in check_run(with_log(run, goal=goal, position=position))}
