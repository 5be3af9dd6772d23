"""How hard servos are driven: measured in every environment, and a cost where it is asked for."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import sealegs
from sealegs.actuators import load_chain
from sealegs.actuators.chain import no_load_speed, stall_torque
from sealegs.common.errors import SealegsError
from sealegs.envs.engine.sb3 import BatchVecEnv
from sealegs.envs.engine.servo_use import MEASURES, ServoUse

STS = load_chain("sts3215")
DT = 0.02


def use(weights: Any = None, chain: Any = STS) -> ServoUse:
    """Measures of one simulation of one joint, at rest at 0."""
    made = ServoUse({"joint": chain}, 1, DT, weights)
    made.start(np.array([0]), np.zeros((1, 1)))
    return made


def step(made: ServoUse, goal: float, torque: float = 0.0, duty: float = 0.0) -> dict[str, float]:
    found = made.step(*(np.array([[value]]) for value in (goal, torque, duty)))
    return {name: float(value[0]) for name, value in found.items()}


def test_a_chain_tells_the_speed_and_torque_of_its_servo() -> None:
    volts, resistance, constant = 7.4, STS.value("dc_motor.resistance"), STS.value("dc_motor.motor_constant")
    assert no_load_speed(STS) == pytest.approx(STS.value("duty_limit.limit") * volts / constant, rel=1e-6)
    assert stall_torque(STS) == pytest.approx(STS.value("duty_limit.limit") * volts / resistance * constant, rel=1e-6)
    assert no_load_speed(load_chain("ideal")) == math.inf


def test_goals_that_the_servo_follows_cost_nothing_and_faster_ones_by_their_excess() -> None:
    speed, made = no_load_speed(STS), use({"goal_rate": 2.0})
    assert step(made, 0.9 * speed * DT)["goal_rate"] == 0.0
    found = made.step(np.array([[0.9 * speed * DT - 3.0 * speed * DT]]), np.zeros((1, 1)), np.zeros((1, 1)))
    assert found["goal_rate"][0] == pytest.approx(2.0)
    assert made.terms(found)["reward_servo_goal_rate"][0] == pytest.approx(-4.0)


def test_saturation_heat_and_reversals_are_of_the_stalled_servo() -> None:
    made, stall = use(), stall_torque(STS)
    assert step(made, 0.0, 0.5 * stall, STS.value("duty_limit.limit"))["saturation"] == 1.0
    found = step(made, 0.0, -0.5 * stall, 0.3)
    assert found["heat"] == pytest.approx(0.25) and found["reversals"] == pytest.approx(1.0 / DT)
    assert found["saturation"] == 0.0
    assert step(made, 0.0, 0.02 * stall)["reversals"] == 0.0, "a slight torque has no sign"
    assert step(made, 0.0, -0.5 * stall)["reversals"] == 0.0, "and is forgotten"
    assert step(made, 0.0, 0.5 * stall)["reversals"] == pytest.approx(1.0 / DT)
    made.start(np.array([0]), np.zeros((1, 1)))
    assert step(made, 0.0, -0.5 * stall)["reversals"] == 0.0, "an episode begins without"


def test_a_chain_that_tells_nothing_costs_nothing() -> None:
    found = step(use(chain=load_chain("ideal")), 3.0, 100.0)
    assert found["goal_rate"] == found["heat"] == found["reversals"] == 0.0


@pytest.mark.parametrize(
    ("weights", "says"),
    [
        ({"heet": 1.0}, "did you mean 'heat'"),
        ({"heat": -1.0}, "a number from 0"),
        ({"heat": True}, "a number from 0"),
        (3.0, "takes weights"),
    ],
)
def test_weights_that_are_none_are_refused(weights: Any, says: str) -> None:
    with pytest.raises(SealegsError, match=says):
        use(weights)


def test_every_environment_takes_the_terms_and_the_episode_tells_the_means() -> None:
    """Goals from end to end in each step: fast, saturated, to and fro."""
    plain, costly = (
        BatchVecEnv("SeaLegs/Bench-v0", 2, seed=0, max_episode_steps=20, servo=weights)
        for weights in (None, dict.fromkeys(MEASURES, 1.0))
    )
    rewards, told = [], []
    for env in (plain, costly):
        env.reset()
        total = np.zeros(2)
        for count in range(20):
            env.step_async(np.full((2, 1), (-1.0) ** count))
            _, reward, _, infos = env.step_wait()
            total += reward
        rewards.append(total)
        told.append(infos[0]["episode"])
    assert told[0]["servo_goal_rate"] > 5.0 and told[0]["servo_saturation"] > 0.5 and told[0]["servo_reversals"] > 10.0
    assert 0.0 < told[0]["servo_heat"] < 2.0
    cost = sum(20 * told[1][f"servo_{name}"] for name in MEASURES)
    assert rewards[0][0] - rewards[1][0] == pytest.approx(cost, rel=1e-4)
    assert told[1]["reward_servo_heat"] == pytest.approx(-20 * told[1]["servo_heat"])
    walk = sealegs.make_env("walk", servo={"heat": 1.0})
    walk.reset(seed=0)
    assert walk.step(np.zeros(walk.action_space.shape))[4]["reward_servo_heat"] <= 0.0
