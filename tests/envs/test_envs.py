"""Robots and single environments keep Gymnasium's contract and the robots' printed numbers."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import pickle
import re
import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import imageio.v2 as imageio
import mujoco
import numpy as np
import pytest
import sealegs  # noqa: F401 registers
import yaml
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env as check_gymnasium
from gymnasium.wrappers import RecordVideo
from sealegs.actuators import load_chain
from sealegs.common.errors import SealegsError
from sealegs.envs.any_robot.reach import ReachTask
from sealegs.envs.engine.arguments import Argument, arguments, table
from sealegs.envs.engine.sb3 import BatchVecEnv
from sealegs.envs.engine.task import option
from sealegs.envs.engine.vector import BatchVectorEnv, SingleEnv
from sealegs.envs.hopper.robot import HOPPER
from sealegs.envs.robots import get_robot
from stable_baselines3.common.env_checker import check_env as check_sb3


def single(env: gym.Env) -> SingleEnv:
    inner = env.unwrapped
    assert isinstance(inner, SingleEnv)
    return inner


def constant(env: gym.Env, value: float) -> np.ndarray:
    return np.full_like(env.action_space.sample(), value)


IDS = tuple(name for name in gym.registry if name.startswith("SeaLegs/"))
every_environment = pytest.mark.parametrize("env_id", IDS)
one_quick = pytest.mark.parametrize(
    "env_id", [name if "Biped" in name else pytest.param(name, marks=pytest.mark.long) for name in IDS]
)


def few_steps(env: gym.Env, seed: int, count: int = 3) -> np.ndarray:
    """Observations and rewards of a few random steps, in one array."""
    random = np.random.default_rng(seed)
    seen = [env.reset(seed=seed)[0]]
    for _ in range(count):
        action = random.uniform(-1.0, 1.0, env.action_space.shape or ()).astype(np.float32)
        observation, reward, *_ = env.step(action)
        seen += [observation, np.array([reward])]
    return np.concatenate(seen)


@one_quick
def test_environments_pass_the_checks_of_gymnasium_and_sb3(env_id: str) -> None:
    env = gym.make(env_id).unwrapped
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*Box observation space m.*imum value is.*infinity")
        warnings.simplefilter("error", UserWarning)
        warnings.filterwarnings("ignore", message=".*Box observation space m.*imum value is.*infinity")
        check_gymnasium(env, skip_render_check=True)
        check_sb3(env, skip_render_check=True)


@pytest.mark.long
@every_environment
def test_equal_seeds_move_alike_and_others_do_not(env_id: str) -> None:
    first, again = gym.make(env_id), gym.make(env_id)
    moved = few_steps(first, 4)
    np.testing.assert_array_equal(moved, few_steps(again, 4))
    np.testing.assert_array_equal(moved, few_steps(first, 4))
    assert (first.reset(seed=5)[0] != again.reset(seed=4)[0]).any()


def steady(env_id: str) -> str:
    """The ideal servo, which is told positions; of a robot on wheels, whose task tells speeds, its own chain."""
    return "sts3215_wheel" if env_id == "SeaLegs/Drive-v0" else "ideal"


@one_quick
def test_an_environment_survives_pickling(env_id: str) -> None:
    env = gym.make(env_id, actuator=steady(env_id), start_noise=0.01).unwrapped
    again = pickle.loads(pickle.dumps(env))
    assert type(again) is type(env)
    np.testing.assert_array_equal(few_steps(env, 1), few_steps(again, 1))


@pytest.mark.long
@every_environment
def test_a_spec_written_down_makes_the_same_environment(env_id: str) -> None:
    env = gym.make(env_id, actuator=steady(env_id), start_noise=0.01)
    assert env.spec is not None
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    np.testing.assert_array_equal(few_steps(env, 2), few_steps(again, 2))


@pytest.mark.long
@every_environment
def test_a_vector_environment_moves_as_single_ones(env_id: str) -> None:
    many = gym.make_vec(env_id, num_envs=2)
    singles = [gym.make(env_id) for _ in range(2)]
    np.testing.assert_array_equal(many.reset(seed=9)[0], [env.reset(seed=9 + i)[0] for i, env in enumerate(singles)])
    for _ in range(2):
        action = np.asarray(many.action_space.sample())
        observed, rewards, *_ = many.step(action)
        steps = [env.step(action[i]) for i, env in enumerate(singles)]
        np.testing.assert_array_equal(observed, [step[0] for step in steps])
        np.testing.assert_array_equal(rewards, [step[1] for step in steps])


@every_environment
def test_every_render_mode_constructs_without_opening_anything(env_id: str) -> None:
    assert set(gym.make(env_id).metadata["render_modes"]) == {"rgb_array", "human"}
    for mode in ("rgb_array", "human"):
        env = gym.make(env_id, render_mode=mode, width=64, height=48)
        assert env.render_mode == mode
        env.close()
    many = gym.make_vec(env_id, num_envs=2, render_mode="rgb_array")
    assert many.render_mode == "rgb_array"
    many.close()


@every_environment
def test_the_signature_and_the_documented_arguments_are_those_of_the_task(env_id: str) -> None:
    kind = type(single(gym.make(env_id)))
    shown = inspect.signature(kind).parameters
    assert kind.__name__ == f"{env_id.partition('/')[2].partition('-')[0]}Env"
    assert {"actuator", "randomization", "params", "control_rate", "render_mode"} <= set(shown)
    assert {item.name for item in dataclasses.fields(kind.task)} <= set(shown)
    table = (kind.__doc__ or "").partition("## Arguments")[2]
    rows = re.findall(r"^\| `(\w+)` \| [^|]+ \| `([^`]*)` \| (.+) \|$", table, re.MULTILINE)
    documented = {name: ast.literal_eval(value) for name, value, _ in rows}
    assert documented == {name: item.default for name, item in shown.items()}


@every_environment
def test_the_vector_environment_has_the_same_arguments(env_id: str) -> None:
    one = inspect.signature(type(single(gym.make(env_id)))).parameters
    many = inspect.signature(type(gym.make_vec(env_id, num_envs=1).unwrapped)).parameters
    assert set(many) == {*one, "num_envs", "max_episode_steps"}
    assert all(many[name] == item for name, item in one.items())


@every_environment
def test_model_and_data_can_be_read_and_move_nothing(env_id: str) -> None:
    env, untouched = gym.make(env_id), gym.make(env_id)
    env.reset(seed=1)
    untouched.reset(seed=1)
    inner = single(env)
    assert isinstance(inner.model, mujoco.MjModel)
    np.testing.assert_array_equal(inner.data.qpos, inner.engine.batch.bind("qpos")[0])
    body = inner.data.xpos[1].copy()
    inner.data.qpos[:] = 100.0
    action = constant(env, 0.5)
    np.testing.assert_array_equal(env.step(action)[0], untouched.step(action)[0])
    assert np.isfinite(body).all() and inner.data.time > 0.0
    many = gym.make_vec(env_id, num_envs=2).unwrapped
    assert isinstance(many, BatchVectorEnv)
    many.reset(seed=1)
    many.action_space.seed(1)
    many.step(many.action_space.sample())  # some robots all begin at rest in one place
    assert (many.data(0).qpos != many.data(1).qpos).any() and many.model.nu == inner.model.nu


@pytest.mark.parametrize(
    ("argument", "meant"),
    [("actuatr", "actuator"), ("sped", "speed"), ("widht", "width"), ("contol_rate", "control_rate")],
)
def test_a_mistyped_argument_of_make_gets_a_suggestion(argument: str, meant: str) -> None:
    makers: tuple[Any, ...] = (gym.make, gym.make_vec)
    for make in makers:
        with pytest.raises(SealegsError, match=f"no argument '{argument}' .did you mean '{meant}'"):
            make("SeaLegs/Hopper-v0", **{argument: 1.0})


@pytest.mark.long
@every_environment
def test_reward_is_the_sum_of_its_terms_in_info(env_id: str) -> None:
    env = gym.make(env_id)
    env.reset(seed=0)
    for _ in range(5):
        _, reward, _, _, info = env.step(env.action_space.sample())
        assert float(reward) == pytest.approx(sum(v for name, v in info.items() if name.startswith("reward_")))
        assert info["unstable"] is False


@pytest.mark.parametrize("env_id", ("SeaLegs/Hopper-v0", "SeaLegs/Bench-v0", "SeaLegs/Biped-v0"))
def test_the_documented_tables_are_those_of_the_environment(env_id: str) -> None:
    env = single(gym.make(env_id))
    text = type(env).__doc__ or ""
    action_table, observation_table = re.split(r"## Observation Space", text)[:2]
    actions = re.findall(r"\| (\d+) +\| Goal of .*? \| -1 +\| 1 +\| (-?[\d.]+) +\| (-?[\d.]+)", action_table)
    engine = env.engine
    assert [float(low) for _, low, _ in actions] == pytest.approx(engine.goal_centre - engine.goal_half, abs=1e-3)
    assert [float(high) for *_, high in actions] == pytest.approx(engine.goal_centre + engine.goal_half, abs=1e-3)
    observations = re.findall(r"^ *\| (\d+) +\|", observation_table.split("## Rewards")[0], re.MULTILINE)
    assert len(observations) == env.engine.observation_size == len(engine.task.observation_names())


def test_the_hopper_has_the_printed_masses_whatever_drives_it() -> None:
    for chain in ("sv1270tg", "ideal", "sts3215"):
        model = HOPPER.drivetrain(chain).model
        assert model.body_mass.sum() == pytest.approx(0.587, abs=1e-5)
        assert model.body("upper").mass == 0.059
        assert model.body("lower").mass == 0.038


def test_a_motor_of_the_hopper_moves_its_own_link_and_not_the_other() -> None:
    drivetrain = HOPPER.drivetrain("ideal")
    data = mujoco.MjData(drivetrain.model)
    data.qpos[1] = 2.0  # in the air
    drivetrain.model.opt.gravity[:] = 0.0
    goals = {"hip": 0.4, "knee": 0.0}
    data.ctrl[:] = list(goals.values())
    for _ in range(3000):
        mujoco.mj_step(drivetrain.model, data)
    hip, knee = (float(drivetrain.position(name, data.qpos)) for name in ("hip", "knee"))
    assert (hip, knee) == pytest.approx((0.4, 0.0), abs=1e-3)


def test_the_hopper_starts_with_its_foot_at_the_floor() -> None:
    env = gym.make("SeaLegs/Hopper-v0", start_noise=0.0)
    observation, _ = env.reset(seed=0)
    assert observation[1] == pytest.approx(single(env).engine.drivetrain.model.qpos0[1], abs=1e-6)
    assert observation[2:6] == pytest.approx([-0.61, 0.61, -0.61, 0.61], abs=1e-6)


def test_other_rest_angles_move_the_start_and_the_goals() -> None:
    env = gym.make("SeaLegs/Hopper-v0", start_noise=0.0, params={"hip_rest": -0.3, "knee_rest": 0.4})
    observation, _ = env.reset(seed=0)
    assert observation[2:6] == pytest.approx([-0.3, 0.4, -0.3, 0.4], abs=1e-6)
    assert observation[1] == pytest.approx(single(env).engine.drivetrain.model.qpos0[1], abs=1e-6)
    assert observation[12:14] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert single(env).engine.goal_centre == pytest.approx([-0.3, 0.4])


def test_several_robots_and_chains_in_one_process_do_not_disturb_each_other() -> None:
    def run(env: gym.Env, steps: int = 10) -> np.ndarray:
        env.reset(seed=3)
        return np.concatenate([env.step(constant(env, 0.3))[0] for _ in range(steps)])

    choices = [
        ("SeaLegs/Hopper-v0", "sv1270tg"),
        ("SeaLegs/Hopper-v0", {"hip": "ideal"}),
        ("SeaLegs/Bench-v0", "sts3215"),
        ("SeaLegs/Bench-v0", [{"ideal": {"stiffness": 5.0, "damping": 0.1}}]),
    ]
    alone = [run(gym.make(env_id, actuator=chain)) for env_id, chain in choices]
    together = [gym.make(env_id, actuator=chain) for env_id, chain in choices]
    for env in together:
        env.reset(seed=3)
    rows = [[env.step(constant(env, 0.3))[0] for env in together] for _ in range(10)]
    for number, expected in enumerate(alone):
        np.testing.assert_array_equal(np.concatenate([row[number] for row in rows]), expected)


def test_the_encoder_that_the_host_sees_is_that_of_the_chain() -> None:
    chain = [{"ideal": {"stiffness": 5.0, "damping": 0.1}}, {"encoder": {"ticks": 256, "offset": 0.1}}]
    env = gym.make("SeaLegs/Bench-v0", actuator=chain)
    env.reset(seed=0)
    observation = env.step(np.array([0.2], np.float32))[0]
    tick = 2.0 * np.pi / 256
    assert observation[2] / tick == pytest.approx(round(observation[2] / tick), abs=1e-4)
    assert observation[2] == pytest.approx(observation[1] + 0.1, abs=tick)


@pytest.mark.parametrize(
    ("keywords", "sentence"),
    [
        ({"actuator": "sv1270"}, "no actuator 'sv1270' .*did you mean 'sv1270tg'"),
        ({"actuator": {"hop": "ideal"}}, "drives no 'hop' .*did you mean 'hip'"),
        ({"params": {"upper_lenght": 0.1}}, "no parameter 'upper_lenght' .*did you mean 'upper_length'"),
        ({"params": {"total_mass": -1.0}}, "total_mass is -1.0; it must be a number between"),
        ({"params": {"total_mass": np.inf}}, "total_mass is inf; it must be a number between"),
        ({"control_rate": 300.0}, "control_rate is 300 Hz"),
        ({"control_rate": 0.0}, "control_rate is 0 Hz"),
        ({"control_rate": "fast"}, "control_rate is 'fast'; it must be a finite number"),
        ({"action_delay": float("nan")}, "action_delay is nan; it must be a finite number"),
        ({"action_delay": None}, "action_delay is None; it must be a finite number"),
        ({"speed": "fast"}, "speed takes a number or a pair"),
        ({"alive_weight": [0, 1]}, "alive_weight takes a number"),
        ({"render_mode": "rgb"}, "no render_mode 'rgb' .*did you mean 'rgb_array'"),
        ({"id": "SeaLegs/Biped-v0", "hopping": [0, 1]}, "hopping takes a number"),
        (
            {"id": "SeaLegs/Walk-v0", "cadence": -2.0},
            "cadence is -2 Hz; it must be above 0, or 0 for no reference gait",
        ),
        ({"id": "SeaLegs/Walk-v0", "lift": 15.0}, "lift is 15 m; no foot of quadruped is lifted as high as it stands"),
        ({"id": "SeaLegs/Biped-v0", "lift": 0.0}, "lift is 0.0; it must be a height above 0 m"),
        ({"id": "SeaLegs/Hexapod-v0", "actuator": {"leg7_vertical": "ideal"}}, "drives no 'leg7_vertical'"),
        ({"id": "SeaLegs/Hexapod-v0", "params": {"ratio": 0.5}}, "ratio is 0.5"),
        (
            {"id": "SeaLegs/Hexapod-v0", "params": {"stance_height": 0.5, "stance_radius": 0.75}},
            "cannot reach their stance",
        ),
    ],
)
def test_a_wrong_argument_is_answered_in_one_sentence(keywords: dict, sentence: str) -> None:
    with pytest.raises(SealegsError, match=sentence):
        gym.make(**({"id": "SeaLegs/Hopper-v0", "disable_env_checker": True} | keywords)).reset()


def test_a_file_of_chains_by_joint_drives_these_joints(tmp_path: Path) -> None:
    stiff = [{"ideal": {"stiffness": 50.0, "damping": 1.0, "armature": 0.01}}]
    path = tmp_path / "legs.yaml"
    path.write_text(yaml.safe_dump({"kn*": stiff}))
    chains = get_robot("hopper").drivetrain(str(path)).chains
    assert "ideal" in str(chains["knee"]) and chains["hip"] == load_chain("sv1270tg")
    path.write_text(yaml.safe_dump({"ankle": stiff}))
    with pytest.raises(SealegsError, match="drives no 'ankle'"):
        get_robot("hopper").drivetrain(str(path))


def test_an_unknown_robot_is_answered_with_the_nearest_name() -> None:
    with pytest.raises(SealegsError, match=r"no robot 'hoper' .did you mean 'hopper'"):
        get_robot("hoper")


@pytest.mark.parametrize(
    ("robot", "paper"),
    [("bench", "paper 004"), ("hopper", "paper 004"), ("biped", "paper 003"), ("hexapod", "paper 001")],
)
def test_every_number_of_a_robot_has_a_source_and_lies_within_its_bounds(robot: str, paper: str) -> None:
    for name, number in get_robot(robot).numbers.items():
        assert number.source and number.low <= number.value <= number.high, name
        assert number.assumed or number.source.startswith(paper), name


def test_the_bench_is_a_point_mass_on_a_uniform_rod() -> None:
    mass, arm_mass, length = 0.4, 0.1, 0.2
    model = get_robot("bench").drivetrain("ideal", {"mass": mass, "arm_mass": arm_mass, "length": length}).model
    data = mujoco.MjData(model)
    data.qpos[0] = np.pi / 2
    mujoco.mj_forward(model, data)
    inertia = np.empty((1, 1))
    mujoco.mj_fullM(model, data, inertia)
    assert inertia[0, 0] == pytest.approx(mass * length**2 + arm_mass * length**2 / 3.0, rel=1e-6)
    assert data.qfrc_bias[0] == pytest.approx(9.81 * (mass + 0.5 * arm_mass) * length, rel=1e-6)


def test_a_number_of_a_task_means_what_the_task_above_it_says_unless_it_says_otherwise() -> None:
    @dataclasses.dataclass(frozen=True)
    class Closer(ReachTask):
        start_noise: float = 0.5
        tolerance: float = option(0.1, "how near", "m")
        calm_weight: float = 1.0

    known = arguments(SingleEnv, Closer)
    assert known["start_noise"] == Argument(float, 0.5, "see Starting State")
    assert known["tolerance"] == Argument(float, 0.1, "how near [m]")
    assert known["calm_weight"].doc == "see Rewards"
    assert "| `tolerance` | float | `0.1` | how near [m] |\n" in table(known)


# --- pictures show the robot, follow it, and say in one sentence why there are none ----------------------------------


@pytest.mark.long
@pytest.mark.rendering
@pytest.mark.parametrize("env_id", ["SeaLegs/Hopper-v0", "SeaLegs/Bench-v0"])
def test_a_picture_shows_the_robot_in_front_of_the_sky(env_id: str) -> None:
    env = gym.make(env_id, render_mode="rgb_array", width=160, height=120)
    env.reset(seed=0)
    picture = env.render()
    assert isinstance(picture, np.ndarray)
    assert picture.shape == (120, 160, 3)
    assert picture.dtype == np.uint8
    assert (picture.max(axis=2) < 90).mean() > 0.005  # dark parts of the robot
    assert picture[:10].mean() > 150  # sky
    env.close()


@pytest.mark.long
@pytest.mark.rendering
def test_the_camera_follows_the_hopper() -> None:
    env = gym.make("SeaLegs/Hopper-v0", render_mode="rgb_array", width=160, height=120)
    env.reset(seed=0)
    near = env.render()
    inner = env.unwrapped
    assert isinstance(inner, SingleEnv)
    inner.engine.batch.qpos[0, 0] += 3.0
    env.render()
    far = env.render()
    assert isinstance(near, np.ndarray)
    assert isinstance(far, np.ndarray)
    dark = [(picture.max(axis=2) < 90).mean() for picture in (near, far)]
    assert dark[1] == pytest.approx(dark[0], rel=0.3)
    env.close()


@pytest.mark.long
@pytest.mark.rendering
def test_drawing_does_not_change_the_motion() -> None:
    drawn, blind = (
        gym.make("SeaLegs/Hopper-v0", render_mode=mode, width=64, height=48) for mode in ("rgb_array", None)
    )
    for env in (drawn, blind):
        env.reset(seed=0)
    for _ in range(5):
        drawn.render()
        action = np.array([0.3, -0.3], np.float32)
        np.testing.assert_array_equal(drawn.step(action)[0], blind.step(action)[0])
    drawn.close()


@pytest.mark.rendering
def test_sb3_gets_a_picture_of_each_simulation() -> None:
    env = BatchVecEnv("SeaLegs/Hopper-v0", 2, seed=0, render_mode="rgb_array", width=64, height=48)
    env.reset()
    images = env.get_images()
    assert [image.shape for image in images if image is not None] == [(48, 64, 3)] * 2
    env.close()


def test_a_window_without_a_screen_is_refused_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    env = gym.make("SeaLegs/Bench-v0", render_mode="human", disable_env_checker=True)
    with pytest.raises(SealegsError, match="no screen"):
        env.reset(seed=0)


@pytest.mark.rendering
@pytest.mark.long
def test_gymnasiums_recorder_films_an_episode(tmp_path: Path) -> None:
    env = gym.make("SeaLegs/Bench-v0", render_mode="rgb_array", width=64, height=48, max_episode_steps=5)
    recorder = RecordVideo(env, str(tmp_path / "film"), episode_trigger=lambda episode: episode == 0)
    recorder.reset(seed=0)
    while not recorder.step(recorder.action_space.sample())[3]:
        pass
    recorder.close()
    (film,) = (tmp_path / "film").glob("*.mp4")
    frames = imageio.mimread(film)
    assert len(frames) == 6 and frames[0].shape == (48, 64, 3)
