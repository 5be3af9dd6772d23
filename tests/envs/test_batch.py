"""One engine, three shells: single, vector and SB3 environments move bit for bit alike."""

from __future__ import annotations

import math
import warnings
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import pytest
import sealegs
from sealegs.actuators import load_chain
from sealegs.actuators.chain import no_load_speed, stall_torque
from sealegs.common.errors import SealegsError
from sealegs.envs.biped.robot import TORSO
from sealegs.envs.engine.batch import BatchEngine
from sealegs.envs.engine.sb3 import BatchVecEnv
from sealegs.envs.engine.servo_use import MEASURES, ServoUse
from sealegs.envs.engine.vector import BatchVectorEnv
from sealegs.envs.hopper.env import HopperTask

HOPPER, BIPED, HEXAPOD = (f"SeaLegs/{name}-v0" for name in ("Hopper", "Biped", "Hexapod"))
RANDOM = {
    "all": {"friction.viscous": {"times": [0.8, 1.2]}, "regression.duty_torque": [1.6, 2.0]},
    "mass": {"base": [0.9, 1.1]},
    "floor": {"friction": [0.5, 1.0]},
}
RANDOM_BIPED = {
    "all": {"friction.viscous": {"times": [0.8, 1.2]}},
    "mass": {TORSO: [0.9, 1.1]},
    "floor": {"friction": [1.0, 1.7]},
}


def actions(steps: int, count: int, size: int = 2) -> np.ndarray:
    return np.random.default_rng(0).uniform(-1, 1, (steps, count, size)).astype(np.float32)


@pytest.mark.parametrize(
    ("env_id", "randomization", "count", "episode", "steps"),
    [
        (HOPPER, RANDOM, 4, 30, 70),
        (BIPED, RANDOM_BIPED, 3, 12, 30),
        pytest.param(HEXAPOD, None, 2, 2, 4, marks=pytest.mark.long),
    ],
)
def test_single_vector_and_sb3_move_alike_with_randomisation_and_new_episodes(
    env_id: str, randomization: Any, count: int, episode: int, steps: int
) -> None:
    seed, keywords = 7, {"randomization": randomization, "max_episode_steps": episode}
    vector = gym.make_vec(env_id, num_envs=count, **keywords)
    sb3 = BatchVecEnv(env_id, count, seed=seed, **keywords)
    singles = [gym.make(env_id, **keywords) for _ in range(count)]
    observed = vector.reset(seed=seed)[0]
    np.testing.assert_array_equal(observed, sb3.reset())
    np.testing.assert_array_equal(observed, [env.reset(seed=seed + i)[0] for i, env in enumerate(singles)])
    ended = 0
    for action in actions(steps, count, gym.spaces.flatdim(vector.single_action_space)):
        observed, rewards, terminated, truncated, infos = vector.step(action)
        sb3_observed, sb3_rewards, dones, sb3_infos = sb3.step(action)
        np.testing.assert_array_equal(observed, sb3_observed)
        np.testing.assert_array_equal(rewards.astype(np.float32), sb3_rewards)
        np.testing.assert_array_equal(terminated | truncated, dones)
        for i, env in enumerate(singles):
            own, reward, own_terminated, own_truncated, _ = env.step(action[i])
            assert (reward, own_terminated, own_truncated) == (rewards[i], terminated[i], truncated[i])
            if own_terminated or own_truncated:
                ended += 1
                np.testing.assert_array_equal(infos["final_obs"][i], own)
                np.testing.assert_array_equal(sb3_infos[i]["terminal_observation"], own)
                own = env.reset()[0]
            np.testing.assert_array_equal(observed[i], own)
    assert ended >= 2 * count


def test_the_vector_environment_answers_as_gymnasiums_own_in_the_same_mode() -> None:
    count = 3
    mode = gym.vector.AutoresetMode.SAME_STEP
    ours = gym.make_vec(HOPPER, num_envs=count, max_episode_steps=12)
    theirs = gym.make_vec(
        HOPPER, num_envs=count, max_episode_steps=12, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}
    )
    np.testing.assert_array_equal(ours.reset(seed=1)[0], theirs.reset(seed=1)[0])
    for action in actions(30, count):
        *mine, my_infos = ours.step(action)
        *other, infos = theirs.step(action)
        for a, b in zip(mine, other, strict=True):
            np.testing.assert_array_equal(a, b)
        assert _plain(my_infos) == _plain(infos)


def _plain(infos: dict) -> dict:
    result = {}
    for name, value in infos.items():
        if isinstance(value, dict):
            result[name] = _plain(value)
        else:
            result[name] = [None if item is None else np.asarray(item, float).tolist() for item in value]
    return result


def test_make_vec_takes_the_batch_by_default_and_without_warnings() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for env_id in (HOPPER, "SeaLegs/Bench-v0"):
            env = gym.make_vec(env_id, num_envs=2)
            assert isinstance(env.unwrapped, BatchVectorEnv)
            assert env.metadata["autoreset_mode"] is gym.vector.AutoresetMode.SAME_STEP
            assert env.reset(seed=0)[0] in env.observation_space
            env.close()


def test_the_number_of_threads_changes_nothing() -> None:
    runs = []
    for threads in (1, 2):
        engine = BatchEngine(HopperTask(), 5, threads=threads, randomization=RANDOM, max_episode_steps=10)
        engine.seed(3)
        engine.reset()
        runs.append([engine.step(action).observation for action in actions(25, 5)])
    np.testing.assert_array_equal(runs[0], runs[1])


