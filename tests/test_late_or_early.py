"""On a joint whose load nobody knows: a late reading is not a slow drive, and a column of the row before no delay."""

from __future__ import annotations

from dataclasses import replace

import pytest
from sealegs.gap.checks.data_set import check_set, corrected
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.verdict.diagnosis import diagnose

from testbed import hidden_bench

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
    assert [cause.name for cause in found.causes] == ["sensor.delay"], found.text
