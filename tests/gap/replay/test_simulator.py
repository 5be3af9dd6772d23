"""The compiled joint simulator agrees with the engine, and knows the heat of motors and their shared supply."""

from __future__ import annotations

import numpy as np
import pytest
from sealegs.actuators.chain import load_chain
from sealegs.common.errors import SealegsError
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.load.pendulum import PendulumLoad, bench_parameters
from sealegs.gap.load.terms import T_COLUMNS, T_DRAWN, T_OWN
from sealegs.gap.load.tree import TreeLoad
from sealegs.gap.log.parts import cut
from sealegs.gap.log.types import JointLog, MeasuredRun, MeasuredSet
from sealegs.gap.replay.engine import bench, replay_in_engine
from sealegs.gap.replay.free import NO_TERMS, FreeProblem, free_problem
from sealegs.gap.replay.joint_model import Axis, JointModel
from sealegs.gap.replay.layout import between_steps, heated
from sealegs.gap.replay.simulator import replay
from sealegs.gap.verdict.verdict import NOTHING

from tests.smooth_bench import CHAIN, PARAMS

EXTENSIONS = {
    "nominal": {},
    "load dependent friction": {"friction.load": 0.1, "friction.stribeck": 0.05},
    "presliding": {"friction.bristle_stiffness": 4.0},
    "duty step": {"duty_step.size": 0.03},
    "thermal": {"thermal.loss": 0.01, "thermal.temperature": 40.0},
    "compliance": {"compliance.stiffness": 15.0, "compliance.damping": 0.02},
    "blocked": {"load.stop_angle": 0.4, "load.lower_stop": -0.4},
}
# every bounce enlarges what came before it, so that no step is short enough
BOUNCING = {"backlash.width": 0.1, "backlash.tooth_stiffness": 900.0, "backlash.tooth_damping": 0.5}


