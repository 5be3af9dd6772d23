"""On a joint whose load nobody knows: a late reading is not a slow drive, and a column of the row before no delay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.checks.data_set import check_set, corrected
from sealegs.gap.checks.recording import DRIVE_LOOP_PERIOD
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.parts import cut
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.measure.named import CERTAIN
from sealegs.gap.replay.driven import driven_problem
from sealegs.gap.replay.joint_model import JointModel

from testbed import NOISE_FLOOR, hidden_bench

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
