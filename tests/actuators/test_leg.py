"""The leg of SILO4: its equations are those of the paper and the engine's, its friction is that of the tables."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from sealegs.actuators import Drivetrain, load_chain
from sealegs.actuators.law import begin, torque
from sealegs.actuators.layout import P_STATE_SIZE, S_LIMIT
from sealegs.actuators.stages import ChainError
from sealegs.actuators.stages.meshing import fallen
from sealegs.envs.leg import inertia, kinematics
from sealegs.envs.leg.env import LegTask
from sealegs.envs.leg.robot import JOINTS, LEG, chains_of
from sealegs.envs.robots import get_robot
from sealegs.papers.leg import dynamics

VALUES = LEG.parameters()
RPM = math.pi / 30.0


def states(count: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(0)
    return random.uniform(-math.pi, math.pi, (count, 3)), random.uniform(-3.0, 3.0, (count, 3))


def engine_terms(
    params: dict[str, float], q: np.ndarray, speed: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass matrix without rotors, Coriolis and centrifugal torque, gravity torque of MuJoCo's model."""
    drivetrain = LEG.drivetrain("ideal", params)
    model, data = drivetrain.model, mujoco.MjData(drivetrain.model)
    mass, turning, weight = np.zeros((len(q), 3, 3)), np.zeros(q.shape), np.zeros(q.shape)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:] = q[k], 0.0
        mujoco.mj_forward(model, data)
        weight[k] = data.qfrc_bias
        mujoco.mj_fullM(model, data, mass[k])
        data.qvel[:] = speed[k]
        mujoco.mj_forward(model, data)
        turning[k] = data.qfrc_bias - weight[k]
    return mass - np.diag(inertia.rotors(LEG.parameters(params))), turning, weight


def test_the_leg_is_a_robot_with_its_printed_chain():
    assert get_robot("leg") is LEG
    assert LEG.chains_for(None) == chains_of("silo4")


def test_table_7_follows_from_table_1_within_what_its_digits_allow():
    ours = dynamics.constants(VALUES).table()
    allowed = dict.fromkeys(ours, 0.01) | {"e": 0.0125, "x": 0.02}  # 0.05 mm of y_cm are 2 % of x
    for key, printed in dynamics.TABLE_VII.items():
        assert ours[key] == pytest.approx(printed, rel=allowed[key]), key


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_symbols_and_engine_agree_to_rounding(sign):
    q, speed = states(40)
    params = {"product_sign": sign}
    k = dynamics.constants(LEG.parameters(params))
    mass, turning, weight = engine_terms(params, q, speed)
    np.testing.assert_allclose(dynamics.mass_matrix(k, q), mass, atol=1e-12)
    np.testing.assert_allclose(dynamics.coriolis(k, q, speed), turning, atol=1e-12)
    np.testing.assert_allclose(dynamics.gravity(k, q), weight, atol=1e-12)


def test_the_printed_form_is_within_one_percent_of_the_engine_at_each_elements_maximum():
    q, speed = states(60)
    k = dynamics.constants(VALUES).as_printed()
    mass, turning, weight = engine_terms({}, q, speed)
    ours = dynamics.mass_matrix(k, q)
    for row, column in ((0, 0), (1, 1), (1, 2), (2, 2)):
        most = np.abs(mass[:, row, column]).max()
        assert np.abs(ours - mass)[:, row, column].max() < 0.01 * most, (row, column)
    assert np.abs(mass[:, 0, 1:]).max() < 0.01 * mass[:, 0, 0].max(), "left out in (36)"
    terms = ((dynamics.coriolis(k, q, speed), turning, 0.04), (dynamics.gravity(k, q), weight, 0.01))
    for mine, engine, bar in terms:  # terms left out in (36) as small are up to 3 % of (40)
        assert (np.abs(mine - engine).max(axis=0) <= bar * np.abs(engine).max(axis=0) + 1e-12).all()


def test_the_coriolis_terms_as_printed_are_not_those_of_the_printed_mass_matrix():
    q, speed = states(200)
    k = dynamics.constants(VALUES).as_printed()
    right = dynamics.coriolis(k, q, speed)
    off = np.abs(dynamics.printed_coriolis(k.table(), q, speed) - right).max(axis=0) / np.abs(right).max(axis=0)
    assert off[0] > 0.01 and off[2] < 1e-9, "h112 lacks b cos(q2), and has g where -2 e belongs"


def test_links_by_the_papers_reading_cannot_exist_and_by_the_tensors_they_can():
    assert [inertia.printed(VALUES, link).possible() for link in (1, 2, 3)] == [False, False, True]
    other = LEG.parameters({"product_sign": -1.0})
    assert all(inertia.printed(other, link).possible() for link in (1, 2, 3))


def test_the_foot_goes_where_the_angles_of_a_point_lead():
    random = np.random.default_rng(1)
    q = random.uniform((-1.2, -0.7, -2.3), (1.2, 0.9, -0.5), (50, 3))
    np.testing.assert_allclose(kinematics.angles(VALUES, kinematics.foot(VALUES, q)), q, atol=1e-9)
    step = 1e-6 * random.normal(size=q.shape)
    moved = kinematics.foot(VALUES, q + step) - kinematics.foot(VALUES, q)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", kinematics.jacobian(VALUES, q), step), moved, atol=1e-11)


