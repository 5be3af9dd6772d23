"""What training disturbs: forces, grounds and delays; IMUs and switches as they sense."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import sealegs
import yaml
from scipy.spatial.transform import Rotation
from sealegs.common.errors import SealegsError
from sealegs.envs.any_robot.reach import ReachTask
from sealegs.envs.any_robot.stand import Standing
from sealegs.envs.any_robot.user import user_id
from sealegs.envs.any_robot.walk import WalkTask
from sealegs.envs.contract import task_of
from sealegs.envs.engine import turns
from sealegs.envs.engine.batch import BatchEngine
from sealegs.envs.engine.imu import Imu, Spread
from sealegs.envs.engine.keyed import key_of
from sealegs.envs.engine.sb3 import BatchVecEnv
from sealegs.envs.hexapod.env import HexapodTask
from sealegs.envs.robots import get_robot

from tests.logged_robots import FEET, SWITCHES, switched

ALL = {
    "mass": {"all": [0.9, 1.1]},
    "centre": {"trunk.x": [-0.01, 0.01]},
    "gravity": {"strength": [9.7, 9.9]},
    "floor": {"friction": [0.5, 1.0], "slope": [0.0, 0.1]},
    "push": {"speed": [0.1, 0.3], "interval": [0.1, 0.2]},
    "noise": {"reading": [0.0, 0.01], "tilt": [0.0, 0.02], "turn_rate": [0.0, 0.1]},
    "bias": {"reading": [0.0, 0.02], "tilt": [0.0, 0.03], "turn_rate": [0.0, 0.03]},
    "lost": {"goals": [0.0, 0.3], "readings": [0.0, 0.3]},
    "delay": {"goals": [0.0, 0.05]},
}


def blind() -> WalkTask:
    """Walking of our quadruped without its IMU, which has noise of its own."""
    return WalkTask.on(replace(get_robot("quadruped"), imu=None))(start_noise=0.0)


def started(count: int, randomization: Any, task: Any = None) -> BatchEngine:
    engine = BatchEngine(task or blind(), count, randomization=randomization, autoreset=False)
    engine.seed(0)
    engine.reset()
    return engine


def seen(engine: BatchEngine, steps: int, action: float = 0.0) -> np.ndarray:
    """Observations (steps, n, size) under a constant action."""
    actions = np.full((engine.num_envs, len(engine.names)), action)
    return np.array([engine.step(actions).observation for _ in range(steps)])


def test_disturbed_simulations_move_alike_alone_and_in_a_batch() -> None:
    given = {"cadence": 2.5, "lift": 0.02, "randomization": ALL}
    many = BatchVecEnv("SeaLegs/Walk-v0", 3, seed=5, **given)
    singles = [sealegs.make_env("walk", **given) for _ in range(3)]
    np.testing.assert_array_equal(many.reset(), [env.reset(seed=5 + k)[0] for k, env in enumerate(singles)])
    random = np.random.default_rng(0)
    for _ in range(20):
        action = random.uniform(-0.3, 0.3, (3, 12)).astype(np.float32)
        many.step_async(action)
        observed, *_ = many.step_wait()
        np.testing.assert_array_equal(observed, [env.step(action[k])[0] for k, env in enumerate(singles)])


@pytest.mark.parametrize(
    ("name", "columns"), [("reading", slice(9, 21)), ("turn_rate", slice(6, 9)), ("tilt", slice(3, 5))]
)
def test_noise_is_new_in_every_step_and_a_bias_lasts_an_episode(name: str, columns: slice) -> None:
    plain, noisy, biased = (
        seen(started(8, change), 70)[20:, :, columns]
        for change in (None, {"noise": {name: [0.02, 0.02]}}, {"bias": {name: [0.02, 0.02]}})
    )
    noise, bias = noisy - plain, biased - plain
    assert noise.std() == pytest.approx(0.02, rel=0.1) and abs(noise.mean()) < 2e-3
    assert abs(np.corrcoef(noise[:-1].ravel(), noise[1:].ravel())[0, 1]) < 0.1
    assert np.ptp(bias, axis=0).max() < 1e-3 and 0.015 < np.abs(bias).max() < 0.0205
    assert len(np.unique(bias[0].round(5))) > 8


def test_a_policy_sees_the_noise_and_the_simulation_moves_without_it() -> None:
    plain, noisy = (started(2, change) for change in (None, {"noise": {"reading": [0.1, 0.1], "tilt": [0.1, 0.1]}}))
    assert (seen(plain, 20) != seen(noisy, 20)).any()
    np.testing.assert_array_equal(plain.batch.bind("qpos"), noisy.batch.bind("qpos"))


def test_pushes_come_once_an_interval_and_change_the_speed_of_the_base() -> None:
    engine = started(1, {"push": {"speed": [0.4, 0.4], "interval": [0.5, 0.5]}})
    qvel, jumps = engine.batch.bind("qvel"), []
    for _ in range(100):
        before = np.hypot(*qvel[0, :2])
        seen(engine, 1)
        jumps.append(np.hypot(*qvel[0, :2]) - before > 0.1)
    assert sum(jumps) == 4 and set(np.diff(np.flatnonzero(jumps))) == {25}


def test_lost_goals_leave_the_servos_where_they_were_and_lost_readings_the_host() -> None:
    engine = started(1, {"lost": {"goals": [1.0, 1.0]}})
    before = engine.batch.bind("ctrl").copy()
    seen(engine, 5, 0.5)
    np.testing.assert_array_equal(engine.batch.bind("ctrl"), before)
    found = seen(started(1, {"lost": {"readings": [1.0, 1.0]}}), 20, 0.5)[:, 0, 9:21]
    np.testing.assert_array_equal(found, np.broadcast_to(found[0], found.shape))
    half = seen(started(1, {"lost": {"readings": [0.5, 0.5]}, "noise": {"reading": [0.01, 0.01]}}), 200)[:, 0, 9:21]
    assert (np.diff(half, axis=0) == 0.0).mean() == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("delay", [0.0, 0.006, 0.02, 0.034])
def test_goals_come_as_late_as_drawn(delay: float) -> None:
    drawn = started(1, {"delay": {"goals": [delay, delay]}})
    ctrl, start = drawn.batch.bind("ctrl"), drawn.batch.bind("ctrl").copy()
    steps = 0
    while (ctrl == start).all():
        seen(drawn, 1, 0.5)
        steps += 1
    assert steps == int(delay / drawn.dt + 1e-9) + 1
    if delay < drawn.dt:
        fixed = BatchEngine(blind(), 1, action_delay=delay, autoreset=False)
        fixed.seed(0)
        fixed.reset()
        again = started(1, {"delay": {"goals": [delay, delay]}})
        np.testing.assert_array_equal(seen(fixed, 10, 0.5), seen(again, 10, 0.5))


def test_a_slope_tilts_the_floor_and_the_robot_stands_on_it() -> None:
    engine = started(6, {"floor": {"slope": [0.15, 0.15], "friction": [1.0, 1.0]}})
    gravity = engine.reset()[:, 3:6]
    start = engine.batch.bind("qpos")[:, :3].copy()
    np.testing.assert_allclose(np.arccos(-gravity[:, 2]), 0.15, atol=1e-4)
    seen(engine, 50)
    assert len(np.unique(gravity[:, 0].round(2))) > 3  # any way
    assert np.linalg.norm(engine.batch.bind("qpos")[:, :3] - start, axis=1).max() < 0.03  # it does not slide


def test_gravity_and_centres_of_mass_are_as_drawn() -> None:
    engine = started(3, {"gravity": {"strength": [5.0, 15.0]}, "centre": {"trunk.x": [-0.02, 0.02]}})
    seen(engine, 50)
    feet = tuple(name for name in engine.world.touchable() if name.endswith("shank"))
    forces = engine.world.contact_force(feet).sum(axis=1)[:, 2]
    np.testing.assert_allclose(forces, 1.318 * engine.drawn["gravity.strength"], rtol=0.03)
    model, batch = engine.drivetrain.model, engine.batch
    shift = batch.expand("body_ipos")[:, model.body("trunk").id] - model.body("trunk").ipos
    np.testing.assert_allclose(shift[:, 0], engine.drawn["centre.trunk.x"])
    np.testing.assert_allclose(shift[:, 1:], 0.0)


def test_encoders_of_any_robot_are_noisy_and_a_gait_generator_takes_no_delays() -> None:
    change = {"noise": {"reading": [0.05, 0.05]}}
    assert np.std(seen(started(2, change, ReachTask()), 50)[:, :, 1]) > 0.04
    with pytest.raises(SealegsError, match="gives goals more often than actions"):
        started(1, {"delay": {"goals": [0.0, 0.01]}}, HexapodTask())


ROUGH: dict[str, Any] = {"floor": {"rough": [0.0, 0.03], "steps": [0.01, 0.02], "friction": [0.4, 0.9]}}
STANDING: dict[str, Any] = {"forward": 0.0, "sideways": 0.0, "turn": 0.0, "start_noise": 0.0}


def on_floor(count: int, floor: dict[str, Any] | None, **arguments: Any) -> BatchEngine:
    engine = BatchEngine(WalkTask(**arguments), count, randomization=floor, autoreset=False)
    engine.seed(0)
    engine.reset()
    return engine


def standing(engine: BatchEngine) -> Standing:
    assert isinstance(engine.task, WalkTask)
    return engine.task.stance


def ground_under(engine: BatchEngine, simulation: int, x: float, y: float) -> float:
    """Height of the ground in a place [m], by a ray from above."""
    data, model = engine.look(simulation, mujoco.MjData(engine.drivetrain.model)), engine.seen
    base = int(model.jnt_bodyid[0])
    found = np.zeros(1, np.int32)
    groups, way = np.ones(6, np.uint8), np.array([0.0, 0.0, -1.0])
    away = mujoco.mj_ray(model, data, np.array([x, y, 1.0]), way, groups, 1, base, found)
    return 1.0 - away


@pytest.mark.parametrize(("kind", "length"), [("rough", 0.5), ("steps", 0.5)])
def test_the_ground_where_an_episode_starts_is_as_uneven_as_it_drew(kind: str, length: float) -> None:
    engine = on_floor(40, {"floor": {kind: [0.0, 0.04]}}, **STANDING)
    spread = []
    for number in range(engine.num_envs):
        x, y = engine._qpos[number, :2]
        places = np.linspace(-length, length, 9)
        spread.append(np.ptp([ground_under(engine, number, x + a, y + b) for a in places for b in places]))
    drawn = engine.drawn[f"floor.{kind}"]
    assert np.corrcoef(drawn, spread)[0, 1] > 0.8
    assert (np.array(spread) < drawn + 0.006).all()  # a metre further on it is a little rougher


def test_robots_start_above_uneven_ground_and_come_to_stand_on_it() -> None:
    engine = on_floor(12, ROUGH, **STANDING)
    assert not engine.step(np.zeros((12, 12))).terms["reward_collision"].any()
    for _ in range(50):
        assert not engine.step(np.zeros((12, 12))).terminated.any()
    assert (engine.world.touching(standing(engine).feet).sum(axis=1) >= 3).all()
    heights = [ground_under(engine, k, *engine._qpos[k, :2]) for k in range(12)]
    assert max(heights) > 0.005


def test_uneven_ground_has_the_friction_that_was_drawn_and_leans_with_the_slope() -> None:
    engine = on_floor(6, {"floor": {"rough": [0.0, 0.02], "friction": [0.4, 0.9], "slope": [0.1, 0.1]}}, **STANDING)
    terrain = engine.drivetrain.model.geom("terrain").id
    friction = engine.batch.expanded("geom_friction")
    assert friction is not None
    np.testing.assert_array_equal(friction[:, terrain, 0], engine.drawn["floor.friction"])
    for _ in range(50):
        assert not engine.step(np.zeros((6, 12))).terminated.any()
    assert engine.world.touching(standing(engine).feet).any(axis=1).all()
    heights = [ground_under(engine, k, *engine._qpos[k, :2]) for k in range(6)]
    np.testing.assert_allclose(engine._qpos[:, 2] - heights, standing(engine).height, atol=0.02)
    assert np.abs(heights).max() > 0.05


def test_a_picture_shows_the_slope_that_the_robot_stands_on() -> None:
    env = sealegs.make_env("walk", render_mode="rgb_array", randomization={"floor": {"slope": [0.2, 0.2]}})
    env.reset(seed=1)
    engine = env.unwrapped.engine  # pyright: ignore[reportAttributeAccessIssue]
    picture, data = env.render(), env.unwrapped.data  # pyright: ignore[reportAttributeAccessIssue]
    assert isinstance(picture, np.ndarray) and picture.std() > 10.0
    up = data.geom("floor").xmat.reshape(3, 3)[:, 2]
    assert up[2] == pytest.approx(np.cos(0.2))
    assert data.body("trunk").xmat.reshape(3, 3)[:, 2] @ up == pytest.approx(1.0, abs=1e-6)
    assert engine.seen.geom("floor").quat[0] == pytest.approx(np.cos(0.1))


def test_a_batch_on_uneven_ground_moves_as_single_ones() -> None:
    many = BatchVecEnv("SeaLegs/Walk-v0", 3, seed=5, randomization=ROUGH, command_interval=0.1)
    singles = [sealegs.make_env("walk", randomization=ROUGH, command_interval=0.1) for _ in range(3)]
    np.testing.assert_array_equal(many.reset(), [env.reset(seed=5 + k)[0] for k, env in enumerate(singles)])
    for _ in range(12):
        steps = [env.step(np.zeros(12, np.float32)) for env in singles]
        np.testing.assert_array_equal(many.engine.step(np.zeros((3, 12))).observation, [step[0] for step in steps])


def test_commands_change_when_their_interval_is_over() -> None:
    engine = on_floor(4, None, command_interval=0.2, stand_share=0.0)
    asked = [engine._command.copy()]
    seen = []
    for _ in range(40):
        seen.append(engine.step(np.zeros((4, 12))).observation[:, :3])
        asked.append(engine._command.copy())
    changed = [k for k in range(1, 41) if (asked[k] != asked[k - 1]).any(axis=1).all()]
    assert changed == [10, 20, 30, 40]
    assert all((asked[k] == asked[k - 1]).all() for k in range(1, 41) if k not in changed)
    np.testing.assert_allclose(seen, asked[1:], rtol=1e-6)  # the policy sees the command that is judged next
    assert (np.abs(np.array(asked)[..., 0] - 0.05) <= 0.25).all()


def test_a_command_interval_below_zero_is_refused() -> None:
    with pytest.raises(SealegsError, match="command_interval is -1 s; it must be above 0, or 0 for none"):
        WalkTask(command_interval=-1.0)


def test_a_robot_on_a_fixed_base_has_no_uneven_ground() -> None:
    with pytest.raises(SealegsError, match=r"randomization.floor.rough: the base of the robot is not free"):
        sealegs.make_env("track", robot="bench", randomization={"floor": {"rough": [0.0, 0.1]}})


# --- IMUs and switches ------------------------------------------------------------------------------------------------


ROBOTS = Path(__file__).resolve().parents[1] / "robots"
DOG, STAND = ROBOTS / "dog.yaml", f"{ROBOTS / 'stand.py'}:Stand"
EXACT = Spread(0.0, 0.0)
DT = 0.02


def engine(count: int, seed: int = 0, **imu: Any) -> BatchEngine:
    """Dogs that are to stand, with another IMU than in their file."""
    robot = get_robot(DOG)
    assert robot.imu is not None
    robot = replace(robot, imu=replace(robot.imu, **imu))
    task, arguments = task_of({"id": user_id(STAND), "robot": robot})
    found = BatchEngine(task, count, **arguments)
    found.seed(seed)
    return found


def moved(found: BatchEngine, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """What was observed of the base (steps, n, 6), and what was true after each step."""
    seen, true, random = [], [], np.random.default_rng(1)
    found.reset()
    for _ in range(steps):
        action = random.uniform(-0.6, 0.6, (found.num_envs, len(found.action_names)))
        seen.append(found.step(action).observation[:, :6])
        motion = found.motion(action)
        true.append(np.concatenate([motion.gravity, motion.turn_rate], axis=1))
    return np.array(seen, float), np.array(true)


def test_turns_are_those_of_scipy() -> None:
    random = np.random.default_rng(0)
    a, b, vector = random.normal(size=(20, 4)), random.normal(size=(20, 4)), random.normal(size=(20, 3))
    a, b = (turn / np.linalg.norm(turn, axis=1, keepdims=True) for turn in (a, b))
    first, second = (Rotation.from_quat(turn, scalar_first=True) for turn in (a, b))
    assert turns.applied(a, vector) == pytest.approx(first.apply(vector))
    assert turns.applied(turns.multiply(a, b), vector) == pytest.approx((first * second).apply(vector))
    assert turns.projected_gravity(a) == pytest.approx(first.inv().apply([0.0, 0.0, -1.0]))
    assert turns.to_vector(a) == pytest.approx(first.as_rotvec())
    built = Rotation.from_quat(turns.of_vector(vector), scalar_first=True)
    assert built.as_matrix() == pytest.approx(Rotation.from_rotvec(vector).as_matrix())


def test_without_noise_and_delay_a_fast_imu_says_what_is_true() -> None:
    seen, true = moved(engine(3, noise=EXACT, bias=EXACT, delay=0.0, rate=500.0), 20)
    assert np.abs(seen[..., :3] - true[..., :3]).max() < 0.02  # its newest sample is up to 2 ms old
    assert np.median(np.abs(seen[..., 3:] - true[..., 3:])) < 0.1 * np.median(np.abs(true[..., 3:]))


def test_what_is_observed_is_as_old_as_the_delay_and_the_period_say() -> None:
    seen, true = moved(engine(8, noise=EXACT, bias=EXACT, delay=2.0 * DT, rate=1e3), 60)
    late = [float(np.abs(seen[5:, :, :3] - true[5 - rows : len(true) - rows, :, :3]).mean()) for rows in range(5)]
    assert np.argmin(late) == 2 and late[2] < 0.3 * min(late[1], late[3])


def test_noise_and_bias_have_the_size_of_the_file() -> None:
    found = engine(400, noise=Spread(0.02, 0.3), bias=Spread(0.05, 0.5), delay=0.0)
    found.reset()
    held = np.zeros((400, len(found.action_names)))
    rates = np.array([found.step(held).observation[:, 3:6] for _ in range(12)][2:], float)
    assert rates.mean(axis=0).std() == pytest.approx(0.5, rel=0.15)
    assert rates.std(axis=0, ddof=1).mean() == pytest.approx(0.3, rel=0.15)


def test_a_batch_draws_as_its_single_simulations_do() -> None:
    many, one = engine(4, seed=3), engine(1, seed=5)
    assert np.array_equal(many.reset()[2], one.reset()[0])
    random = np.random.default_rng(0)
    for _ in range(30):
        action = random.uniform(-0.5, 0.5, (4, len(many.action_names)))
        assert np.array_equal(many.step(action).observation[2], one.step(action[2:3]).observation[0])


def test_each_imu_has_a_clock_of_its_own_and_no_sample_comes_early() -> None:
    imu = Imu("base", rate=100.0, delay=0.013)
    keys = key_of(np.random.default_rng(0).random(500))
    number, taken = imu.sample_at(np.full(500, 1.0), keys)
    age = 1.0 - taken
    assert (age >= 0.013 - 1e-9).all() and (age < 0.023 + 1e-9).all() and age.std() == pytest.approx(0.0029, rel=0.1)
    assert (number - imu.sample_at(np.full(500, 0.5), keys)[0] == 50).all()


def test_rewards_and_failures_are_judged_by_the_truth() -> None:
    found = engine(2, bias=Spread(0.0, 50.0))
    found.reset()
    step = found.step(np.zeros((2, len(found.action_names))))
    assert np.abs(step.observation[:, 3:6]).max() > 5.0 and step.terms["reward_still"].min() > -1.0


def test_a_mount_is_of_the_site_and_the_rotation() -> None:
    robot = get_robot(DOG)
    assert robot.imu is not None and robot.imu.joint == "floating_base"
    orientation, rate = robot.imu.raw(np.array([1.0, 0.0, 0.0, 0.0]), np.array([1.0, 2.0, 3.0]))
    assert rate == pytest.approx([2.0, -1.0, 3.0], abs=1e-4), "its x axis is the base's y axis"
    assert robot.imu.of_base(orientation, rate)[1] == pytest.approx([1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("said", "refused"),
    [
        ({"site": "imuu"}, r"dog\.yaml: imu\.site: the model has no site 'imuu' \(did you mean 'imu'\?\)"),
        ({"site": "imu", "body": "trunk"}, "a site and a body"),
        ({"body": "fl2"}, r"joints move body 'fl2' against the base 'trunk'"),
        ({"rate": 0}, r"imu\.rate must be more than 0"),
        ({"noise": {"gyro": 0.1}}, r"imu\.noise\.gyro is unknown"),
        ({"noise": {"turn_rate": -0.1}}, r"imu\.noise holds a standard deviation below 0"),
        ({"rotation": [0, 0, 90]}, r"imu\.rotation is \[0, 0, 90\], more than a turn \(6\.283 rad\); give radians"),
        ({"delay": 20}, r"imu\.delay is 20 s; at most 1 s is taken: give seconds, 20 ms are 0\.02\."),
        ({"delai": 0.1}, r"imu\.delai is unknown \(did you mean 'delay'\?\)"),
    ],
)
def test_an_imu_that_cannot_be_is_refused_in_a_sentence(said: dict[str, Any], refused: str, tmp_path: Path) -> None:
    document = {**yaml.safe_load(DOG.read_text()), "model": str(ROBOTS / "dog.xml"), "imu": said}
    path = tmp_path / "dog.yaml"
    path.write_text(yaml.safe_dump(document))
    with pytest.raises(SealegsError, match=refused):
        get_robot(path)


def test_a_robot_that_stands_fixed_has_nothing_for_an_imu_to_tell(tmp_path: Path) -> None:
    path = tmp_path / "arm.yaml"
    path.write_text(f"model: {ROBOTS / 'arm.xml'}\nimu: {{rate: 50}}\n")
    with pytest.raises(SealegsError, match="this base is fixed; give base: free"):
        get_robot(path)


def test_gravity_of_a_fixed_base_is_refused_in_a_sentence() -> None:
    task, arguments = task_of({"id": user_id(STAND), "robot": "bench"})
    with pytest.raises(SealegsError, match="base is fixed"):
        BatchEngine(task, 1, **arguments).reset()


# --- contact switches in training: closed under force, observed as late as the IMU's board says ----------------------

PLACES = {"shin": {"geom": "fl_shin", "threshold": 0.5}, "sole": {"site": "fl_sole", "threshold": 0.5}}


def walking(path: Path, count: int, **imu: Any) -> BatchEngine:
    """Dogs with a switch on every foot, beside them one on a geom and one on a site."""
    robot = switched(path, switches=SWITCHES | PLACES, **imu)
    found = BatchEngine(WalkTask.on(robot)(switches=True), count, autoreset=False)
    found.seed(0)
    found.reset()
    return found


def pressed(engine: BatchEngine, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Switches as observed and as they are, and the forces on the feet [N] (steps, n, ...), while legs are thrown."""
    seen, true, forces, random = [], [], [], np.random.default_rng(0)
    for _ in range(steps):
        action = random.uniform(-1.0, 1.0, (engine.num_envs, 8))
        seen.append(engine.step(action).observation[:, -6:])
        true.append(engine.motion(action).switches.copy())
        forces.append(np.linalg.norm(engine.world.contact_force([f"{leg}2" for leg in FEET]), axis=2))
    return np.array(seen, float), np.array(true), np.array(forces)


