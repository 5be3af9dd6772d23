"""Tasks that any robot has, tasks in a user's own file, how their episodes start, and what a changed source does."""

from __future__ import annotations

import json
import math
import pickle
import shutil
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import pytest
import sealegs
from gymnasium.utils.env_checker import check_env as check_gymnasium
from sealegs.actuators import Chain, Drivetrain, load_chain
from sealegs.actuators.stages import ChainError
from sealegs.actuators.turning import apart
from sealegs.agents.config import read_config
from sealegs.common.errors import SealegsError
from sealegs.envs import registered_id
from sealegs.envs.any_robot.drive import DriveTask, rolling
from sealegs.envs.any_robot.track import TrackTask
from sealegs.envs.contract import make_contract, start_pose, task_of
from sealegs.envs.engine.batch import BatchEngine
from sealegs.envs.engine.sb3 import BatchVecEnv
from sealegs.envs.robots import get_robot
from sealegs.hw.virtual.machine import Machine
from stable_baselines3.common.env_checker import check_env as check_sb3

from testbed.wheel import Wheel, simulate
from tests.agents.test_train import SMALL, run

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


ARM_MODEL = Path(__file__).parents[1] / "robots" / "arm.xml"
TASK = """
from dataclasses import dataclass
import numpy as np
from sealegs.envs.any_robot.reach import ReachTask

@dataclass(frozen=True)
class Mine(ReachTask):
    episode_steps = 10

    def {method}:
        return {gives}
"""


