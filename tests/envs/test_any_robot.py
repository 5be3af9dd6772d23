"""Tasks that any robot has, on robots that a file describes, and tasks in a user's own file."""

import json
import pickle
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import sealegs
from gymnasium.utils.env_checker import check_env as check_gymnasium
from sealegs.agents.config import read_config
from sealegs.common.errors import SealegsError
from sealegs.envs import registered_id
from sealegs.envs.any_robot.track import TrackTask
from sealegs.envs.contract import make_contract, task_of
from sealegs.envs.engine.sb3 import BatchVecEnv
from sealegs.envs.robots import get_robot
from stable_baselines3.common.env_checker import check_env as check_sb3

ROBOTS = Path(__file__).parents[1] / "robots"
ARM = str(ROBOTS / "arm.yaml")
WAITER = f"{ROBOTS / 'waiter.py'}:Waiter"
TASKS = ("SeaLegs/Track-v1", "SeaLegs/Reach-v0", WAITER)


@pytest.mark.parametrize("task", TASKS)
def test_a_robot_of_a_file_passes_the_checks_of_gymnasium_and_sb3(task: str) -> None:
    env = gym.make(registered_id(task), robot=ARM).unwrapped
    assert env.action_space.shape == (2,)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*Box observation space m.*imum value is.*infinity")
        warnings.simplefilter("error", UserWarning)
        warnings.filterwarnings("ignore", message=".*Box observation space m.*imum value is.*infinity")
        check_gymnasium(env, skip_render_check=True)
        check_sb3(env, skip_render_check=True)
    assert type(pickle.loads(pickle.dumps(env))) is type(env)


@pytest.mark.parametrize("task", TASKS)
def test_a_batch_of_it_moves_as_single_ones_and_takes_chains_and_random_numbers(task: str) -> None:
    given = {"robot": ARM, "actuator": {"elbow": "ideal"}, "randomization": {"mass": {"forearm": [0.8, 1.2]}}}
    many = BatchVecEnv(task, 3, seed=5, **given)
    assert many.engine.chains["elbow"].find("ideal") and many.engine.chains["shoulder"].find("dc_motor")
    singles = [sealegs.make_env(task, **given) for _ in range(3)]
    np.testing.assert_array_equal(many.reset(), [env.reset(seed=5 + k)[0] for k, env in enumerate(singles)])
    action = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 2)).astype(np.float32)
    many.step_async(action)
    observed, rewards, *_ = many.step_wait()
    steps = [env.step(action[k]) for k, env in enumerate(singles)]
    np.testing.assert_array_equal(observed, [step[0] for step in steps])
    np.testing.assert_array_equal(rewards, np.array([step[1] for step in steps], np.float32))


def test_following_the_target_is_worth_more_than_standing_still() -> None:
    earned = []
    for follow in (True, False):
        env = sealegs.make_env(
            "track",
            robot=ARM,
            correction=0.0,
            actuator=[{"ideal": {"stiffness": 80.0, "damping": 3.0, "armature": 0.03}}],
        )
        seen, _ = env.reset(seed=1)
        half = np.array([1.5, 2.0])
        total = 0.0
        for _ in range(150):
            seen, reward, *_ = env.step((seen[2:4] / half if follow else np.zeros(2)).astype(np.float32))
            total += reward
        earned.append(total / 150)
    assert earned[0] > 0.4 > earned[1] + 0.2


def test_actions_correct_the_trajectory_and_zero_follows_it() -> None:
    env = sealegs.make_env("track", robot=ARM)
    env.reset(seed=2)
    rewards = [float(env.step(np.zeros(2, np.float32))[1]) for _ in range(100)]
    engine = env.unwrapped.engine  # type: ignore[attr-defined]
    motion = engine.motion(np.zeros((1, 2)))
    assert np.abs(motion.link - engine.task.target(motion.time, motion.command)).max() < 0.35
    assert np.mean(rewards) > 0.2


def tracking_error(env_id: str = "SeaLegs/Track-v1", **given: Any) -> float:
    """Of an action of 0 (rms) [rad]."""
    env = BatchVecEnv(env_id, 8, seed=3, robot="bench", **given)
    env.reset()
    engine, still, squares = env.engine, np.zeros((8, 1)), []
    for _ in range(200):
        engine.step(still)
        motion = engine.motion(still)
        squares.append(np.mean((motion.link - engine.task.target(motion.time, motion.command)) ** 2))  # type: ignore[attr-defined]
    return float(np.sqrt(np.mean(squares)))


@pytest.mark.parametrize("latency", [0.005, 0.045])
def test_goals_lead_the_trajectory_by_what_the_servos_are_late(latency: float) -> None:
    chain: list[Any] = sealegs.load_chain("sts3215").to_list()
    chain[0] = {"delay": {"seconds": latency}}
    late = tracking_error(actuator=chain, lead=0.0)
    assert tracking_error(actuator=chain) < 0.25 * late
    env = BatchVecEnv("SeaLegs/Track-v1", 1, robot="bench", actuator=chain)
    assert env.engine.fitted == {"lead": pytest.approx(0.044 + latency, abs=0.006)}


def test_the_earlier_version_of_the_task_has_actions_that_are_goals() -> None:
    """A policy that was trained in it must not be asked for corrections."""
    task = task_of({"id": "SeaLegs/Track-v0", "robot": ARM})[0]
    command = task.commands(np.full((1, task.draws), 0.5))
    assert task.reference(np.zeros(1), command, {}) is None
    assert task_of({"id": "SeaLegs/Track-v1", "robot": ARM})[0].reference(np.zeros(1), command, {}) is not None