def test_a_switch_is_closed_while_more_than_its_threshold_presses_on_body_geom_or_site(tmp_path: Path) -> None:
    _, true, forces = pressed(walking(tmp_path, 4), 60)
    assert np.array_equal(true[..., :4], forces > 0.5)
    assert 0.1 < true[..., :4].mean() < 0.99, "feet come off the ground"
    assert np.array_equal(true[..., 4], true[..., 0])
    assert true[..., 5].any() and (true[..., 5] <= true[..., 0]).all(), "a site feels no contact outside its shape"


def test_a_policy_observes_switches_as_late_as_delay_and_rate_say(tmp_path: Path) -> None:
    seen, true, _ = pressed(walking(tmp_path, 4, delay=0.04, rate=1000), 60)
    off = [np.abs(seen[5:] - true[5 - rows : len(true) - rows]).mean() for rows in range(5)]
    assert np.argmin(off) == 2 and off[2] < 0.3 * min(off[1], off[3])


def test_the_quadruped_of_the_collection_feels_its_feet_take_turns_in_its_gait() -> None:
    task = WalkTask.on("quadruped")(switches=True, forward=0.2, sideways=0.0, turn=0.0, stand_share=0.0, cadence=2.0)
    names = ("front_left", "front_right", "rear_left", "rear_right")
    assert task.observation_names()[-4:] == tuple(f"contact switch {name} [-]" for name in names)
    engine = BatchEngine(task, 4, autoreset=False)
    engine.seed(0)
    seen = [engine.reset()]
    seen += [engine.step(np.zeros((4, 12))).observation for _ in range(150)]
    closed = np.array(seen[50:], float)[..., -4:]
    assert set(np.unique(closed)) == {0.0, 1.0}
    assert (closed.sum(axis=-1) >= 1.0).mean() > 0.95, "it does not jump"
    alike = np.corrcoef(closed.reshape(-1, 4).T)
    assert alike[0, 3] > 0.1 and alike[1, 2] > 0.1, "feet across swing together"
    assert alike[0, 1] < -0.2 and alike[2, 3] < -0.5, "and in turn with those beside them"


