"""The biped keeps Gymnasium's contract, its printed numbers, the laws of its cable differentials, and its gaits."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import mujoco
import numpy as np
import pytest
import sealegs  # noqa: F401 registers
from sealegs.actuators import Drivetrain, load_chain
from sealegs.agents.policy_files import load_policy, mean_reward
from sealegs.agents.policy_graph import task_parts
from sealegs.commands import train
from sealegs.common.errors import SealegsError
from sealegs.configs.script import run as run_script
from sealegs.envs.biped.drive import DRIVES, SPRING_RATIO, position_chain, torque_chain
from sealegs.envs.biped.env import BipedTask, sole_places, sole_speeds, soles
from sealegs.envs.biped.gait import HoppingGait, WalkingGait
from sealegs.envs.biped.kinematics import centre_of_mass, feet, place, robot_mass, segments
from sealegs.envs.biped.robot import BIPED, TORSO, coordinate, foot
from sealegs.envs.contract import goal_scale, random_motion, robot_hash
from sealegs.envs.engine.batch import BatchEngine
from sealegs.envs.engine.task import Motion

from benchmarks.learned import Biped
from benchmarks.rollouts import at_own_step, walk
from tests.quick import quick

BIPED_ID = "SeaLegs/Biped-v0"
WORDS = ("ideal", "regression", "net", "mabel")
NAMES = [item.name for item in BIPED.coordinates]


@pytest.mark.parametrize("word", WORDS)
def test_one_word_chooses_what_drives_the_legs(word: str) -> None:
    env = gym.make_vec(BIPED_ID, num_envs=4, actuator=word)
    env.reset(seed=0)
    for _ in range(15):
        observation, _, _, _, infos = env.step(np.tile([-0.2, -0.3, 0.2, -0.3], (4, 1)))
    assert np.isfinite(observation).all() and not infos["unstable"].any()
    assert (observation[:, 1] > 0.7).all(), "it stands, or falls slowly"


def test_walking_pays_for_the_foot_in_the_air_whose_turn_it_is_and_hopping_for_both() -> None:
    def gait(hopping: float, shapes: tuple[float, float], height: float, time: float = 0.6) -> float:
        engine = BatchEngine(BipedTask(hopping=hopping), 1)
        engine.reset()
        engine.steps[:] = round(time / engine.dt)
        engine.batch.bind("qpos")[:] = 0.0
        qpos = engine.batch.bind("qpos")
        for side, shape in zip(("left", "right"), shapes, strict=True):
            engine.drivetrain.set_position(coordinate(side, "leg_shape"), qpos, np.array([shape]))
            engine.drivetrain.set_position(coordinate(side, "leg_angle"), qpos, np.array([0.0]))
        qpos[:, 1] = height
        motion = engine.motion(np.zeros((1, len(engine.action_names))))
        return float(engine.task.rewards(motion)["reward_gait"][0])

    both_down, one_up, both_up = ((0.1, 0.1), 0.9951), ((0.1, 0.5), 0.9951), ((0.1, 0.1), 1.2)
    assert gait(0.0, *one_up) > 0.4 and gait(0.0, *one_up, time=0.1) < -0.4
    assert gait(0.0, *both_up) == gait(0.0, *both_down) == pytest.approx(0.0, abs=0.01)
    assert gait(1.0, *both_up) > 0.4 and gait(1.0, *one_up) == pytest.approx(0.0, abs=0.01)


def test_soles_slide_as_they_move_less_what_their_round_feet_roll() -> None:
    numbers = BIPED.parameters()
    forward, height, pitch = np.array([0.3]), np.array([0.95]), np.array([0.1])
    link, rates, dt = np.array([[-0.2, 0.3, 0.4, 0.15]]), np.array([[0.7, -0.4, 0.2, 0.9]]), 1e-6
    speed, turning = np.array([0.5]), np.array([-0.3])
    before = sole_places(numbers, forward, height, pitch, link)
    after = sole_places(numbers, forward + speed * dt, height, pitch + turning * dt, link + rates * dt)
    shins = segments(turning, rates)[:, [2, 4]]
    wanted = (after - before)[..., 0] / dt + numbers["foot_radius"] * shins
    np.testing.assert_allclose(sole_speeds(numbers, speed, pitch, link, turning, rates), wanted, atol=1e-5)
    np.testing.assert_allclose(before[..., 1], soles(numbers, height, pitch, link))


def test_a_foot_that_slides_on_the_floor_costs_what_it_is_told_to() -> None:
    paid = BatchEngine(BipedTask(correction=0.4, slip_weight=2.0), 1)
    paid.seed(0)
    paid.reset()
    slips = [float(paid.step(np.zeros((1, 4))).terms["reward_slip"][0]) for _ in range(30)]
    assert min(slips) < -0.05 and max(slips) <= 0.0
    free = BatchEngine(BipedTask(correction=0.4), 1)
    free.reset()
    assert "reward_slip" not in free.step(np.zeros((1, 4))).terms


def test_a_foot_that_is_lifted_further_than_it_needs_costs_what_it_is_told_to() -> None:
    """A walker lifted one foot by 105 and the other by 133 mm, and hops of 3 mm earned as much as hops of none."""
    terms = []
    for lift in (0.05, 0.005):
        engine = BatchEngine(BipedTask(correction=0.4, clearance_weight=1.5, lift=lift), 1)
        engine.seed(0)
        engine.reset()
        terms.append([engine.step(np.zeros((1, 4))).terms for _ in range(30)])
    low, high = ([float(step["reward_clearance"][0]) for step in steps] for steps in terms)
    assert min(low) > min(high) and min(high) < -1.5 and max(high) <= 0.0
    gaits = [max(float(step["reward_gait"][0]) for step in steps) for steps in terms]
    assert 0.0 < gaits[0] < gaits[1] <= 0.5
    free = BatchEngine(BipedTask(correction=0.4), 1)
    free.reset()
    assert "reward_clearance" not in free.step(np.zeros((1, 4))).terms


def test_the_chains_in_the_library_are_the_printed_numbers_at_the_leg() -> None:
    for name in NAMES:
        stored, built = load_chain(f"mabel_{name}"), position_chain(name)
        assert [stage.name for stage in stored.stages] == [stage.name for stage in built.stages]
        for mine, other in zip(stored.stages, built.stages, strict=True):
            assert mine.parameters() == pytest.approx(other.parameters(), rel=1e-5)


def test_the_model_weighs_and_balances_as_its_links_do() -> None:
    drivetrain = BIPED.drivetrain("ideal")
    model, values = drivetrain.model, BIPED.parameters()
    data = mujoco.MjData(model)
    link = np.array([-0.2, 0.3, 0.4, 0.15])
    for column, side in ((0, "left"), (2, "right")):
        drivetrain.set_position(coordinate(side, "leg_shape"), data.qpos, link[column + 1])
        drivetrain.set_position(coordinate(side, "leg_angle"), data.qpos, link[column])
    data.qpos[1:3] = 1.1, 0.2
    mujoco.mj_forward(model, data)
    hip = np.array([data.qpos[0], data.qpos[1]])
    body = model.body(TORSO).id
    assert model.body_subtreemass[body] == pytest.approx(robot_mass(values), abs=1e-6)
    angles = segments(0.2, link)
    assert data.subtree_com[body, [0, 2]] == pytest.approx(hip + place(centre_of_mass(values), angles), abs=1e-9)
    for end, side in zip(feet(values), ("left", "right"), strict=True):
        assert data.geom(foot(side)).xpos[[0, 2]] == pytest.approx(hip + place(end, angles), abs=1e-9)


def test_the_boom_weighs_on_the_hip_by_its_lever_and_resists_by_its_inertia() -> None:
    values = BIPED.parameters()
    model = BIPED.drivetrain("ideal").model
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    weight = values["boom_mass"] * values["boom_centre"] / values["boom_length"]
    felt = values["boom_inertia"] / values["boom_length"] ** 2
    gravity = data.qfrc_bias[1] - data.qfrc_passive[1]
    assert gravity == pytest.approx(9.81 * (robot_mass(values) + weight), rel=1e-4)
    mass = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    assert mass[0, 0] == pytest.approx(robot_mass(values) + felt, rel=1e-6)


def test_leg_coordinates_are_mean_and_half_difference_of_thigh_and_shin() -> None:
    drivetrain = BIPED.drivetrain("ideal")
    qpos = np.zeros(drivetrain.model.nq)
    thigh, shin = 0.5, -0.1
    qpos[drivetrain.model.joint("left_hip").qposadr[0]] = thigh
    qpos[drivetrain.model.joint("left_knee").qposadr[0]] = shin - thigh
    assert drivetrain.position("left_leg_angle", qpos, "link") == pytest.approx(0.5 * (thigh + shin))
    assert drivetrain.position("left_leg_shape", qpos, "link") == pytest.approx(0.5 * (thigh - shin))


def _one_leg(without: tuple[str, ...] = ()) -> tuple[Drivetrain, mujoco.MjData]:
    """The left leg's drives on a leg whose torso is held and that feels no gravity."""
    spec = BIPED.build_spec()
    chains = {}
    for name in NAMES:
        chain = torque_chain(name)
        for stage in ("offset", *without):
            chain = chain.without_stage(stage)
        chains[name] = chain
    drivetrain = Drivetrain(spec, chains, BIPED.coordinates)
    model = drivetrain.model
    model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    data.qpos[1] = 3.0
    for side in ("left", "right"):
        drivetrain.set_position(coordinate(side, "leg_shape"), data.qpos, 0.4)
        drivetrain.set_position(coordinate(side, "leg_angle"), data.qpos, 0.0)
    for joint in ("hip_x", "hip_z", "torso_pitch", "right_hip", "right_knee"):
        model.dof_armature[model.joint(joint).dofadr[0]] = 1e6
    return drivetrain, data


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_torque_at_the_shape_winds_the_spring_one_way_and_meets_the_stop_the_other(sign: float) -> None:
    drivetrain, data = _one_leg()
    model, torque = drivetrain.model, 60.0
    knee, motor, spring = (
        model.joint(name).id for name in ("left_knee", "left_leg_shape_motor", "left_leg_shape_spring")
    )
    model.dof_armature[model.jnt_dofadr[motor]] = 1e6  # the motor is held
    data.qfrc_applied[model.jnt_dofadr[knee]] = -sign * torque / 2.0  # the shape is minus half the knee
    for _ in range(3000):
        mujoco.mj_step(model, data)
    drive = DRIVES["left_leg_shape"]
    stretch = sign * torque / (drive.cable_stiffness * drive.ratio**2)
    deflection = sign * torque / (drive.spring_stiffness * SPRING_RATIO**2) if sign > 0 else 0.0
    assert data.qpos[model.jnt_qposadr[spring]] == pytest.approx(deflection, rel=0.02, abs=5e-4)
    shape = float(drivetrain.position("left_leg_shape", data.qpos, "link"))
    assert shape - 0.4 == pytest.approx(stretch + deflection, rel=0.03, abs=5e-4)