def test_friction_is_equation_16_with_three_sines_by_motor_angle_and_direction():
    chain = chains_of("silo4")["joint_3"]
    program = chain.program()
    ratio = 14.0 * 20.5
    for q, w in ((0.3, 0.8), (0.3, -0.8), (-1.1, 0.02), (0.7, -0.01)):
        state = np.zeros(int(program[P_STATE_SIZE]))
        begin(program, state, 0.0, q, q, w)
        torque(program, state, 0.0, q, q, w, 0.0, True)
        angle, rpm = q * ratio, abs(w) * ratio / RPM
        if w > 0.0:
            static, coulomb, stribeck, viscous = 8.58, 7.106, 28.18, 0.0134
            first, second, third = 0.3, 0.576 * math.exp(-1.27e-4 * rpm), 0.133 * math.exp(-5.28e-5 * rpm)
        else:
            static, coulomb, stribeck, viscous = 9.41, 7.909, 26.58, 0.0138
            first, second, third = 0.3, 0.526 * math.exp(-1.12e-4 * rpm), 0.152 * math.exp(-7.49e-6 * rpm)
        mean = coulomb + (static - coulomb) * math.exp(-rpm / stribeck) + viscous * rpm
        ripple = first * math.sin(angle / 287.0 + math.pi / 2.0) + second * math.sin(angle / 14.0 + math.pi / 2.0)
        ripple += third * math.sin(angle + math.pi)
        assert state[S_LIMIT] == pytest.approx(1e-3 * ratio * (mean + ripple), rel=1e-4)


def test_what_falls_with_speed_falls_as_an_exponential_to_rounding():
    exponents = np.concatenate([np.geomspace(1e-12, 1e-3, 60), np.linspace(0.0, 39.0, 60)])
    assert [fallen(x) for x in exponents] == pytest.approx(np.exp(-exponents), rel=3e-16, abs=0.0)
    assert fallen(50.0) == 0.0


def test_a_joint_at_rest_is_held_up_to_breakaway_and_no_further():
    """Weight on an arm that friction holds, then not: in the engine."""
    spec = mujoco.MjSpec.from_string(
        "<mujoco><option timestep='0.001' integrator='implicitfast'/><worldbody><body>"
        "<joint name='joint_3' axis='0 1 0'/><geom size='.02' pos='.2 0 0' mass='1'/></body></worldbody></mujoco>"
    )
    drivetrain = Drivetrain(spec, {"joint_3": load_chain([*({"torque_command": {}},), MESHING])})
    data = mujoco.MjData(drivetrain.model)
    mujoco.mj_step(drivetrain.model, data, 500)
    assert abs(data.qpos[0]) < 1e-4, "1.96 N.m of weight under 2.2 N.m of breakaway"
    data.ctrl[0] = 0.4
    mujoco.mj_step(drivetrain.model, data, 500)
    assert data.qpos[0] > 0.05


MESHING = {
    "meshing": {
        "breakaway_positive": 2.2,
        "breakaway_negative": 2.2,
        "coulomb_positive": 1.5,
        "coulomb_negative": 1.5,
        "stribeck_velocity_positive": 0.1,
        "stribeck_velocity_negative": 0.1,
    }
}


def test_meshing_is_refused_beside_bristles():
    with pytest.raises(ChainError, match="sticks rigidly"):
        load_chain([{"torque_command": {}}, {"friction": {"coulomb": 1.0, "bristle_stiffness": 50.0}}, MESHING])


def test_a_motor_may_have_two_constants():
    motor = {"dc_motor": {"motor_constant": 0.04681, "resistance": 10.5, "emf_ratio": 0.039 / 0.04681}}
    chain = load_chain([{"position_p": {"gain": 1.0}}, {"supply": {"volts": 24.0}}, motor, {"gear": {"ratio": 246.0}}])
    program = chain.program()
    state = np.zeros(int(program[P_STATE_SIZE]))
    begin(program, state, 0.0, 0.0, 0.0, 0.0)
    given = torque(program, state, 0.0, 1.0, 0.0, 0.5, 0.0, True)
    assert given == pytest.approx(246.0 * 0.04681 * (24.0 - 0.039 * 246.0 * 0.5) / 10.5)
    found = [chains_of("silo4")[name].find("dc_motor") for name in JOINTS]
    assert [motor.back_emf for motor in found] == pytest.approx([0.039, 0.043, 0.041], rel=1e-4)


def test_the_path_is_bang_bang_in_acceleration():
    task = LegTask(speed=0.1)
    command = task.commands(np.random.default_rng(0).random((4, task.draws)))
    time, step = np.linspace(0.0, 3.0, 3001), 1e-3
    from sealegs.envs.leg.path import position

    for row in command:
        points = position(np.tile(row, (len(time), 1)), time)
        acceleration = np.linalg.norm(np.diff(points, 2, axis=0), axis=1) / step**2
        way = np.linalg.norm(row[3:6] - row[:3])
        assert np.median(acceleration) == pytest.approx(4.0 * way / row[6] ** 2, rel=1e-3)
        assert np.ptp(np.quantile(acceleration, [0.05, 0.95])) < 1e-3 * np.median(acceleration)
