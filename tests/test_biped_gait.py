"""The biped's reference gaits, and what corrects them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.envs.batch import BatchEngine
from sealegs.envs.biped.gait import HoppingGait, WalkingGait
from sealegs.envs.biped.robot import BIPED
from sealegs.envs.biped.task import BipedTask
from sealegs.envs.contract import robot_hash

from benchmarks.biped_motion import load
from benchmarks.learned_biped import JUDGED, walk
from tests.quick import quick

NUMBERS = BIPED.parameters()
POLICIES = sorted((Path(__file__).resolve().parents[1] / "policies" / "biped").glob("seed*"))


def walking(phase: np.ndarray, speed: float = 0.6, cadence: float = 1.2) -> np.ndarray:
    return WalkingGait().goals(phase, np.full(len(phase), speed), cadence, NUMBERS)


def test_legs_take_turns_half_a_turn_of_the_clock_apart() -> None:
    phase = np.linspace(0.0, 2.0 * np.pi, 50, endpoint=False)
    goals, later = walking(phase), walking(phase + np.pi)
    np.testing.assert_allclose(goals[:, :2], later[:, 2:], atol=1e-12)
    assert (goals[1:25, 1] > goals[1:25, 3]).all(), "the left leg bends first"


def test_a_standing_leg_goes_back_as_fast_as_the_robot_is_to_go_forward() -> None:
    speed, cadence = 0.6, 1.2
    start, end = walking(np.array([0.0, np.pi - 1e-9]), speed, cadence)[:, 2]
    length = (NUMBERS["thigh_length"] + NUMBERS["shin_length"]) * np.cos(WalkingGait().shape)
    assert length * (np.sin(start) - np.sin(end)) == pytest.approx(speed / (2.0 * cadence), rel=1e-6)


def test_hopping_legs_bend_together() -> None:
    goals = HoppingGait().goals(np.linspace(0.0, 6.0, 20))
    np.testing.assert_array_equal(goals[:, 1], goals[:, 3])
    assert np.ptp(goals[:, 1]) > 0.1 and np.ptp(goals[:, 0]) == 0.0


def test_actions_correct_the_gait_by_a_share_of_the_range_and_no_goal_leaves_it() -> None:
    engine = BatchEngine(BipedTask(correction=0.4, start_noise=0.0), 2, autoreset=False)
    engine.seed(0)
    engine.reset()
    goals = walking(np.zeros(2), engine.task.speed, engine.task.cadence)  # type: ignore[attr-defined]
    ctrl = engine.batch.bind("ctrl")
    engine.step(np.array([[0.0] * 4, [0.5] * 4]))
    np.testing.assert_allclose(ctrl[0], goals[0], atol=1e-12)
    np.testing.assert_allclose(ctrl[1] - ctrl[0], 0.5 * 0.4 * engine.goal_half, atol=1e-12)
    wide = BatchEngine(BipedTask(correction=2.0), 1, autoreset=False)
    wide.reset()
    wide.step(np.ones((1, 4)))
    np.testing.assert_allclose(wide.batch.bind("ctrl")[0], wide.goal_centre + wide.goal_half)


def test_the_gait_alone_does_not_walk() -> None:
    engine = BatchEngine(BipedTask(correction=0.4), 8, autoreset=False)
    engine.seed(0)
    engine.reset()
    fallen = np.zeros(8, bool)
    for _ in range(200):
        fallen |= engine.step(np.zeros((8, 4))).terminated
    assert fallen.all()


def test_a_time_step_makes_no_other_robot() -> None:
    assert robot_hash(BIPED, {"timestep": 0.002}) == robot_hash(BIPED) != robot_hash(BIPED, {"torso_mass": 41.0})


@pytest.mark.parametrize("folder", quick(POLICIES, 5), ids=lambda folder: folder.name)
def test_a_learned_policy_walks_from_a_standing_start(folder: Path) -> None:
    env, actuator, act = load(folder)
    figures = walk({**env, "speed": JUDGED}, actuator, act, starts=2, seconds=8.0)
    assert figures["falls"] == 0.0
    assert 0.4 < figures["slowest [m/s]"] < 0.8
    assert figures["share on one foot"] > 0.4  # about half of it in seeds 1 and 4