def test_without_cable_stretch_motor_and_leg_angle_are_one_and_spring_and_motor_share_the_shape() -> None:
    drivetrain, data = _one_leg(("compliance",))
    data.ctrl[:2] = 5.0, 20.0
    for _ in range(200):
        mujoco.mj_step(drivetrain.model, data)
    spring = float(data.joint("left_leg_shape_spring").qpos[0])
    for name, between in (("left_leg_angle", 0.0), ("left_leg_shape", spring)):
        motor, link = (float(drivetrain.position(name, data.qpos, side)) for side in ("motor", "link"))
        assert link - motor == pytest.approx(between, abs=1e-9)
    assert abs(float(drivetrain.position("left_leg_angle", data.qpos, "link"))) > 0.01


def test_a_torque_command_reaches_the_motor_over_its_constant() -> None:
    speeds = []
    for without in ((), ("scale",)):
        drivetrain, data = _one_leg(without)
        data.ctrl[:] = 30.0
        mujoco.mj_step(drivetrain.model, data)
        speeds.append([float(drivetrain.speed(name, data.qvel)) for name in NAMES])
    constants = [DRIVES[name].motor_constant for name in NAMES]
    assert np.array(speeds[1]) / np.array(speeds[0]) == pytest.approx(constants, rel=1e-6)