def test_walking_takes_switches_only_where_it_is_asked_for_and_the_robot_has_them(tmp_path: Path) -> None:
    robot = switched(tmp_path)
    assert WalkTask.on(robot)(switches=True).observation_names()[-1] == "contact switch hr_foot [-]"
    assert not any("switch" in name for name in WalkTask.on(robot)().observation_names())
    with pytest.raises(SealegsError, match=r"'small_biped' has no contact switches to observe .* imu: \{switches: "):
        sealegs.make_env("walk", robot="small_biped", switches=True)
    with pytest.raises(SealegsError, match="switches takes true or false, not 1"):
        sealegs.make_env("walk", switches=1)


@pytest.mark.parametrize(
    ("said", "refused"),
    [
        ({"body": "fl3"}, r"imu\.switches\.foot\.body: the model has no body 'fl3' \(did you mean 'fl[12]'\?\)"),
        ({"body": "fl2", "site": "fl_sole"}, r"imu\.switches\.foot needs one place: body, geom or site; it has 2"),
        ({}, "it has 0"),
        ({"body": "fl2", "threshold": 0}, r"imu\.switches\.foot\.threshold must be more than 0"),
        ({"body": "fl2", "treshold": 1}, r"did you mean 'threshold'"),
    ],
)
def test_a_switch_that_cannot_be_is_refused_in_a_sentence(said: dict[str, Any], refused: str, tmp_path: Path) -> None:
    with pytest.raises(SealegsError, match=refused):
        switched(tmp_path, switches={"foot": said})


def test_a_place_that_touches_nothing_is_refused(tmp_path: Path) -> None:
    robot = switched(tmp_path)
    path = tmp_path / "dog.xml"
    path.write_text(path.read_text().replace('name="fl_shin"', 'name="fl_shin" contype="0" conaffinity="0"'))
    assert robot.file is not None
    with pytest.raises(SealegsError, match="fl2 has no shape that touches anything"):
        get_robot(robot.file.path)
