"""Samples that a recording lacks: what was commanded meanwhile is not known, and nothing is judged by it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from sealegs.gap.checks.clock import check_clock
from sealegs.gap.log.gaps import known_commands
from sealegs.gap.log.parts import WARM_UP
from sealegs.gap.log.types import MeasuredRun

from testbed.bench import NOISE_FLOOR
from tests.logged_robots import JOINTS, free_replay, nominal_error, two_link_run


def lacking(run: MeasuredRun, start: float, stop: float) -> MeasuredRun:
    """The run without the samples between two times [s]."""
    kept = (run.time < start) | (run.time > stop)
    joints = {
        name: replace(log, **{key: values[kept] for key, values in log.signals().items()})
        for name, log in run.joints.items()
    }
    return replace(run, time=run.time[kept], joints=joints)


def test_motion_after_lost_commands_does_not_count_until_it_has_forgotten_them(tmp_path: Path) -> None:
    """A replay ran on under the last command, and its error was a gap of 105 mrad on a machine with nothing hidden."""
    run = lacking(two_link_run(tmp_path, 8.0), 3.0, 3.3)
    (finding,) = [found for found in check_clock(run) if found.code == "clock.gaps"]
    assert "motion counts again 1.5 s later" in finding.sentence
    assert all(nominal_error(free_replay(run, joint)) < 2.0 * NOISE_FLOOR for joint in JOINTS)


def test_what_counts_after_a_gap() -> None:
    time = np.delete(np.arange(0.0, 10.0, 0.01), np.arange(300, 330))
    changing, held = np.sin(time), np.zeros_like(time)
    assert known_commands(time, held).all(), "nothing was lost that a held command does not say"
    known = known_commands(time, changing)
    assert not known[(time > 2.99) & (time < 3.3 + WARM_UP)].any()
    assert known[(time < 2.9) | (time > 3.31 + WARM_UP)].all()
    assert known_commands(np.arange(0.0, 1.0, 0.01), np.arange(100.0)).all(), "a clock without gaps"


def test_half_of_what_lies_between_frequent_gaps_counts() -> None:
    time = np.arange(0.0, 10.0, 0.01)
    time = time[(time % 1.0) > 0.1]
    known = known_commands(time, np.sin(time))
    assert 0.4 < known[time > 1.0].mean() < 0.6
