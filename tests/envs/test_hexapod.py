"""The hexapod is AMRU5 as printed, moves as its equations say, and keeps the contract of environments."""

from __future__ import annotations

import re
from pathlib import Path

import gymnasium as gym
import mujoco
import numpy as np
import pytest
import sealegs  # noqa: F401 registers
from sealegs.actuators import load_chain, load_chain_set
from sealegs.actuators.layout import S_CURRENT, S_TORQUE, S_VOLTAGE
from sealegs.common.errors import SealegsError
from sealegs.envs.engine.vector import SingleEnv
from sealegs.envs.hexapod import gait as modulated
from sealegs.envs.hexapod.env import HexapodEnv, HexapodTask
from sealegs.envs.hexapod.gait import MODULATED, PERIOD, Tripod
from sealegs.envs.hexapod.kinematics import Joints, foot_from_joints, joints_from_foot, leg_angle, link_angles, stance
from sealegs.envs.hexapod.parameters import GOAL_RANGE, LEGS
from sealegs.envs.hexapod.robot import FRICTIONS, HEXAPOD, KINDS, chains_of, coordinate, foot, loop_joints, total_mass
from sealegs.envs.robots import get_robot

from tests.typed import typed

REPOSITORY = Path(__file__).resolve().parents[2]
ENV = "SeaLegs/Hexapod-v0"
VALUES = HEXAPOD.parameters()


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return HEXAPOD.drivetrain().model


def at(model: mujoco.MjModel, joints: Joints) -> mujoco.MjData:
    """The robot with leg 1 at given coordinates, its loops closed by equations (9) and (10)."""
    data = mujoco.MjData(model)
    for kind in KINDS:
        data.joint(coordinate(1, kind)).qpos[:] = getattr(joints, kind)
    rise, bend = link_angles(VALUES, joints.vertical, joints.horizontal)
    for name, angle in zip(loop_joints(1), (rise, np.pi - bend, np.pi - bend), strict=True):
        data.joint(name).qpos[:] = angle
    mujoco.mj_forward(model, data)
    return data


def test_masses_and_inertias_are_those_of_table_10(model: mujoco.MjModel) -> None:
    assert total_mass(VALUES) == pytest.approx(34.447, abs=1e-3)  # "a weight of 34 kg"
    assert model.body_mass.sum() == pytest.approx(total_mass(VALUES), abs=2e-3)
    assert model.body("body").mass == pytest.approx(8.215)
    assert model.body("body").inertia == pytest.approx(np.array([1063.0, 1198.0, 843.0]) * 1e-4)
    rotor = 0.06e-4
    for kind, gear in (("rotation", "rotation_gear"), ("vertical", "screw_gear"), ("horizontal", "screw_gear")):
        armature = model.dof_armature[model.joint(coordinate(3, kind)).dofadr[0]]
        assert armature == pytest.approx(rotor * VALUES[gear] ** 2)


@pytest.mark.parametrize(
    ("rotation", "vertical", "horizontal"), [(0.0, 0.038, 0.045), (0.2, 0.03, 0.05), (-0.25, 0.047, 0.04)]
)
def test_the_loops_close_and_the_foot_is_where_the_equations_put_it(
    model: mujoco.MjModel, rotation: float, vertical: float, horizontal: float
) -> None:
    joints = Joints(rotation, vertical, horizontal)
    data = at(model, joints)
    gaps = data.efc_pos[: data.ne]
    assert np.abs(gaps).max() < 1e-12
    x, y, z = foot_from_joints(VALUES, joints)
    angle, radius = leg_angle(1), VALUES["leg_radius"]
    ahead, left = radius + float(x), float(y)
    wanted = [ahead * np.cos(angle) - left * np.sin(angle), ahead * np.sin(angle) + left * np.cos(angle), float(z)]
    body = data.body("body").xpos
    assert data.geom(foot(1)).xpos - body == pytest.approx(wanted, abs=1e-9)
    back = joints_from_foot(VALUES, x, y, z)
    assert [float(value) for value in back] == pytest.approx(joints)