def test_an_episode_that_ends_tells_sb3_why_and_what_it_was_worth() -> None:
    env = BatchVecEnv(HOPPER, 3, seed=0, max_episode_steps=5)
    env.reset()
    total = np.zeros(3)
    for step in range(5):
        _, rewards, dones, infos = env.step(np.zeros((3, 2), np.float32))
        total += rewards
        assert dones.all() == (step == 4)
    for i, info in enumerate(infos):
        assert info["TimeLimit.truncated"] is True
        assert info["episode"]["l"] == 5
        assert info["episode"]["r"] == pytest.approx(total[i], abs=1e-5)
        terms = [value for name, value in info["episode"].items() if name.startswith("reward_")]
        assert sum(terms) == pytest.approx(total[i], abs=1e-5)


def test_a_reset_revives_actuators_whose_callback_was_taken_away() -> None:
    engine = BatchEngine(HopperTask(), 1)
    seen = []
    for take in (False, True):
        if take:
            mujoco.set_mjcb_act_bias(None)
        engine.seed(0)
        engine.reset()
        seen.append(engine.step(np.ones((1, 2))).observation)
    np.testing.assert_array_equal(seen[0], seen[1])


def test_a_fall_is_no_time_limit() -> None:
    env = BatchVecEnv(HOPPER, 1, seed=0, healthy_height=0.165)
    env.reset()
    for _ in range(100):
        _, _, dones, infos = env.step(np.array([[-1.0, 1.0]], np.float32))
        if dones[0]:
            break
    assert dones[0]
    assert infos[0]["TimeLimit.truncated"] is False


def test_an_unstable_simulation_ends_its_episode_and_no_other() -> None:
    engine = BatchEngine(HopperTask(), 3)
    engine.seed(0)
    engine.reset()
    engine.batch.bind("qvel")[1] = 1e11
    outcome = engine.step(np.zeros((3, 2)))
    assert outcome.terminated.tolist() == [False, True, False]
    assert outcome.flags["unstable"].tolist() == [False, True, False]
    assert np.isfinite(engine.step(np.zeros((3, 2))).observation).all()


@pytest.mark.parametrize("shape", [(3, 1), (2,), (1, 2), (2, 3)])
def test_actions_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    engine = BatchEngine(HopperTask(), 3)
    engine.reset()
    with pytest.raises(SealegsError, match=r"simulations of hip, knee need \(3, 2\)"):
        engine.step(np.zeros(shape))


def test_an_action_that_is_not_finite_is_refused_and_moves_nothing() -> None:
    engine = BatchEngine(HopperTask(), 3)
    engine.reset()
    before = engine.batch.bind("qpos").copy()
    with pytest.raises(SealegsError, match="the action of 'knee' in simulation 1 is nan"):
        engine.step(np.array([[0.0, 0.0], [0.0, np.nan], [0.0, 0.0]]))
    np.testing.assert_array_equal(engine.batch.bind("qpos"), before)


def test_step_leaves_the_arrays_of_earlier_steps_alone() -> None:
    engine = BatchEngine(HopperTask(), 2)
    engine.seed(0)
    first = engine.reset()
    kept = first.copy()
    second = engine.step(np.zeros((2, 2)))
    values = second.observation.copy(), {name: term.copy() for name, term in second.terms.items()}
    engine.step(np.ones((2, 2)))
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_array_equal(second.observation, values[0])
    for name, term in second.terms.items():
        np.testing.assert_array_equal(term, values[1][name])


@pytest.mark.parametrize(
    ("env_id", "keywords", "sentence"),
    [
        ("SeaLegs/Hoper-v0", {}, "no environment .*did you mean 'SeaLegs/Hopper-v0'"),
        ("CartPole-v1", {}, "none of this project's"),
        (HOPPER, {"sped": 1.0}, "no argument 'sped' .*did you mean 'speed'"),
        (HOPPER, {"actuator": "idael"}, "did you mean 'ideal'"),
        (HOPPER, {"render_mode": "depht"}, "no render_mode 'depht'"),
        (HOPPER, {"speed": (0.5, 0.1)}, "a range goes from its low to its high end"),
        (HOPPER, {"speed": float("nan")}, "it must be finite"),
    ],
)
def test_a_wrong_vec_env_is_answered_in_one_sentence(env_id: str, keywords: dict, sentence: str) -> None:
    with pytest.raises(SealegsError, match=sentence):
        BatchVecEnv(env_id, 2, **keywords)


def test_a_weight_of_the_reward_that_is_set_counts_from_the_next_step_on() -> None:
    """It was accepted, and changed nothing."""
    rewards = []
    for weight in (None, 0.0):
        env = BatchVecEnv("SeaLegs/Track-v1", 2, seed=0, robot="bench", smooth_weight=0.0)
        env.reset()
        if weight is not None:
            env.set_attr("tracking_weight", weight)
            assert env.get_attr("tracking_weight") == [weight, weight]
        env.step_async(np.zeros((2, 1)))
        rewards.append(env.step_wait()[1])
    assert (rewards[0] > 0.1).all() and (rewards[1] == 0.0).all()
    with pytest.raises(SealegsError, match="tracking_weight takes a number, not 'none'"):
        env.set_attr("tracking_weight", "none")


def test_what_all_simulations_share_is_not_set_for_some_of_them() -> None:
    env = BatchVecEnv(HOPPER, 3, seed=0)
    env.set_attr("label", 1)
    env.set_attr("label", 2, indices=[0, 1, 2])
    assert env.get_attr("label", indices=[1]) == [2]
    sentence = "indices=.* are 1 of 3 simulations, but all of them share .*: leave indices out"
    with pytest.raises(SealegsError, match=sentence):
        env.set_attr("label", 3, indices=1)
    with pytest.raises(SealegsError, match=sentence):
        env.env_method("close", indices=[0])
    assert env.get_attr("label") == [2, 2, 2]


# --- how hard servos are driven: measured in every environment, and a cost where it is asked for ---------------------

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