def excitation(duration: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Time [s] and goal [rad] at 200 Hz: multisine, then steps."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, duration, 0.005)
    smooth = sum(0.3 / (1 + f) * np.sin(2 * np.pi * f * time + rng.uniform(0, 6)) for f in (0.2, 0.5, 1.1, 1.9))
    steps = rng.uniform(-0.8, 0.8, int(duration) + 1)[time.astype(int)]
    return time, np.where(time < duration / 2, smooth, steps)


def simulate(
    joint: JointModel, time: np.ndarray, goal: np.ndarray, step: float, state=(0.0, 0.0), params=PARAMS
) -> np.ndarray:
    program = joint.chain.program()
    out = np.empty((len(time), 4))
    thermal = joint.chain.find("thermal")
    warm = np.full(len(time), thermal.temperature if thermal is not None else 25.0)
    constants = joint.constants(params, program)
    on = np.ones(len(time), bool)
    replay(program.copy(), constants, NO_TERMS, time, goal, on, warm, state[0], state[1], step, out)
    return out


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


@pytest.mark.parametrize("name", EXTENSIONS)
def test_halving_the_step_changes_little_and_ever_less(name: str) -> None:
    joint = JointModel(load_chain(CHAIN)).with_values(EXTENSIONS[name])
    time, goal = excitation(8.0)
    exact = simulate(joint, time, goal, 2e-5)[:, 0]
    coarse, fine = (rms(simulate(joint, time, goal, step)[:, 0] - exact) for step in (1e-3, 2.5e-4))
    assert fine < 0.06e-3
    assert fine < 0.5 * coarse or coarse < 0.02e-3


@pytest.mark.long
@pytest.mark.parametrize("name", [*EXTENSIONS, "bouncing teeth"])
def test_the_engine_agrees(name: str) -> None:
    joint = JointModel(load_chain(CHAIN)).with_values(EXTENSIONS.get(name, BOUNCING))
    time, goal = excitation(6.0, seed=1)
    ours = simulate(joint, time, goal, 2.5e-4)
    engine = replay_in_engine(bench(joint, PARAMS), time, goal, (0.0, 0.0), step=2.5e-4)
    assert rms(ours[:, 0] - engine[:, 0]) < 0.2e-3


def test_an_empty_shaft_is_a_bench_whose_joint_is_its_armature() -> None:
    params = bench_parameters({"mass": 0.0}, "log.csv")
    joint = JointModel(load_chain(CHAIN))
    assert (joint.load.inertia(params), joint.load.gravity_torque(params)) == (0.0, 0.0)
    time, goal = excitation(6.0, seed=1)
    ours = simulate(joint, time, goal, 2.5e-4, params=params)
    engine = replay_in_engine(bench(joint, params), time, goal, (0.0, 0.0), step=2.5e-4)
    assert rms(ours[:, 0] - engine[:, 0]) < 0.2e-3
    assert np.isfinite(ours).all() and rms(ours[:, 0]) > 0.1


@pytest.mark.parametrize(
    ("params", "sentence"),
    [
        ({}, "says nothing of the bench's load; add mass"),
        ({"mass": -1.0, "length": 0.1}, "has mass: -1; a mass is zero or more"),
        ({"mass": 0.5}, "needs 'length' above zero"),
        ({"mass": 0.5, "lenght": 0.1}, "did you mean 'length'"),
    ],
)
def test_a_load_that_no_bench_has_is_refused_with_one_sentence(params: dict[str, float], sentence: str) -> None:
    with pytest.raises(SealegsError, match=sentence):
        bench_parameters(params, "log.csv")


def test_a_spring_with_an_inertia_of_its_own_is_refused() -> None:
    chain, time = load_chain("mabel_left_leg_shape"), np.arange(0.0, 1.0, 0.005)
    with pytest.raises(SealegsError, match="'spring' has an inertia of its own"):
        simulate(JointModel(chain), time, np.zeros_like(time), 1e-3)
    massless = chain.without_stage("compliance").with_value("spring.unilateral", 0.0).with_value("spring.inertia", 0.0)
    simulate(JointModel(massless), time, np.zeros_like(time), 1e-3)


def test_a_stuck_joint_stays_stuck() -> None:
    joint = JointModel(load_chain(CHAIN)).with_values({"friction.coulomb": 1.0})
    time = np.arange(0.0, 5.0, 0.005)
    out = simulate(joint, time, np.full(len(time), 0.5), 1e-3, (0.45, 0.0))
    assert np.ptp(out[:, 0]) == 0.0


def test_a_stop_holds_the_link() -> None:
    joint = JointModel(load_chain(CHAIN), PendulumLoad(stop_angle=0.3))
    time = np.arange(0.0, 2.0, 0.005)
    out = simulate(joint, time, np.full(len(time), 0.8), 1e-3)
    assert 0.3 <= out[-1, 0] < 0.31


def test_temperature_of_the_log_weakens_the_motor() -> None:
    joint = JointModel(load_chain(CHAIN)).with_values({"thermal.loss": 0.01})
    weaker = JointModel(load_chain(CHAIN)).with_values({"dc_motor.motor_constant": 1.2 * 0.8})
    time, goal = excitation(4.0)
    out = np.empty((len(time), 4))
    program = joint.chain.program()
    constants = joint.constants(PARAMS, program)
    replay(
        program,
        constants,
        NO_TERMS,
        time,
        goal,
        np.ones(len(time), bool),
        np.full(len(time), 45.0),
        0.0,
        0.0,
        1e-3,
        out,
    )
    np.testing.assert_allclose(out, simulate(weaker, time, goal, 1e-3), atol=1e-9)


@pytest.mark.long
def test_a_log_of_the_nominal_model_at_a_fine_step_has_nothing_to_explain() -> None:
    chain = [*CHAIN[:-1], {"encoder": {"ticks": 4096}}]
    joint, rng, runs = JointModel(load_chain(chain)), np.random.default_rng(3), []
    for k in range(3):
        time, goal = excitation(12.0, seed=k)
        out = simulate(joint, time, goal, 2e-5)
        reading = out[:, 0] + rng.normal(0.0, 3.9e-4, len(time))
        tick = 2.0 * np.pi / 4096
        log = JointLog(goal=goal, position=tick * np.round(reading / tick), duty=out[:, 2], current=out[:, 3])
        runs.append(MeasuredRun(f"run{k}", time, {"servo": log}, {}, "bench", PARAMS, {"servo": chain}))
    (found,) = diagnose(MeasuredSet(tuple(runs), "null"))
    assert found.verdict == NOTHING, found.sentence
    assert not found.causes


def test_a_start_is_told_in_readings() -> None:
    joint = JointModel(load_chain(CHAIN)).with_values({"encoder.scale": 0.5, "position_p.gain": 0.0})
    time = np.arange(0.0, 0.02, 0.001)
    out = simulate(joint, time, np.zeros(len(time)), 1e-4, (0.1, 2.0))
    assert out[0, 0] == pytest.approx(0.1, abs=1e-9)
    assert (out[1, 0] - out[0, 0]) / 1e-3 == pytest.approx(2.0, rel=0.1)


def test_a_temperature_that_is_polled_slowly_lies_on_a_line_between_its_readings() -> None:
    time = np.arange(0.0, 60.0, 0.005)
    read = np.where(np.arange(len(time)) % 200 == 0, np.round(30.0 + 0.5 * time), np.nan)
    log = JointLog(np.sin(time), np.sin(time), temperature=read)
    run = MeasuredRun("warm", time, {"servo": log}, robot="bench", robot_params=PARAMS)
    units = cut([run] * 6, "servo")
    problem = free_problem([run] * 6, "servo", [JointModel(load_chain(CHAIN))] * 6, units, {"position": 1.0})
    np.testing.assert_allclose(problem.temperature, np.tile(30.0 + 0.5 * time, 6), atol=1.1)


def motor(seconds: float = 60.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, current and temperature of a winding that warms by 2 K, with numbers of its own (4 J/K, 9 K/W)."""
    time = np.arange(0.0, seconds, 0.01)
    current = 0.26 * np.sin(2.0 * time) * (1.0 + (np.sin(0.2 * time) > 0.0))
    warm = np.empty(len(time))
    level = 24.7
    for k, i in enumerate(current):
        warm[k] = level
        level += 0.01 * (3.0 * i * i - (level - 24.7) / 9.0) / 4.0
    return time, current, warm


def test_the_current_tells_what_rounding_hid():
    time, current, warm = motor()
    logged = np.round(warm)
    assert np.ptp(logged) <= 2.0
    found = heated(time, logged, current)
    error, before = (np.std(values - warm) for values in (found, between_steps(time, logged)))
    assert error < 0.12 and error < 0.6 * before


def test_what_the_current_does_not_explain_stays_as_it_was_logged():
    time, current, warm = motor()
    room = np.round(24.7 + 3.0 * (time > 30.0))
    assert heated(time, np.round(warm), None) is not None
    assert np.array_equal(heated(time, room, 0.0 * current), room)
    fine = np.round(warm, 2)
    assert np.array_equal(heated(time, fine, current), fine)


TIME = np.arange(400.0) * 0.005
DRAWN = 2.0  # [A] by the other joints
SAG = 0.7  # [ohm]
FOUND = {"supply.resistance": SAG}


def joint(drawn: float) -> FreeProblem:
    """A joint that is told to jump, beside others that draw so much [A]."""
    log = JointLog(np.zeros(400), np.sign(np.sin(2.0 * np.pi * TIME)))
    run = MeasuredRun("run", TIME, {"servo": log}, {}, "bench", dict(PARAMS), {"servo": CHAIN})
    terms = np.zeros((400, T_COLUMNS))
    terms[:, T_OWN] = 0.01  # [kg.m2]
    terms[:, T_DRAWN] = drawn
    model = JointModel(load_chain(CHAIN), TreeLoad(), axis=Axis(low=-1.0, high=1.0))
    return free_problem([run], "servo", [model], cut([run], "servo", None), {"position": 1e3}, [terms])


def test_what_other_joints_draw_is_as_a_lower_voltage_of_the_supply() -> None:
    """A gripper's wrist was 46 mrad off while its jaw, against a stop, pulled the voltage of both down."""
    alone, beside = joint(0.0), joint(DRAWN)
    lower = {**FOUND, "supply.volts": alone.models[0].value("supply.volts") - SAG * DRAWN}
    assert beside.simulate([FOUND])[0] == pytest.approx(alone.simulate([lower])[0], abs=1e-9)
    assert np.abs(beside.simulate([FOUND])[0] - alone.simulate([FOUND])[0]).max() > 0.05


def test_a_supply_that_does_not_sag_gives_its_voltage_whatever_others_draw() -> None:
    np.testing.assert_array_equal(joint(DRAWN).simulate([{}]), joint(0.0).simulate([{}]))