def test_a_link_that_rides_on_two_others_moves_them_as_it_would_itself() -> None:
    # kinetic energy of DE, whose mass is spread over D, CF and AC, against that of the rod itself
    heavy = HEXAPOD.parameters({"de_mass": 0.2, "de_inertia_y": 20e-4, "de_inertia_z": 20e-4})
    light = HEXAPOD.parameters({"de_mass": 0.1, "de_inertia_y": 7e-4, "de_inertia_z": 7e-4})
    energies = []
    step = 1e-6
    joints = Joints(0.0, 0.035, 0.047)
    moved = Joints(0.0, 0.035 + 0.4 * step, 0.047 - 0.7 * step)
    for values in (heavy, light):
        compiled = HEXAPOD.build(values).compile()
        first, second = at(compiled, joints), at(compiled, moved)
        mujoco.mj_differentiatePos(compiled, first.qvel, step, first.qpos, second.qpos)
        compiled.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
        mujoco.mj_forward(compiled, first)
        energies.append(first.energy[1])

    def rod(mass: float, inertia: float) -> float:
        """Energy of a rod from D parallel to AC, by its middle and its turning."""
        ends = []
        for q in (joints, moved):
            rise, _ = link_angles(VALUES, q.vertical, q.horizontal)
            length = (VALUES["ratio"] - 1.0) * VALUES["ab_length"]
            ends.append((q.horizontal + 0.5 * length * np.cos(rise), 0.5 * length * np.sin(rise), rise))
        speed = (np.array(ends[1]) - np.array(ends[0])) / step
        return 0.5 * mass * (speed[0] ** 2 + speed[1] ** 2) + 0.5 * inertia * speed[2] ** 2

    assert energies[0] - energies[1] == pytest.approx(rod(0.2, 20e-4) - rod(0.1, 7e-4), rel=1e-3)


def test_feet_stand_on_the_ground_as_deep_as_printed(model: mujoco.MjModel) -> None:
    from sealegs.papers.hexapod.paper import penetration_on

    assert penetration_on(3, 0.8) == pytest.approx(0.0023, abs=1e-4)
    assert penetration_on(6, 0.8) == pytest.approx(0.0023 * 0.5 ** (2.0 / 3.0), rel=0.05)  # Hertz


def test_the_gait_is_a_tripod_with_double_stance_at_the_printed_speed() -> None:
    gait = Tripod()
    time = np.arange(0.0, 2.0 * gait.cycle, PERIOD)
    air = np.stack([gait.in_transfer(leg, time) for leg in range(LEGS)])
    assert gait.cycle == 12.0
    assert (air[0::2] == air[0]).all() and (air[1::2] == air[1]).all()
    assert not (air[0] & air[1]).any()
    standing = ~(air[0] | air[1])
    assert standing.mean() == pytest.approx(2.0 * gait.double_stance, abs=3e-3)
    ahead, height = gait.foot(0, time)
    speed = np.gradient(ahead, PERIOD)
    inside = ~air[0] & ~np.roll(air[0], 2) & ~np.roll(air[0], -2)
    assert speed[inside] == pytest.approx(-0.015, rel=1e-6)
    assert (height[~air[0]] == 0.0).all() and height.max() == pytest.approx(gait.lift, rel=1e-3)
    goals = gait.goals(VALUES, time)
    limits = np.array([HEXAPOD.limits[item.name] for item in HEXAPOD.coordinates])
    assert (goals > limits[:, 0]).all() and (goals < limits[:, 1]).all()
    assert np.abs(np.diff(goals, axis=0)).max(axis=0)[2::3].min() > 0.0  # horizontal joints always move


def test_the_joint_friction_is_one_word_and_all_else_is_the_same() -> None:
    kinds = {name: chains_of(file) for name, file in FRICTIONS.items()}
    for joint in ("leg0_rotation", "leg5_vertical", "leg2_horizontal"):
        others = {str(chains[joint].without_stage("friction").to_list()) for chains in kinds.values()}
        assert len(others) == 1
        assert kinds["none"][joint].find("friction") is None
        dry, lugre = kinds["dry/viscous"][joint].find("friction"), kinds["LuGre"][joint].find("friction")
        assert (dry.coulomb, dry.viscous, dry.slip_speed) == (lugre.coulomb, lugre.viscous, 1e-4)
        assert (lugre.bristle_stiffness, lugre.bristle_damping, lugre.lugre) == (1e9, 0.02, 1.0)
    assert kinds["LuGre"]["leg0_vertical"].value("friction.stribeck_velocity") == 1e-4
    assert kinds["dry/viscous 2"]["leg0_horizontal"].value("friction.load") > 0.0
    motor = kinds["LuGre"]["leg0_vertical"]
    assert motor.value("position_pi.period") == PERIOD
    assert motor.value("gear.ratio") == VALUES["screw_gear"]
    loss = motor.value("dc_motor.resistance") / motor.value("dc_motor.motor_constant") ** 2
    assert loss == pytest.approx(VALUES["winding_loss"], rel=1e-3)


