"""A fault of a column is a property of the machine: decided over all its runs with the drive on, mended in all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from sealegs.gap.checks.data_set import check_set, corrected
from sealegs.gap.checks.drive import released
from sealegs.gap.log.types import MeasuredRun, MeasuredSet
from sealegs.gap.prepare.checking import check_log

from testbed import hidden_bench
from tests.changed_logs import JOINT, signal, with_log
from tests.gap.checks.test_data_errors import SCHEDULES


@cache
def four_runs() -> MeasuredSet:
    return hidden_bench({}, 3, runs=4, duration=6.0, schedules=SCHEDULES)[0]


def mended(data: MeasuredSet) -> MeasuredSet:
    return corrected(data, check_set(data))[0]


def half_off(run: MeasuredRun) -> MeasuredRun:
    """The drive is off for most of the run, and somebody moves the joint against the goal of the time."""
    off = run.time > 1.5
    turned = signal(run, "position").copy()
    turned[off] = 1.2 * signal(run, "goal")[off]
    return with_log(run, position=turned, enabled=np.where(off, 0.0, 1.0), duty=None, current=None, velocity=None)


def test_a_sign_is_mended_in_all_runs_though_one_has_its_drive_off() -> None:
    """It was mended in three runs of four, and physics then fitted the fourth."""
    data = four_runs()
    runs = [*data.runs[:3], half_off(data.runs[3])]
    wrong = replace(data, runs=tuple(with_log(run, position=-signal(run, "position")) for run in runs))
    for run, right in zip(mended(wrong).runs, runs, strict=True):
        np.testing.assert_allclose(signal(run, "position"), signal(right, "position"))


def test_a_joint_that_is_pushed_about_in_one_run_has_no_wrong_sign() -> None:
    data = four_runs()
    odd = with_log(data.runs[3], position=-0.5 * signal(data.runs[3], "goal"), velocity=None, duty=None, current=None)
    same = mended(replace(data, runs=(*data.runs[:3], odd)))
    np.testing.assert_allclose(signal(same.runs[0], "position"), signal(data.runs[0], "position"))


def test_one_run_of_four_in_degrees_is_converted() -> None:
    """It was kept as radians: 3228 mrad, and a proposed motion up to 50 rad."""
    data = four_runs()
    last = data.runs[3]
    odd = with_log(last, **{name: np.degrees(signal(last, name)) for name in ("goal", "position")}, velocity=None)
    for run, right in zip(mended(replace(data, runs=(*data.runs[:3], odd))).runs, data.runs, strict=True):
        for name in ("goal", "position"):
            np.testing.assert_allclose(signal(run, name), signal(right, name), atol=1e-9)


def test_runs_in_radians_stay_as_they_are() -> None:
    assert not [f for f in corrected(four_runs(), check_set(four_runs()))[1] if f.data_error]


def test_a_drive_that_looks_off_is_told_and_taken_as_off() -> None:
    """It read "stuck duty", and 611 mrad of nonsense."""
    data = four_runs()
    last = data.runs[3]
    off = (last.time > 2.0) & (last.time < 5.0)
    hanging = np.where(off, 0.002 * np.sin(9.0 * last.time), signal(last, "position"))
    loose = with_log(last, position=hanging, duty=np.where(off, 0.0, signal(last, "duty")), velocity=None)
    seen, findings = released(replace(data, runs=(*data.runs[:3], loose)))
    (finding,) = findings
    assert finding.code == "drive.looks_off" and f"log {JOINT}.enabled" in finding.sentence
    enabled = signal(seen.runs[3], "enabled") < 0.5
    assert (enabled & off).sum() > 0.9 * off.sum() and (enabled & ~off).sum() < 0.05 * off.sum()
    assert all(run.joints[JOINT].enabled is None for run in seen.runs[:3])
    assert "column.stuck" not in {f.code for f in check_set(seen)}


@pytest.mark.parametrize("wrong", [np.degrees, np.negative])
def test_no_drive_looks_off_for_a_position_that_is_mended(wrong: Callable[[np.ndarray], np.ndarray]) -> None:
    """An eighth of a log in degrees was taken as off, by a goal that looked far away, and replayed without a drive."""
    data = four_runs()
    runs = tuple(with_log(run, position=wrong(signal(run, "position")), velocity=None) for run in data.runs)
    seen, findings, _ = check_log(replace(data, runs=runs), lambda text: None)
    assert "drive.looks_off" not in {finding.code for finding in findings}
    for run, right in zip(seen.runs, data.runs, strict=True):
        assert run.joints[JOINT].enabled is None
        np.testing.assert_allclose(signal(run, "position"), signal(right, "position"), atol=1e-9)