@pytest.mark.parametrize(
    ("method", "gives", "sentence"),
    [
        ("rewards(self, motion)", "{'r': 1.0}", "Mine.rewards gives 1.0 as 'r'; give an array with one number per sim"),
        ("rewards(self, motion)", "{'r': motion.link}", r"Mine.rewards gives an array of the shape \(2, 2\) as 'r'"),
        ("rewards(self, motion)", "motion.time", "gives an array of the shape .*; it gives a dict of terms by name"),
        ("failed(self, motion)", "False", "Mine.failed gives False; give an array of bool"),
        ("observe(self, motion)", "[motion.time]", "Mine.observe gives 1 numbers, and observation_names names 8"),
        ("observe(self, motion)", "[0.0]", "Mine.observe gives 0.0 as part 0; give arrays with one number"),
    ],
)
def test_what_a_task_gives_in_a_wrong_shape_is_told(method: str, gives: str, sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(TASK.format(method=method, gives=gives))
    env = sealegs.make_env(f"{path}:Mine", 2, robot=str(ARM_MODEL))
    with pytest.raises(SealegsError, match=sentence):
        env.reset(seed=0)
        env.step(np.zeros((2, 2), np.float32))
    env.close()


def test_the_tasks_of_a_file_are_those_that_it_defines(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(TASK.format(method="rewards(self, motion)", gives="{}"))
    with pytest.raises(SealegsError, match=r"has no Mime \(did you mean 'Mine'\?\); its tasks are Mine\."):
        sealegs.make_env(f"{path}:Mime", robot=str(ARM_MODEL))


CHANGED_TASK = """
from dataclasses import dataclass
from sealegs.envs.any_robot.reach import ReachTask

@dataclass(frozen=True)
class Mine(ReachTask):
    episode_steps = 50
"""


def begun(folder: Path, task: str = "") -> Path:
    """A run of an arm of its own, perhaps with a task of its own, stopped at step 128."""
    for name in ("arm.xml", "arm.yaml"):
        shutil.copy(ROBOTS / name, folder / name)
    small = [item for item in SMALL if item != "env=bench"]
    asked = [f"env={folder / 'mine.py'}:Mine"] if task else []
    if task:
        (folder / "mine.py").write_text(task)
    arguments = [*asked, f"robot={folder / 'arm.yaml'}", f"out={folder}", "name=run", "total_timesteps=128"]
    assert run(*small, *arguments) == 0
    return folder / "run"


def changed(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "old", "new"),
    [("arm.xml", 'mass="0.1"', 'mass="0.2"'), ("arm.yaml", "timestep: 0.002", "timestep: 0.001")],
)
def test_a_run_does_not_go_on_with_another_robot(tmp_path: Path, capsys, name: str, old: str, new: str) -> None:
    folder = begun(tmp_path)
    changed(tmp_path / name, old, new)
    assert run(f"resume={folder}", "total_timesteps=256") == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert f"{tmp_path / name} has changed since {folder} began" in error and "start a new run" in error
    changed(tmp_path / name, new, old)
    assert run(f"resume={folder}", "total_timesteps=256") == 0


@pytest.mark.long
def test_a_run_does_not_go_on_with_another_task(tmp_path: Path, capsys) -> None:
    folder = begun(tmp_path, CHANGED_TASK)
    changed(tmp_path / "mine.py", "50", "60")
    assert run(f"resume={folder}", "total_timesteps=256") == 2
    assert f"{tmp_path / 'mine.py'} has changed since" in capsys.readouterr().err


@pytest.mark.long
def test_servos_and_comments_of_a_robot_may_change_in_a_run(tmp_path: Path) -> None:
    folder = begun(tmp_path)
    changed(tmp_path / "arm.yaml", "joints:", "# mounted on Monday\ndeploy: {}\njoints:")
    assert run(f"resume={folder}", "total_timesteps=256") == 0


@pytest.mark.long
def test_a_run_of_an_earlier_version_goes_on(tmp_path: Path) -> None:
    folder = begun(tmp_path)
    (folder / "sources.json").unlink()
    changed(tmp_path / "arm.xml", 'mass="0.1"', 'mass="0.2"')
    assert run(f"resume={folder}", "total_timesteps=256") == 0


DOG = """<mujoco><compiler angle="radian" autolimits="true"/><worldbody><geom type="plane" size="5 5 0.1"/>
<body name="trunk" pos="0 0 0.5">{base}<geom type="box" size="0.1 0.05 0.03" mass="2"/>
<body name="thigh" pos="0 0.07 0"><joint name="hip" axis="0 1 0" range="-1 1" damping="0.1"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.15" size="0.02" mass="0.2"/></body>
<body name="tail" pos="-0.1 0 0"><joint {tail} axis="0 1 0" stiffness="1" damping="0.01"/>
<geom type="capsule" fromto="0 0 0 -0.1 0 0" size="0.01" mass="0.05"/></body></body></worldbody>
<actuator><position joint="hip" kp="30" kv="1"/></actuator>
<keyframe>{key}</keyframe></mujoco>"""
HOME = '<key name="low" qpos="0 0 0.1 1 0 0 0 0 0"/><key name="home" qpos="1 2 0.25 2 0 0 2 0.2 0.4"/>'
NAMES = {"named": ('<freejoint name="root"/>', 'name="wag"'), "nameless": ("<freejoint/>", "")}


def dog(folder: Path, names: str = "named", key: str = HOME) -> Path:
    base, tail = NAMES[names]
    path = folder / "dog.xml"
    path.write_text(DOG.format(base=base, tail=tail, key=key))
    return path


def start(path: Path, task: str = "track") -> np.ndarray:
    """Positions at the start of an episode: seven of the base, the hip, the tail."""
    env = sealegs.make_env(task, robot=str(path))
    env.reset(seed=0)
    return np.array(env.unwrapped.data.qpos)


@pytest.mark.parametrize("task", ["track", "reach"])
@pytest.mark.parametrize("names", NAMES)
def test_the_base_and_a_joint_that_nothing_drives_start_as_in_the_keyframe_home(
    task: str, names: str, tmp_path: Path
) -> None:
    """A dog that its file stands at a height of 0.25 m fell on it from 0.5 m."""
    found = start(dog(tmp_path, names), task)
    np.testing.assert_allclose(found[:7], [1.0, 2.0, 0.25, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    assert found[8] == 0.4 and found[7] == pytest.approx(0.2, abs=0.45)


@pytest.mark.parametrize("key", ["", '<key name="home" qpos="0 0 0.25"/>'])
def test_without_a_keyframe_of_the_robots_size_the_base_starts_where_the_file_has_it(key: str, tmp_path: Path) -> None:
    found = start(dog(tmp_path, key=key))
    np.testing.assert_allclose(found[:7], [0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("names", NAMES)
def test_a_virtual_machine_stands_where_the_episodes_of_its_policy_start(names: str, tmp_path: Path) -> None:
    """Of a base without a name, asking where it stands ended in a traceback."""
    path = dog(tmp_path, names)
    robot = get_robot(path)
    chains = {name: load_chain(chain).to_list() for name, chain in robot.chains_for(None).items()}
    contract = make_contract({"id": "SeaLegs/Reach-v0", "robot": str(path)}, chains, 50.0)
    machine = Machine(robot, pose=start_pose(contract))
    np.testing.assert_allclose(machine.data.qpos[:7], [1.0, 2.0, 0.25, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)], atol=1e-9)


def test_a_base_that_the_yaml_sets_on_a_stand_stays_where_the_file_has_it(tmp_path: Path) -> None:
    dog(tmp_path)
    path = tmp_path / "stand.yaml"
    path.write_text("model: dog.xml\nbase: fixed\njoints: {hip: {chain: sts3215}}\n")
    assert start(path)[1] == 0.4 and len(start(path)) == 2


# --- wheels: chains that are told speeds, and driving as commanded with a robot of data alone ------------------------

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