def test_a_set_of_chains_is_refused_where_one_is_needed() -> None:
    assert set(load_chain_set("amru5_lugre") or {}) == {f"*_{kind}" for kind in KINDS}
    assert load_chain_set("sts3215") is None
    with pytest.raises(SealegsError, match="put it on a robot that has such joints"):
        load_chain("amru5_lugre")


# --- the environment -------------------------------------------------------------------------------------------------


def test_the_documented_tables_are_those_of_the_environment() -> None:
    env = gym.make(ENV).unwrapped
    assert isinstance(env, SingleEnv)
    engine, text = env.engine, HexapodEnv.__doc__ or ""
    actions, observations = text.split("## Observation Space")[:2]
    rows = re.findall(r"^ *\| (\d) +\|.*?\|" + r" (-?[\d.]+) +\|" * 4 + r" (.+?) +\|$", actions, re.MULTILINE)
    assert [int(row[0]) for row in rows] == list(range(6))
    for row, (*numbers, unit) in zip(rows, MODULATED.values(), strict=True):
        assert [float(value) for value in row[1:5]] == pytest.approx(numbers, abs=1e-4)
        assert row[5] == unit
    last = re.findall(r"^ *\| (?:\d+-)?(\d+) +\|", observations.split("## Rewards")[0], re.MULTILINE)[-1]
    assert int(last) + 1 == engine.observation_size == len(engine.task.observation_names())


def test_it_starts_on_its_feet_and_walks() -> None:
    env = gym.make(ENV, start_noise=0.0, actuator="amru5_lugre")
    observation, _ = env.reset(seed=0)
    assert observation[49:55] == pytest.approx(np.ones(6))
    for _ in range(5):
        observation, reward, terminated, _, info = env.step(np.zeros(6, np.float32))
        assert not terminated
        assert sum(value for name, value in info.items() if name.startswith("reward_")) == pytest.approx(reward)
    assert observation[1] == pytest.approx(0.28, abs=0.003)
    assert info["reward_forward"] > 0.9
    assert -1.5 < info["reward_resistance"] < -0.5  # 0.3 times the specific resistance, about 2.8 over a cycle


def test_standing_costs_nothing_to_speak_of() -> None:
    env = gym.make(ENV, start_noise=0.0, speed=0.0)
    env.reset(seed=0)
    for _ in range(2):
        _, _, terminated, _, info = env.step(np.zeros(6, np.float32))
    assert not terminated
    assert info["reward_resistance"] > -0.05


@pytest.mark.long
@pytest.mark.parametrize("word", ["ideal", "regression", "net", "amru5_dry", "amru5_load", "amru5_frictionless"])
def test_it_stands_with_every_actuator_by_one_word(word: str) -> None:
    env = gym.make(ENV, actuator=word, start_noise=0.0, speed=0.0)
    env.reset(seed=0)
    for _ in range(2):
        observation, _, terminated, _, info = env.step(np.zeros(6, np.float32))
    assert not terminated and not info["unstable"]
    assert observation[1] == pytest.approx(0.28, abs=0.01)


def test_action_zero_is_the_reference_gait() -> None:
    gait, speed = Tripod(0.03), np.array([0.03])
    middle = np.array([0.5 * sum(HEXAPOD.limits[item.name]) for item in HEXAPOD.coordinates])
    memory = modulated.begin(VALUES, np.zeros(1), middle[None])
    count = round(2.0 * gait.cycle / PERIOD)
    goals = [modulated.advance(VALUES, np.zeros((1, 6)), speed, memory)[0] for _ in range(count)]
    wanted = gait.goals(VALUES, PERIOD * np.arange(1, count + 1))
    step = np.abs(np.diff(wanted, axis=0)).max(axis=0)  # a foot lifts off from where it stood, up to a period before
    settled = slice(round(gait.cycle / PERIOD), None)
    assert (np.abs(np.array(goals) - wanted)[settled].max(axis=0) <= step + 1e-12).all()


