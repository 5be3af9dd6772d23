"""The biped's reference gaits, and what corrects them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sealegs.agents.action_pipeline import task_parts
from sealegs.common.errors import SealegsError
from sealegs.envs.biped.env import BipedTask
from sealegs.envs.biped.gait import HoppingGait, WalkingGait
from sealegs.envs.biped.robot import BIPED
from sealegs.envs.contract import goal_scale, random_motion, robot_hash
from sealegs.envs.engine.batch import BatchEngine
from sealegs.envs.engine.task import Motion

from benchmarks.biped_motion import load
from benchmarks.learned_biped import JUDGED, walk
from tests.quick import quick

NUMBERS = BIPED.parameters()
POLICIES = sorted((Path(__file__).resolve().parents[2] / "policies" / "biped").glob("seed*"))


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


def other_side(values: np.ndarray) -> np.ndarray:
    """Values of the left leg and then of the right one (n, 2 j), the other way round."""
    return np.roll(values, values.shape[1] // 2, axis=1)


def half_a_turn_later(motion: Motion, cadence: float) -> Motion:
    """The same motion with left and right exchanged; the policy's own action stays as it gave it."""
    legs = ("link", "link_speed", "reading", "reading_speed", "torque", "motor_speed")
    swapped = {name: other_side(getattr(motion, name)) for name in legs}
    return replace(motion, **swapped, time=motion.time + 0.5 / cadence)


def test_a_mirrored_policy_sees_and_does_the_same_half_a_turn_later_with_the_other_leg() -> None:
    task = BipedTask(mirrored=1.0, correction=0.4, cadence=1.25)
    motion = random_motion(task, NUMBERS, np.random.default_rng(0), 200)
    later = half_a_turn_later(motion, task.cadence)
    seen, seen_later = (np.concatenate(task_parts(task.observe(one)), axis=1) for one in (motion, later))
    np.testing.assert_allclose(seen_later, seen, atol=1e-9)
    action = np.random.default_rng(1).uniform(-1.0, 1.0, (200, 4))

    def goals(time: np.ndarray) -> np.ndarray:
        zero, per_action = goal_scale(task, NUMBERS, time, motion.command)
        return zero + per_action * task.on_joints(time, action)

    np.testing.assert_allclose(goals(later.time), other_side(goals(motion.time)), atol=1e-9)
    plain = replace(task, mirrored=0.0)
    assert np.abs(np.concatenate(task_parts(plain.observe(later)), axis=1) - seen).max() > 0.1


def test_in_the_engine_a_mirrored_action_goes_to_the_leg_that_swings() -> None:
    task = BipedTask(mirrored=1.0, correction=0.4, cadence=1.25, start_noise=0.0)
    engine = BatchEngine(task, 1, autoreset=False)
    engine.reset()
    ctrl, moved = engine.batch.bind("ctrl"), []
    for k in range(40):  # a whole turn: left swings, then right
        zero, _ = goal_scale(task, engine.numbers, np.array([k / 50.0]), np.full((1, 1), task.speed))
        engine.step(np.array([[0.5, 0.0, 0.0, 0.0]]))
        moved.append(int(np.argmax(np.abs(ctrl[0] - zero[0]))))
    assert moved == [0] * 20 + [2] * 20


def test_legs_that_hop_together_are_seen_as_they_are() -> None:
    values, time = np.arange(8.0).reshape(2, 4), np.array([0.1, 0.6])  # one in either half of the clock's turn
    hopping = BipedTask(mirrored=1.0, hopping=1.0)
    assert np.array_equal(hopping.on_joints(time, values), values)
    assert not np.array_equal(BipedTask(mirrored=1.0).on_joints(time, values), values)
    with pytest.raises(SealegsError, match="1 or 0"):
        BipedTask(mirrored=0.5)


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
