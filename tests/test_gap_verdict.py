"""What two runs differ by chance is no gap; what they differ by in every window is one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from sealegs.envs.robots import get_robot
from sealegs.hw.comparison import gap_of, verdict
from sealegs.hw.registers import load_model
from sealegs.hw.robot import ServoRobot, nominal_joints


def bench() -> ServoRobot:
    model, servo = get_robot("bench"), load_model("sts3215")
    return ServoRobot(model, {}, servo, nominal_joints(model, servo, {}), dict(model.chains))


def test_one_window_with_a_hard_landing_is_no_gap() -> None:
    calm = np.full((20, 1), 1e-6)
    landed = calm.copy()
    landed[7] = 1e-4
    assert np.sqrt(landed.mean() / calm.mean()) > 2.0
    assert gap_of(landed, calm, bench())["gap"] is None


def test_the_same_excess_in_every_window_is_one() -> None:
    rng = np.random.default_rng(1)
    accounted, found = (scale * rng.chisquare(3, (20, 1)) for scale in (1e-6, 4e-6))
    told = gap_of(found, accounted, bench())
    assert told["gap"] is not None and told["gap"] > 1.5 and told["gap_at"] == "joint"


def test_a_joint_that_hardly_moves_is_not_off_millions_of_times() -> None:
    """Of a run of 2 s: 'off 3718970.1 times as far'."""
    figures: Any = SimpleNamespace(same_goals=0.01, accounted=1e-9, gap=3718970.1, gap_at="knee")
    assert verdict(figures).endswith("knee is off over 100 times as far.")