@pytest.mark.long
def test_feet_that_stand_keep_their_distances_whatever_the_action() -> None:
    rng = np.random.default_rng(0)
    middle = np.array([0.5 * sum(HEXAPOD.limits[item.name]) for item in HEXAPOD.coordinates])
    memory = modulated.begin(VALUES, np.zeros(1), middle[None])
    speed, jumps = np.array([0.03]), []
    before, action = middle, np.zeros((1, 6))
    for k in range(1500):
        if k % 20 == 0:
            action = rng.uniform(-1.0, 1.0, (1, 6))
        goals = modulated.advance(VALUES, action, speed, memory)[0]
        for leg in range(LEGS):
            x0, y0, z0 = foot_from_joints(VALUES, Joints(*before[3 * leg : 3 * leg + 3]))
            x1, y1, z1 = foot_from_joints(VALUES, Joints(*goals[3 * leg : 3 * leg + 3]))
            angle, ground = leg_angle(leg), VALUES["foot_radius"] - VALUES["stance_height"]
            moved = np.array([x1 - x0, y1 - y0])
            ahead = moved[0] * np.cos(angle) - moved[1] * np.sin(angle)
            left = moved[0] * np.sin(angle) + moved[1] * np.cos(angle)
            if max(abs(z0 - ground), abs(z1 - ground)) < 1e-9:
                assert ahead == pytest.approx(-0.03 * PERIOD, abs=1e-4)
                assert left == pytest.approx(0.0, abs=1e-4)
            jumps.append(np.hypot(ahead, left))
        before = goals
    assert max(jumps) < 0.006  # 0.6 m/s: no foot in the air is asked to jump


@pytest.mark.long
def test_feet_that_stand_stay_within_the_ranges_of_their_joints_whatever_the_action() -> None:
    middle, count = np.array([value for _ in range(6) for value in stance(VALUES)]), 200
    reach = np.array([GOAL_RANGE[kind] for kind in KINDS])
    random = np.random.default_rng(0)
    memory = modulated.begin(VALUES, random.random(count), np.tile(middle, (count, 1)))
    speed, worst = np.where(np.arange(count) % 2, 0.03, -0.02), np.zeros(3)
    for step in range(2000):
        if step % 400 == 0:
            action = random.uniform(-1.6, 1.6, (count, 6)).clip(-1.0, 1.0)  # many at an end of their range
        goals = modulated.advance(VALUES, action, speed, memory).reshape(count, 6, 3)
        over = np.abs(goals - middle.reshape(6, 3)) - reach
        standing = goals[..., 1] > middle[1] - 1e-6
        worst = np.maximum(worst, np.where(standing[..., None], over, -np.inf).max(axis=(0, 1)))
    assert worst[0] < 0.01 and worst[2] < 1e-4, "a little in a support in which the action changes"


@pytest.mark.long
def test_the_power_that_the_task_counts_is_that_of_the_motors() -> None:
    env = gym.make(ENV, start_noise=0.0).unwrapped
    assert isinstance(env, SingleEnv)
    engine = env.engine
    env.reset(seed=0)
    addresses = np.array([engine.drivetrain.state_addresses[name] for name in engine.names])
    data = engine.batch.bind("userdata")
    for _ in range(5):
        env.step(np.zeros(6, np.float32))
        torque, drawn = data[:, addresses + S_TORQUE], data[:, addresses + S_CURRENT] * data[:, addresses + S_VOLTAGE]
        assert isinstance(engine.task, HexapodTask)
        power = engine.task.power(engine.numbers, torque, engine.motion(np.zeros((1, 6))).motor_speed)
        assert power == pytest.approx(np.maximum(drawn, 0.0).sum(axis=1), rel=0.03, abs=0.2)


def test_every_episode_may_draw_friction_mass_and_floor_anew() -> None:
    randomization = {
        "leg0_vertical": {"friction.coulomb": [80.0, 140.0]},
        "mass": {"body": [0.9, 1.2]},
        "floor": {"friction": [0.5, 1.0]},
    }
    env = gym.make_vec(ENV, num_envs=2, randomization=randomization)
    env.reset(seed=0)
    drawn = env.unwrapped.engine.drawn  # type: ignore[attr-defined]
    assert 80.0 <= drawn["leg0_vertical.friction.coulomb"][0] != drawn["leg0_vertical.friction.coulomb"][1] <= 140.0
    env.step(np.zeros((2, 6), np.float32))


def test_the_robot_is_known_by_name() -> None:
    assert get_robot("hexapod") is HEXAPOD
    assert float(stance(VALUES).vertical) == pytest.approx((0.28 - 0.015) / 7.0)


@pytest.mark.long
def test_a_short_training_runs(tmp_path: Path) -> None:
    small = [
        "total_timesteps=8",
        "n_envs=2",
        "agent.n_steps=4",
        "agent.batch_size=8",
        "evaluate.every=0",
        "evaluate.episodes=1",
        "video.seconds=0",
    ]
    done = typed("train", "env=hexapod", "actuator=ideal", *small, f"out={tmp_path}", "name=small")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "small" / "final" / "model.zip").is_file()
