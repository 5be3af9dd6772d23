"""What two runs differ by chance is no gap; what they differ by in every window is one."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from sealegs.envs.robots import get_robot
from sealegs.evaluation.comparison import gap_of, verdict
from sealegs.hw.bus.registers import load_model
from sealegs.hw.machine.robot import ServoRobot, nominal_joints


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


ERRORS = {"same_goals": 0.01, "same_goals_of_slides": math.nan, "accounted": 1e-9, "accounted_of_slides": math.nan}


def test_a_joint_that_hardly_moves_is_not_off_millions_of_times() -> None:
    """Of a run of 2 s: 'off 3718970.1 times as far'."""
    figures: Any = SimpleNamespace(**ERRORS, gap=3718970.1, gap_at="knee")
    assert verdict(figures).endswith("knee is off over 100 times as far.")


def test_errors_of_joints_that_slide_are_told_in_mm_beside_those_that_turn_in_mrad() -> None:
    """Rad and m were under one root."""
    gantry = cast(ServoRobot, SimpleNamespace(names=["x", "turn"], units=["m", "rad"], base_names=[]))
    told = gap_of(np.tile([4e-6, 9e-4], (20, 1)), np.tile([4e-6, 9e-4], (20, 1)), gantry)
    assert told["same_goals"] == pytest.approx(0.03) and told["same_goals_of_slides"] == pytest.approx(0.002)
    figures: Any = SimpleNamespace(**told)
    assert "position error is 30 mrad and 2 mm over windows" in verdict(figures)
    assert math.isnan(gap_of(np.full((20, 1), 1e-6), np.full((20, 1), 1e-6), bench())["same_goals_of_slides"])
