"""The laws of the stages, each against its equation; no engine takes part."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
import sealegs  # noqa: F401 registers
from sealegs.actuators import Chain, load_chain
from sealegs.actuators.law import advance, begin, host_reading, torque
from sealegs.actuators.layout import (
    DELAY_EVENTS,
    P_STATE_SIZE,
    S_CURRENT,
    S_DUTY,
    S_LIMIT,
    S_READING,
    S_TORQUE,
    S_VOLTAGE,
)
from sealegs.common.errors import SealegsError

STEP = 1e-3
UNIT = [{"position_p": {"gain": 1.0}}, {"regression": {"duty_torque": 1.0, "speed_torque": 0.0}}]  # torque = error


class Joint:
    """A chain whose motion the test dictates."""

    def __init__(self, stages: list | Chain, q: float = 0.0, goal: float = 0.0, step: float = STEP) -> None:
        self.program = load_chain(stages).program()
        self.state = np.zeros(int(self.program[P_STATE_SIZE]))
        self.time, self.step, self.steps = 0.0, step, 0
        begin(self.program, self.state, 0.0, goal, q, 0.0)

    def __call__(self, goal: float, q: float = 0.0, w: float = 0.0, external: float = 0.0) -> float:
        """Torque at the present time; the next call is one step later."""
        if self.steps:
            advance(self.program, self.state, self.time)
        value = torque(self.program, self.state, self.time, goal, q, w, external, True)
        self.steps += 1
        self.time = self.steps * self.step
        return value

    def between(self, share: float, goal: float, q: float = 0.0, w: float = 0.0) -> float:
        """Torque at a Runge-Kutta stage ``share`` of a step after the latest call."""
        time = self.time - self.step + share * self.step
        return torque(self.program, self.state, time, goal, q, w, 0.0, False)


@pytest.mark.parametrize("delay", [0.0, 0.0004, 0.001, 0.0025, 0.02, 0.5])
def test_a_command_arrives_after_the_delay_to_the_fraction_of_a_step(delay):
    joint = Joint([{"delay": {"seconds": delay}}, *UNIT])
    arrival = None
    joint(0.0)
    for k in range(1, 700):
        for share in (0.0, 0.5, 1.0):
            value = joint(1.0) if share == 0.0 else joint.between(share, 1.0)
            if value == 1.0 and arrival is None:
                arrival = (k + share - 1) * STEP
    # the command is given at the second call, 1 ms
    assert arrival is not None
    assert 0.0 <= arrival - delay < 0.5 * STEP + 1e-9


@pytest.mark.parametrize("delay", [0.1, 0.2, 0.5])
def test_a_goal_that_changes_in_every_step_keeps_its_delay(delay):
    assert delay > DELAY_EVENTS * STEP  # more steps than the delay remembers events
    joint = Joint([{"delay": {"seconds": delay}}, *UNIT])
    lead = []
    for k in range(2000):
        joint(k * STEP)  # a ramp of 1 rad/s, as a staircase of 1 ms
        for share in (0.0, 0.25, 0.5, 0.75):
            value = joint.between(share, k * STEP)
            lead.append(value - max(math.floor((k + share - delay / STEP) + 1e-6), 0) * STEP)
    assert abs(np.mean(lead)) < 0.1e-3
    assert np.max(np.abs(lead)) < 1.1e-3


def test_a_late_sine_commanded_at_a_kilohertz_keeps_its_shape():
    joint = Joint([{"delay": {"seconds": 0.1}}, *UNIT])
    goal = np.sin(2.0 * np.pi * 2.0 * STEP * np.arange(2000))
    seen = np.array([joint(value) for value in goal])
    assert np.abs(seen[200:] - goal[100:-100]).max() < 1.5e-3


def test_few_changes_keep_their_times_under_a_long_delay():
    delay = 0.5
    joint = Joint([{"delay": {"seconds": delay}}, *UNIT])
    times = np.cumsum([20, 40, 25, 100, 30])
    goal = np.array([float((times <= k).sum()) for k in range(1000)])
    seen = np.array([joint(value) for value in goal])
    assert np.array_equal(seen[500:], goal[:500])


def test_a_repeated_evaluation_at_one_time_replaces_the_goal_it_recorded():
    joint = Joint([{"delay": {"seconds": 0.01}}, *UNIT])
    joint(0.0)
    torque(joint.program, joint.state, 0.0, 5.0, 0.0, 0.0, 0.0, True)
    torque(joint.program, joint.state, 0.0, 0.0, 0.0, 0.0, 0.0, True)
    assert all(joint(0.0) == 0.0 for _ in range(30))


def test_the_rate_limit_lets_the_goal_move_at_its_speed():
    joint = Joint([{"rate_limit": {"speed": 2.0}}, *UNIT])
    values = [joint(0.5) for _ in range(400)]
    assert values[100] == pytest.approx(0.2)
    assert values[-1] == 0.5
    assert joint.between(0.5, -1.0) == pytest.approx(0.5 - 0.5 * STEP * 2.0)


def test_a_goal_profile_speeds_up_and_brakes_at_its_acceleration_and_comes_to_rest_at_the_goal():
    way, acceleration = 0.5, 8.0
    joint = Joint([{"rate_limit": {"acceleration": acceleration}}, *UNIT])
    values = np.array([joint(way) for _ in range(1000)])
    time = np.arange(1000) * STEP
    half = math.sqrt(way / acceleration)  # to the middle, and as long to the end
    expected = np.where(
        time < half, 0.5 * acceleration * time**2, way - 0.5 * acceleration * np.maximum(2.0 * half - time, 0.0) ** 2
    )
    assert np.abs(values - expected).max() < 2.0 * STEP * math.sqrt(way * acceleration)
    assert values.max() < way + 1e-9 and values[-1] == pytest.approx(way, abs=1e-6)
    limited = Joint([{"rate_limit": {"speed": 0.7, "acceleration": acceleration}}, *UNIT])
    assert np.diff([limited(way) for _ in range(1000)]).max() == pytest.approx(0.7 * STEP, rel=1e-6)


def test_a_goal_profile_is_the_same_in_steps_of_any_length():
    """On a public arm it moved by several noise floors from one step of the replay to another."""
    rng = np.random.default_rng(2)
    goals = np.cumsum(rng.normal(0.0, 0.05, 40))
    seen = []
    for every in (10, 4, 1):  # steps to a goal
        chain = [{"rate_limit": {"acceleration": 20.0, "speed": 0.8}}, *UNIT]
        joint = Joint(chain, goal=goals[0], step=0.02 / every)
        seen.append(np.array([joint(goal) for goal in np.repeat(goals, every)])[::every])
    assert np.ptp(seen, axis=0).max() < 1e-9 and np.ptp(seen[0]) > 0.05


def test_a_goal_filter_covers_what_it_should_of_a_step_and_of_a_ramp():
    constant = 0.02
    joint = Joint([{"goal_filter": {"time_constant": constant}}, *UNIT])
    joint(0.0)
    time = np.arange(400) * STEP
    assert np.array([joint(0.5) for _ in time]) == pytest.approx(0.5 * (1.0 - np.exp(-time / constant)), abs=1e-12)
    assert joint.between(-1.0, 0.5) == pytest.approx(0.5, abs=1e-6)  # at this very instant it has not moved
    ramp = Joint([{"goal_filter": {"time_constant": constant}}, *UNIT])
    seen = np.array([ramp(0.3 * t) for t in time])
    assert seen[-1] == pytest.approx(0.3 * (time[-1] - constant), abs=0.3 * STEP)
    off = Joint([{"goal_filter": {"time_constant": 0.0, "period": 0.01}}, *UNIT])
    assert [off(value) for value in (0.0, 0.5, -0.2)] == [0.0, 0.5, -0.2]


def test_a_goal_filter_that_the_host_computes_once_a_period_is_half_of_it_ahead():
    constant, period = 0.03, 0.01
    every = round(period / STEP)
    goal = np.repeat(np.cumsum(np.random.default_rng(1).normal(size=600)), every)
    held, share = [], 1.0 - math.exp(-period / constant)
    value = goal[0]
    for wanted in goal[::every]:
        value += share * (wanted - value)
        held += [value] * every
    errors = {}
    for believed in (0.0, 0.5 * period, period, 1.5 * period, 2.0 * period):
        joint = Joint([{"goal_filter": {"time_constant": constant, "period": believed}}, *UNIT], goal=goal[0])
        errors[believed] = np.std([joint(wanted) - value for wanted, value in zip(goal, held, strict=True)])
    assert min(errors, key=errors.__getitem__) == period, errors


def test_a_d_term_adds_a_duty_for_how_fast_the_error_grows():
    """Of a ramp its speed, of a step one push whose size does not depend on how it is filtered."""
    motor, gain, rate, step = UNIT[1], 0.05, 3.0, 2e-5
    chain = [{"position_p": {"gain": 2.0}}, {"derivative": {"gain": gain}}, motor]
    ramp = Joint(chain, step=step)
    seen = [ramp(rate * k * step, w=0.5) for k in range(1000)]
    assert seen[-1] - 2.0 * rate * 999 * step == pytest.approx(gain * (rate - 0.5), rel=0.02)
    for constant in (0.001, 0.02):
        jump = Joint([chain[0], {"derivative": {"gain": gain, "filter": constant}}, motor], step=step)
        jump(0.0)
        assert sum(jump(1.0) - 2.0 for _ in range(10000)) * step == pytest.approx(gain, rel=0.02)
    still = Joint(chain)
    assert [still(0.3) for _ in range(3)] == pytest.approx([0.6] * 3)


def test_pd_and_pi_controllers_follow_their_equations():
    motor = UNIT[1]
    damped = Joint([{"position_pd": {"gain": 3.0, "damping": 0.5}}, motor])
    assert damped(1.0, q=0.4, w=2.0) == pytest.approx(3.0 * 0.6 - 0.5 * 2.0)
    integral = Joint([{"position_pi": {"gain": 2.0, "integral": 4.0, "integral_limit": 0.3}}, motor])
    values = [integral(0.1) for _ in range(2000)]
    assert values[100] == pytest.approx(0.2 + 4.0 * 0.1 * 0.1)
    assert values[-1] == pytest.approx(0.2 + 0.3)  # held at its limit
    assert integral(-0.1) == pytest.approx(-0.2 + 0.3)
    assert integral(-0.1) < -0.2 + 0.3  # and leaves it at once


def test_limits_dead_band_offset_scale_and_minimum_duty():
    position, motor = UNIT
    assert Joint([position, {"duty_limit": {"limit": 0.7}}, motor])(5.0) == 0.7
    assert Joint([position, motor, {"torque_limit": {"limit": 0.4}}])(-5.0) == -0.4
    assert Joint([position, {"minimum_duty": {"value": 0.1}}, motor])(0.03) == 0.1
    assert Joint([position, {"minimum_duty": {"value": 0.1}}, motor])(0.0) == 0.0
    assert Joint([{"offset": {"value": 0.2}}, position, motor])(1.0) == 1.2
    assert Joint([{"scale": {"factor": 0.5}}, position, motor])(1.0) == 0.5
    before = Joint([{"dead_band": {"width": 0.05}}, position, motor])
    assert before(0.54, q=0.5) == 0.0
    assert before(0.56, q=0.5) == pytest.approx(0.06)
    behind = Joint([position, {"dead_band": {"width": 0.05}}, motor])
    assert behind(0.04) == 0.0 and behind(0.06) == 0.06


def dc_motor(**more: float) -> list:
    return [{"position_p": {"gain": 1.0}}, {"supply": {"volts": 12.0}}, {"dc_motor": {**MOTOR, **more}}]


MOTOR = {"motor_constant": 0.5, "resistance": 2.0}


def test_a_motor_makes_its_torque_less_back_emf():
    joint = Joint(dc_motor())
    assert joint(0.5, w=3.0) == pytest.approx(0.5 * (6.0 - 0.5 * 3.0) / 2.0)
    assert joint.state[S_CURRENT] == pytest.approx((6.0 - 1.5) / 2.0)
    assert joint.state[S_VOLTAGE] == 6.0 and joint.state[S_DUTY] == 0.5


def test_a_supply_sags_by_the_current_that_the_bridge_draws():
    stages = dc_motor()
    stages[1] = {"supply": {"volts": 12.0, "resistance": 0.8}}
    joint = Joint(stages)
    joint(0.5, w=3.0)
    current, voltage = joint.state[S_CURRENT], joint.state[S_VOLTAGE]
    assert voltage == pytest.approx(0.5 * (12.0 - 0.8 * 0.5 * current))
    assert current == pytest.approx((voltage - 0.5 * 3.0) / 2.0)
    joint(0.1, w=20.0)  # driven faster than it would run: it brakes, and the supply does not rise
    assert joint.state[S_VOLTAGE] == pytest.approx(1.2)


def test_a_current_limit_holds_in_both_directions():
    stages = dc_motor()
    stages.insert(2, {"current_limit": {"limit": 1.5}})
    joint = Joint(stages)
    for goal, w in ((1.0, 0.0), (-1.0, 0.0), (0.0, 20.0), (1.0, -20.0)):
        joint(goal, w=w)
        assert abs(joint.state[S_CURRENT]) == pytest.approx(1.5)


@pytest.mark.parametrize("inductance", [1e-4, 2e-3, 0.05])
def test_the_current_of_an_inductance_rises_exponentially(inductance):
    joint = Joint(dc_motor(inductance=inductance))
    joint(0.0)
    lag = inductance / 2.0
    for _ in range(20):
        joint(1.0)
        middle = joint.between(0.5, 1.0)
        passed = joint.time - joint.step - STEP + 0.5 * STEP  # since the voltage came on
        assert middle == pytest.approx(0.5 * 6.0 * (1.0 - math.exp(-passed / lag)), rel=1e-9)


def test_the_current_of_an_inductance_follows_a_changing_voltage():
    """A ramp of the duty, 1 ms steps with Runge-Kutta stages, against the solution of L di/dt = u - R i."""
    inductance, slope = 0.01, 2.0
    lag = inductance / 2.0
    joint = Joint(dc_motor(inductance=inductance))
    for k in range(50):
        joint(slope * k * STEP)
        for share in (0.5, 0.5, 1.0):
            joint.between(share, slope * (k + share) * STEP)
    t = 50 * STEP
    exact = 12.0 * slope / 2.0 * (t - lag * (1.0 - math.exp(-t / lag)))
    joint(slope * t)
    assert joint.state[S_CURRENT] == pytest.approx(exact, rel=1e-9)


def test_a_gear_multiplies_torque_and_squares_inertia_and_loses_what_it_transmits():
    stages = [*dc_motor(armature=1e-4), {"gear": {"ratio": 10.0, "efficiency": 0.8}}]
    chain = load_chain([*stages, {"friction": {}}])
    joint = Joint(chain)
    value = joint(0.5, w=0.2)
    assert value == pytest.approx(5.0 * (6.0 - 5.0 * 0.2) / 2.0)
    assert joint.state[S_LIMIT] == pytest.approx(0.2 * value)
    assert chain.armature() == pytest.approx(0.01)


def test_a_gear_without_a_friction_stage_loses_what_it_transmits_too():
    stages = [*dc_motor(), {"gear": {"ratio": 10.0, "efficiency": 0.8}}]
    plain, explicit = Joint(stages), Joint([*stages, {"friction": {}}])
    assert plain(0.5, w=0.2) == explicit(0.5, w=0.2)
    assert plain.state[S_LIMIT] == explicit.state[S_LIMIT] > 0.0
    assert np.array_equal(plain.program, explicit.program)


def test_a_torque_limit_in_front_of_a_gear_is_of_the_motor():
    gear, limit = {"gear": {"ratio": 10.0}}, {"torque_limit": {"limit": 0.4}}
    assert Joint([*dc_motor(), limit, gear])(1.0) == pytest.approx(4.0)
    assert Joint([*dc_motor(), gear, limit])(1.0) == pytest.approx(0.4)


def limit(friction: dict, q: float = 0.0, w: float = 0.0, motor: float = 0.0, external: float = 0.0) -> float:
    joint = Joint([*UNIT, {"friction": friction}])
    joint(q + motor, q=q, w=w, external=external)
    return joint.state[S_LIMIT]


def test_friction_limits_follow_their_equation():
    assert limit({"coulomb": 0.1}, w=1.0) == 0.1
    assert limit({"coulomb": 0.1, "load": 0.2}, motor=0.5, external=-0.5) == pytest.approx(0.1 + 0.2)
    assert limit({"load_quadratic": 0.3}, motor=0.5, external=-0.5) == pytest.approx(0.3)
    stribeck = {"coulomb": 0.1, "stribeck": 0.05, "stribeck_velocity": 0.2, "stribeck_exponent": 2.0}
    assert limit(stribeck) == pytest.approx(0.15)
    assert limit(stribeck, w=0.4) == pytest.approx(0.1 + 0.05 * math.exp(-4.0))
    assert limit(stribeck, w=-0.4) == limit(stribeck, w=0.4)
    assert limit({"load_stribeck": 0.1, "stribeck_velocity": 0.2}, motor=1.0) == pytest.approx(0.1)
    lopsided = {"coulomb": 0.1, "asymmetry": 0.03}
    assert (limit(lopsided, w=1.0), limit(lopsided, w=-1.0)) == pytest.approx((0.13, 0.07))
    assert (limit(lopsided, motor=1.0), limit(lopsided, motor=-1.0)) == pytest.approx((0.13, 0.07))
    steeper = {"coulomb": 0.1, "viscous_asymmetry": 0.02}
    assert [limit(steeper, w=speed) for speed in (0.0, 2.0, -2.0, -9.0)] == pytest.approx([0.1, 0.14, 0.06, 0.0])
    dragged = {"coulomb": 0.1, "drag": 0.02}
    assert (limit(dragged), limit(dragged, w=3.0), limit(dragged, w=-3.0)) == pytest.approx((0.1, 0.28, 0.28))
    ripple = {"coulomb": 0.1, "ripple": 0.02, "ripple_count": 8.0}
    assert limit(ripple, q=math.pi / 8.0, w=1.0) == pytest.approx(0.08)


def test_the_encoder_reads_in_ticks_with_offset_and_scale_and_late():
    joint = Joint([*UNIT, {"encoder": {"ticks": 4096, "offset": 0.1, "scale": 1.02}}])
    joint(0.0, q=1.0)
    reading, step = joint.state[S_READING], 2.0 * math.pi / 4096
    assert abs(reading - (1.02 * 1.0 + 0.1)) <= 0.5 * step
    assert reading / step == pytest.approx(round(reading / step))
    assert joint.state[S_TORQUE] == pytest.approx(-reading)  # the servo's controller reads the same
    late = Joint([*UNIT, {"encoder": {"latency": 0.0123}}])
    for k in range(200):
        late(0.0, q=2.0 * k * STEP, w=2.0)
    now = late.time - STEP
    assert host_reading(late.program, late.state, now, 2.0 * now) == pytest.approx(2.0 * (now - 0.0123), abs=1e-9)
    assert late.state[S_READING] == pytest.approx(2.0 * now)  # but the servo itself is up to date


SLIDE = """<mujoco><option timestep="{step}" integrator="{integrator}" gravity="0 0 0"/><worldbody><body>
<joint name="x" type="slide" axis="1 0 0"/><geom size="0.1" mass="7"/></body></worldbody></mujoco>"""
LUGRE = {"coulomb": 150.0, "stribeck": 100.0, "stribeck_velocity": 1e-4, "stribeck_exponent": 2.0, "lugre": 1}
BRISTLES = {"bristle_stiffness": 1e9, "bristle_damping": 0.02}


def pushed(
    friction: dict,
    force: float,
    seconds: float = 0.5,
    step: float = 1e-3,
    integrator: str = "implicitfast",
    rise: float = 0.0,
):
    from sealegs.actuators import Drivetrain

    spec = mujoco.MjSpec.from_string(SLIDE.format(step=step, integrator=integrator))
    driven = Drivetrain(spec, {"x": [{"torque_command": {}}, {"friction": friction}]})
    data = mujoco.MjData(driven.model)
    for k in range(round(seconds / step)):
        data.qfrc_applied[0] = force * min(k * step / rise, 1.0) if rise else force
        mujoco.mj_step(driven.model, data)
    return data


@pytest.mark.parametrize("step", [2e-3, 1e-3, 1e-4])
@pytest.mark.parametrize("integrator", ["implicitfast", "RK4", "Euler"])
def test_bristles_of_the_printed_stiffness_hold_slip_and_are_stable_at_any_step(step: float, integrator: str) -> None:
    held = pushed({**LUGRE, **BRISTLES}, 200.0, 0.3, step, integrator, rise=0.15)  # below breakaway, above Coulomb
    assert abs(held.qpos[0]) < 2e-6
    assert abs(held.qvel[0]) < 1e-7
    assert held.qfrc_constraint[0] == pytest.approx(-200.0, rel=1e-3)
    slipping = pushed({**LUGRE, **BRISTLES}, 300.0, 0.3, step, integrator, rise=0.15)
    assert slipping.qvel[0] == pytest.approx((3.125 + 22.5) / 7.0, rel=0.03)  # breaks away at 250 N, after 0.125 s


def test_bristles_follow_their_differential_equation() -> None:
    # soft bristles, so that their transient is slow: equations (26) to (28) integrated on their own in fine steps
    stiffness, coulomb, mass, force, step = 2e4, 10.0, 7.0, 9.0, 1e-5
    z = v = q = 0.0
    for _ in range(round(0.2 / step)):
        slip = v - abs(v) / (coulomb / stiffness) * z
        v += step * (force - stiffness * z - 5.0 * slip) / mass
        z += step * slip
        q += step * v
    data = pushed(
        {"coulomb": coulomb, "lugre": 1, "bristle_stiffness": stiffness, "bristle_damping": 5.0}, force, 0.2, 2e-4
    )
    assert data.qpos[0] == pytest.approx(q, rel=0.03)


def test_smoothed_dry_friction_creeps_as_its_equation_says() -> None:
    data = pushed({"coulomb": 150.0, "viscous": 2000.0, "slip_speed": 1e-4}, 100.0)
    slope = (150.0 + 2000.0 * 1e-4) / 1e-4  # (34) between the slip speeds
    assert data.qvel[0] == pytest.approx(100.0 / slope, rel=1e-3)


def test_a_digital_controller_holds_its_duty_and_its_integral_runs_out_within_the_band() -> None:
    from sealegs.actuators.law import begin, torque
    from sealegs.actuators.layout import P_STATE_SIZE, S_DUTY

    controller = {"gain": 2.0, "integral": 4.0, "period": 0.01, "band": 0.01, "integral_limit": 0.05}
    chain = load_chain(
        [
            {"position_pi": controller},
            {"supply": {"volts": 10.0}},
            {"dc_motor": {"motor_constant": 1.0, "resistance": 1.0}},
        ]
    )
    program = chain.program()
    state = np.zeros(int(program[P_STATE_SIZE]))
    begin(program, state, 0.0, 0.1, 0.0, 0.0)
    duties = []
    for k in range(200):
        torque(program, state, 1e-3 * k, 0.1, 0.0 if k < 100 else 0.0995, 0.0, 0.0, True)
        duties.append(state[S_DUTY])
    assert all(len(set(duties[k : k + 10])) == 1 for k in range(0, 200, 10))  # (24) every 10 ms
    assert duties[:30:10] == pytest.approx([0.2 + 0.004 * k for k in (1, 2, 3)])  # (25)
    assert duties[99] == pytest.approx(0.2 + 0.04)
    assert duties[199] == pytest.approx(0.04 * (1.0 - 0.02) ** 10)


@pytest.mark.parametrize(
    ("friction", "sentence"),
    [
        ({"lugre": 1}, "needs a bristle_stiffness"),
        ({"bristle_stiffness": 1e3, "slip_speed": 1e-4}, "exclude each other"),
        ({"bristle_damping": 1.0}, "only LuGre bristles have"),
    ],
)
def test_joint_frictions_that_exclude_each_other_are_refused(friction: dict, sentence: str) -> None:
    with pytest.raises(SealegsError, match=sentence):
        load_chain([{"torque_command": {}}, {"friction": friction}])


def test_a_band_without_a_period_is_refused() -> None:
    with pytest.raises(SealegsError, match="add its period"):
        load_chain(
            [
                {"position_pi": {"gain": 1.0, "integral": 1.0, "band": 0.1}},
                {"supply": {"volts": 1.0}},
                {"dc_motor": {"motor_constant": 1.0, "resistance": 1.0}},
            ]
        )