def test_built_in_robots_have_the_tasks_too_and_units_of_slides_are_metres(tmp_path: Path) -> None:
    task = TrackTask.on("hopper")()
    assert task.observation_names()[0] == f"target of {task.names[0]} [rad]"
    from tests.described.test_robot_file import URDF

    (tmp_path / "lift.urdf").write_text(URDF)
    lift = TrackTask.on(tmp_path / "lift.urdf")()
    assert lift.observation_names()[:2] == ("target of rise [m]", "target of grip [rad]")
    assert "motor speed of rise [m/s]" in lift.observation_names()


def test_a_policy_of_it_has_a_contract_that_names_the_robot_by_its_file() -> None:
    robot = get_robot(ARM)
    chains = {item.name: item.chain.to_list() for item in robot.file.joints} if robot.file else {}
    contract = make_contract({"id": "SeaLegs/Track-v0", "robot": ARM}, chains, 50.0)
    assert contract.robot == "arm" and contract.joints == ("shoulder", "elbow")
    assert contract.env["robot"] == ARM


def test_a_training_takes_the_robot_by_one_word_and_the_task_from_a_file() -> None:
    config = read_config([f"robot={ARM}"]).config
    assert config is not None and config.env["id"] == "SeaLegs/Track-v1" and config.env["robot"] == ARM
    config = read_config([f"env={WAITER}", f"robot={ARM}", "env.level=0.1"]).config
    assert config is not None and config.env["id"] == WAITER and config.env["level"] == 0.1


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([f"env={ROBOTS}/none.py:Waiter"], "there is no file .*none.py with a task"),
        ([f"env={ROBOTS}/waiter.py:Waitr"], r"has no Waitr \(did you mean 'Waiter'\?\); its tasks are"),
        ([f"env={ROBOTS}/waiter.py:NotATask"], "NotATask is no task; make it a dataclass"),
        ([f"env={ROBOTS}/waiter.py"], "is no task; a task of your own is given as path/to/task.py:MyTask"),
        ([f"env={WAITER}", "env.levle=1"], r"There is no key 'env.levle' \(did you mean 'env.level'\?\)"),
        (["env=trak"], r"env=trak is not known \(did you mean 'track'\?\)"),
        (["robot=arm.yml"], "there is no robot file .*arm.yml"),
        (["robot=benhc"], r"there is no robot 'benhc' \(did you mean 'bench'\?\)"),
        (["robot=bench", "env=hopper"], "SeaLegs/Hopper-v0 has a robot of its own and takes no robot=bench"),
    ],
)
def test_what_is_wrong_is_told_in_a_sentence(arguments: list[str], sentence: str) -> None:
    with pytest.raises(SealegsError, match=sentence):
        request = read_config(arguments)
        assert request.config is not None
        BatchVecEnv(request.config.env["id"], 1, robot=request.config.env["robot"])


def driven_by(folder: Path, elbow: object) -> str:
    """The arm with a chain of stages on its elbow."""
    text = f"model: {ROBOTS / 'arm.xml'}\njoints: {{shoulder: {{chain: sts3215}}, elbow: {{chain: {elbow}}}}}\n"
    (folder / "driven.yaml").write_text(text)
    return str(folder / "driven.yaml")


@pytest.mark.parametrize("task", TASKS)
def test_goals_of_a_task_do_not_act_as_torques(task: str, tmp_path: Path) -> None:
    """Goals between -2 and 2 rad acted as N.m, and episodes began with a torque as large as the position."""
    own = driven_by(tmp_path, [{"torque_command": {"armature": 0.01}}])
    says = (
        r"the chain of joint 'elbow' takes a torque \[N\.m\] as command \(torque_command\), and a task gives position "
        r"goals; name a chain with a position controller, such as ideal .* can be diagnosed, but not trained"
    )
    with pytest.raises(SealegsError, match=says):
        sealegs.make_env(task, robot=own)
    with pytest.raises(SealegsError, match=says):  # as a diagnosis gives its chains
        BatchVecEnv(task, 1, robot=ARM, actuator={"elbow": [{"torque_command": {"armature": 0.01}}]})
    assert BatchVecEnv(task, 1, robot=own, actuator="sts3215").engine.names == ["shoulder", "elbow"]


def test_a_policy_of_torques_gets_no_contract(tmp_path: Path) -> None:
    own = driven_by(tmp_path, [{"torque_command": {}}])
    chains = {name: [{"torque_command": {}}] for name in ("shoulder", "elbow")}
    with pytest.raises(SealegsError, match=r"the chains of joints shoulder, elbow take a torque .* a policy gives"):
        make_contract({"id": "SeaLegs/Track-v0", "robot": own}, chains, 50.0)


def test_a_task_file_that_fails_is_told_with_its_error(tmp_path: Path) -> None:
    (tmp_path / "broken.py").write_text("import nothing_of_the_kind\n")
    with pytest.raises(
        SealegsError, match=r"broken\.py cannot be run: ModuleNotFoundError: No module named 'nothing_of"
    ):
        registered_id(f"{tmp_path / 'broken.py'}:Task")


@pytest.mark.rendering
def test_a_model_file_without_a_camera_of_ours_is_drawn() -> None:
    env = sealegs.make_env("reach", robot=ARM, render_mode="rgb_array", width=80, height=60)
    env.reset(seed=0)
    picture = np.asarray(env.render())
    env.close()
    assert picture.shape == (60, 80, 3) and picture.std() > 5.0


def test_importing_sealegs_stays_light() -> None:
    code = (
        "import sys, json, sealegs; print(json.dumps([m for m in ('numba', 'torch', 'pydantic') if m in sys.modules]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == []
