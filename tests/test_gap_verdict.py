"""What two runs differ by chance is no gap; what they differ by in every window is one."""

from __future__ import annotations

import numpy as np
from sealegs.envs.robots import get_robot
from sealegs.hw.comparison import gap_of
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
    verdict = gap_of(found, accounted, bench())
    assert verdict["gap"] is not None and verdict["gap"] > 1.5 and verdict["gap_at"] == "joint"