def test_a_spring_and_a_compliance_need_something_between_them() -> None:
    command, spring, cable = (
        {"torque_command": {"armature": 1.0}},
        {"stiffness": 10.0},
        {"compliance": {"stiffness": 9.0}},
    )
    with pytest.raises(SealegsError, match="the same element"):
        load_chain([command, {"spring": spring}, cable])
    with pytest.raises(SealegsError, match="needs an inertia that meets its stop"):
        load_chain([command, {"spring": spring | {"unilateral": 1}}])
    load_chain([command, {"spring": spring | {"inertia": 0.1, "unilateral": 1}}, cable])


def test_a_pulley_too_light_for_the_step_is_refused() -> None:
    chain = torque_chain("left_leg_shape").with_value("spring.inertia", 1e-4)
    with pytest.raises(SealegsError, match=r"unstable at a step of 0.001 s"):
        BIPED.drivetrain({"left_leg_shape": chain})


@pytest.mark.long
def test_a_short_training_runs_with_the_printed_drives_and_can_be_read_back(tmp_path: Path) -> None:
    small = ["n_envs=2", "agent.n_steps=32", "agent.batch_size=64", "agent.n_epochs=1", "total_timesteps=128"]
    quiet = ["evaluate.every=64", "evaluate.episodes=1", "checkpoint.every=64", "video.seconds=0"]
    arguments = ["env=biped", "env.hopping=1", *small, *quiet, f"out={tmp_path}", "name=short"]
    assert run_script(train.main, "train", "", arguments) == 0
    description = json.loads((tmp_path / "short" / "final" / "policy.json").read_text())
    assert description["env"]["id"] == BIPED_ID and description["env"]["hopping"] == 1.0
    assert np.isfinite(mean_reward(tmp_path / "short" / "final", "ideal", episodes=1))


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
    act, description = load_policy(folder)
    env = {**at_own_step(description["env"]), "speed": Biped.judged}
    figures = walk(env, description["actuators"], act, starts=2, seconds=8.0)
    assert figures["falls"] == 0.0
    assert 0.4 < figures["slowest [m/s]"] < 0.8
    assert figures["share on one foot"] > 0.4  # about half of it in seeds 1 and 4
