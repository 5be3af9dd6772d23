"""Wheels: chains that are told speeds, and driving as commanded with a robot of data alone."""

from __future__ import annotations

import math
import warnings

import mujoco
import numpy as np
import pytest
import sealegs
from gymnasium.utils.env_checker import check_env as check_gymnasium
from sealegs.actuators import Chain, Drivetrain, load_chain
from sealegs.actuators.stages import ChainError
from sealegs.actuators.turning import apart
from sealegs.common.errors import SealegsError
from sealegs.envs.any_robot.drive import DriveTask, rolling
from sealegs.envs.engine.batch import BatchEngine
from sealegs.envs.robots import get_robot
from stable_baselines3.common.env_checker import check_env as check_sb3

from testbed.wheel import Wheel, simulate

WHEEL = """<mujoco><option timestep="0.001"/><worldbody><body><joint name="wheel" axis="0 1 0"/>
<inertial pos="0 0 0" mass="0.4" diaginertia="0.002 0.004 0.002"/></body></worldbody></mujoco>"""


def test_a_chain_that_is_told_a_speed_turns_as_a_wheel_that_shares_no_code() -> None:
    drivetrain = Drivetrain(mujoco.MjSpec.from_string(WHEEL), {"wheel": load_chain("sts3215_wheel")})
    model, data = drivetrain.model, mujoco.MjData(drivetrain.model)
    goals = np.where(np.arange(2000) < 1000, 3.0, -1.5)
    mujoco.mj_forward(model, data)
    angles = []
    for goal in goals:
        data.ctrl[0] = goal
        mujoco.mj_step(model, data)
        angles.append(data.qpos[0])
    record = simulate(Wheel(), 1e-3 * np.arange(2000), goals, 2.0)
    other = np.interp(1e-3 * np.arange(1, 2001), record[:, 0], record[:, 1])
    np.testing.assert_allclose(angles, other, atol=0.02)
    assert abs(data.qvel[0] + 1.5) < 0.05


def test_a_chain_of_speeds_turns_with_its_joint_and_takes_no_stage_of_positions() -> None:
    for chain in (
        load_chain("sts3215_wheel"),
        load_chain("xl330_wheel"),
        load_chain([{"ideal_velocity": {"damping": 1}}]),
    ):
        assert chain.command == "goal_velocity"
        assert apart(chain, 0.5) < 1e-9
    with pytest.raises(ChainError, match=r"'rate_limit' takes position goal \[rad\], but .* gives speed goal"):
        load_chain([{"rate_limit": {"speed": 1}}, {"ideal_velocity": {"damping": 1}}])
    assert Chain(load_chain("sts3215").stages).command == "goal"


def driven(count: int, **arguments: float) -> tuple[BatchEngine, np.ndarray]:
    """An engine after four seconds without corrections, and its mean forward speed and turn over the last two."""
    engine = BatchEngine(DriveTask(stand_share=0.0, **arguments), count, autoreset=False)
    engine.seed(0)
    engine.reset()
    seen = []
    for _ in range(200):
        engine.step(np.zeros((count, 2)))
        assert isinstance(engine.task, DriveTask)
        seen.append(np.stack(engine.task.velocity(engine.motion(np.zeros((count, 2)))), axis=1))
    return engine, np.mean(seen[100:], axis=0)


def test_a_rover_drives_as_commanded_without_learning() -> None:
    _, mean = driven(2, forward=0.15, turn=0.5)
    np.testing.assert_allclose(mean, [[0.15, 0.5]] * 2, atol=0.02)
    _, mean = driven(1, forward=-0.1, turn=0.0)
    np.testing.assert_allclose(mean, [[-0.1, 0.0]], atol=0.02)


def test_its_wheels_turn_as_radius_and_track_say() -> None:
    rolls = rolling(get_robot("rover"))
    np.testing.assert_allclose(rolls.per_forward, 1.0 / 0.04)
    np.testing.assert_allclose(rolls.per_turn, [-0.065 / 0.04, 0.065 / 0.04])


def test_driving_passes_the_checks_of_gymnasium_and_sb3() -> None:
    env = sealegs.make_env("drive").unwrapped
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        check_gymnasium(env, skip_render_check=True)
        check_sb3(env, skip_render_check=True)


def test_tasks_of_positions_and_robots_without_wheels_are_refused_in_a_sentence() -> None:
    for task in ("reach", "track", "walk"):
        with pytest.raises(SealegsError, match="left_wheel, right_wheel are told speeds"):
            sealegs.make_env(task, robot="rover")
    with pytest.raises(SealegsError, match="has no wheel"):
        sealegs.make_env("drive", robot="quadruped")


@pytest.mark.parametrize("chain", ["ideal", "sts3215"])
def test_a_wheel_that_a_chain_of_positions_drives_is_refused_before_its_step_is_looked_at(chain: str) -> None:
    for task in ("drive", "reach"):
        with pytest.raises(SealegsError, match=r"joint left_wheel is told positions, and the one in .* file speeds"):
            sealegs.make_env(task, robot="rover", actuator=chain)


def test_goals_beyond_the_servo_stop_at_its_speed_without_load() -> None:
    engine, mean = driven(1, forward=1.0, turn=0.0)
    assert 0.15 < mean[0, 0] < 0.04 * 5.6
    assert math.isclose(float(engine.batch.bind("ctrl")[0, 0]), 5.5)
