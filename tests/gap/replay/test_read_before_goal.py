"""Columns that a loop reads before it writes the goal of the row: no drive is slow for it, whatever its controller.

Plants of this file: a joint of a walking robot that something moves as it will, and controllers written out again.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from sealegs.actuators import load_chain
from sealegs.gap.causes.catalogue import adjustable
from sealegs.gap.causes.visible import limits
from sealegs.gap.diagnose import diagnose
from sealegs.gap.log.parts import cut
from sealegs.gap.log.reader import measured_set
from sealegs.gap.log.types import JointLog, MeasuredRun, MeasuredSet
from sealegs.gap.replay.driven import DrivenProblem, as_read, driven_problem
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.problem import converged
from sealegs.gap.search.channels import weigh_channels
from sealegs.gap.search.correlated import excess
from sealegs.gap.search.fit import fit
from sealegs.gap.search.settings import DEFAULT
from sealegs.gap.search.structure import LIMITS, Structure, structure
from sealegs.gap.search.where import where

from testbed import NOISE_FLOOR, hidden_bench
from tests.quick import quick

PERIOD = 0.005
IDEAL = [
    {"ideal": {"stiffness": 25.0, "damping": 0.5, "torque_limit": 20.0, "armature": 0.02}},
    {"friction": {"coulomb": 0.15, "viscous": 0.1}},
]
DC = [
    {"position_pd": {"gain": 6.0, "damping": 0.15}},
    {"duty_limit": {"limit": 0.95}},
    {"supply": {"volts": 12.0}},
    {"dc_motor": {"motor_constant": 1.4, "resistance": 2.4, "armature": 0.01}},
]


def walk(seed: int, age: int, slow: float = 1.0) -> tuple[np.ndarray, ...]:
    """Time, goal, the goal that acts ``age`` rows late, position, speed and acceleration of a joint."""
    rng = np.random.default_rng(seed)
    time = PERIOD * np.arange(2400)
    goal, angle, speed, turning = (np.zeros(len(time)) for _ in range(4))
    for hertz, phase in zip((0.4, 0.9, 1.7, 2.6, 1.3), rng.uniform(0.0, 6.0, 5), strict=True):
        w, size = 2.0 * np.pi * hertz * slow, 0.15 if hertz != 1.3 else 0.0
        goal += size * np.sin(w * time + phase)
        size = 0.12 if hertz != 1.3 else 0.08  # what the ground does
        at = w * (time - 0.03) + phase
        angle += size * np.sin(at)
        speed += size * w * np.cos(at)
        turning -= size * w**2 * np.sin(at)
    acting = np.concatenate([np.full(age, goal[0]), goal])[: len(goal)]
    return time, goal, acting, angle, speed, turning


def torque_log(age: int, stiffness: float = 25.0, side: str = "drive", slow: float = 1.0) -> MeasuredSet:
    """The drive's own torque, or that behind its armature and friction."""
    tables = []
    for seed in range(3):
        rng = np.random.default_rng(100 + seed)
        time, goal, acting, angle, speed, turning = walk(seed, age, slow)
        torque = stiffness * (acting - angle) - 0.5 * speed
        if side == "shaft":
            torque -= 0.02 * turning + 0.1 * speed + 0.15 * np.sign(speed)
        noise = rng.normal(size=(2, len(time)))
        tables.append({
            "time": time, "hip.goal": goal, "hip.position": angle + 1e-4 * noise[0],
            "hip.torque": torque + 0.01 * noise[1],
        })  # fmt: skip
    return measured_set(tables, {"robot": "walker", "actuators": {"hip": IDEAL}})


def duty_log(age: int, slow: float = 1.0) -> MeasuredSet:
    """The duty of a PD controller of which each row's goal is written once the row is read."""
    tables = []
    for seed in range(3):
        time, goal, acting, angle, speed, _ = walk(seed, age, slow)
        duty = np.clip(6.0 * (acting - angle) - 0.15 * speed, -0.95, 0.95)
        noise = 1e-4 * np.random.default_rng(200 + seed).normal(size=len(time))
        tables.append({"time": time, "hip.goal": goal, "hip.position": angle + noise, "hip.duty": duty})
    return measured_set(tables, {"robot": "walker", "actuators": {"hip": DC}})


def seen(data: MeasuredSet) -> DrivenProblem:
    models = [JointModel(load_chain(run.actuators["hip"])) for run in data.runs]
    return as_read(driven_problem(data.runs, "hip", models, cut(data.runs, "hip"), 1e-4), told=False)


def said(problem: DrivenProblem) -> set[str]:
    return {finding.code for finding in limits(problem, "hip", ())}


@pytest.mark.parametrize(
    "data", [torque_log(1), torque_log(1, stiffness=17.0), torque_log(1, side="shaft"), duty_log(1)]
)
def test_what_is_read_before_the_goal_of_its_row_acts_is_told_of_any_drive(data: MeasuredSet) -> None:
    problem = seen(data)
    assert problem.read_early and "columns.before_goal" in said(problem)


@pytest.mark.parametrize(
    "data", [torque_log(0), torque_log(0, stiffness=17.0), duty_log(0), torque_log(3), duty_log(3)]
)
def test_what_answers_to_the_goal_of_its_row_or_to_a_much_older_one_is_not(data: MeasuredSet) -> None:
    problem = seen(data)
    assert not problem.read_early and "columns.before_goal" not in said(problem)


def test_nothing_is_told_where_goals_change_too_slowly_to_tell() -> None:
    assert not seen(torque_log(1, slow=0.004)).read_early


def test_a_delay_whose_tolerance_makes_a_goal_one_row_older_is_no_early_reading() -> None:
    data = torque_log(1)
    slow = [{"delay": {"seconds": 0.98 * PERIOD}}, *IDEAL]
    assert not seen(replace(data, runs=tuple(replace(run, actuators={"hip": slow}) for run in data.runs))).read_early


@pytest.mark.parametrize("age", [0, 1, 4])
@pytest.mark.parametrize("side", ["shaft", "drive"])
@pytest.mark.parametrize("stiffness", [17.0, 25.0])
def test_the_side_of_a_torque_is_told_though_its_goal_is_late_and_its_gain_wrong(
    stiffness: float, side: str, age: int
) -> None:
    """A goal one row old made of a drive's torque one of the shaft, and armature and friction went missing."""
    problem = seen(torque_log(age, stiffness, side))
    assert (problem.torque_side, problem.side_reason) == (side, "shown")


def diagnosed(data: MeasuredSet, *causes: str) -> Any:
    return diagnose(data, causes=["drive.goal_filter", "drive.delay", "drive.rate_limit", *causes]).joint("hip")


@pytest.mark.long
@pytest.mark.parametrize("data", [torque_log(1), duty_log(1)])
def test_a_drive_that_is_read_before_its_goal_has_no_goal_filter(data: MeasuredSet) -> None:
    """It came out EXPLAINED by a filter of the goal, with a confidence of 98 %."""
    found = diagnosed(data, "drive.acceleration_limit")
    assert not found.causes, found.text


@pytest.mark.long
def test_a_gain_shows_in_a_drive_that_is_read_before_its_goal() -> None:
    found = diagnosed(torque_log(1, stiffness=17.0), "drive.gain", "friction.coulomb")
    assert [cause.name for cause in found.causes] == ["drive.gain"], found.text
    assert found.causes[0].parameters["ideal.stiffness"].value == pytest.approx(17.0, rel=0.03)


# --- what no cause explains: how much is left, in which channel, and what it depends on ------------------------------

FACTORS = {
    "motor_constant": "dc_motor.motor_constant*",
    "resistance": "dc_motor.resistance*",
    "armature": "dc_motor.armature*",
    "coulomb": "friction.coulomb*",
    "viscous": "friction.viscous*",
    "command_delay": "delay.seconds*",
}


def of_true_model(effects: dict[str, Any], seed: int) -> tuple[FreeProblem, np.ndarray]:
    """The data, and what a model with the machine's true numbers, but none of its hidden effects, makes of them."""
    data, truth = hidden_bench(effects, seed, ("light", "medium", "heavy"))
    models = [JointModel(load_chain(run.actuators["servo"])) for run in data.runs]
    problem = free_problem(data.runs, "servo", models, cut(data.runs, "servo"), {"position": 1.0 / NOISE_FLOOR})
    return problem, problem.simulate([{FACTORS[name]: value for name, value in truth["nominal_factors"].items()}])[0]


def left(effects: dict[str, Any], seed: int) -> Structure:
    return structure(*of_true_model(effects, seed))


def test_a_right_model_leaves_noise() -> None:
    found = left({}, 31)
    assert not found.noticed
    assert found.sentence == "What is left is noise."


@pytest.mark.parametrize(
    ("stranger", "signal"),
    [
        ("friction.drag", "speed"),
        pytest.param("stranger.friction_drift", "time since the start", marks=pytest.mark.long),
    ],
)
@pytest.mark.long
def test_what_is_left_is_traced_to_the_signal_it_depends_on(stranger: str, signal: str) -> None:
    found = left({stranger: "moderate"}, 32)
    assert found.noticed
    assert signal in [name for name, _ in found.depends_on]
    assert signal in found.sentence


@pytest.mark.long
def test_events_at_random_times_depend_on_no_signal() -> None:
    found = left({"stranger.jams": "clear"}, 33)
    assert found.noticed
    assert found.depends_on == ()
    assert "random times" in found.sentence


def test_what_is_left_at_a_place_is_told_by_it_before_it_is_called_random() -> None:
    """It read "as events at random times would" of nearly every leftover, a stop and plain friction among them."""
    problem, simulated = of_true_model({}, 36)
    angle = problem.measured[:, 0]
    high = np.where(angle > 0.7, 3e-3 * np.sign(np.sin(40.0 * problem.time)), 0.0)
    assert "at angles from" in where(problem, simulated, high)
    speed = problem.covariates(simulated)["speed"]
    assert "moving down" in where(problem, simulated, np.where(speed < -0.2, 2e-3, 0.0))
    assert "random times" in where(problem, simulated, np.where(problem.time % 6.0 < 0.1, 5e-3, 0.0))
    assert "spread" in where(problem, simulated, np.full(len(angle), 1e-3))


@pytest.mark.long
@pytest.mark.parametrize("off", [-0.03, 0.005])
def test_a_position_that_is_off_from_a_moment_on_is_told_with_the_moment(off: float) -> None:
    """A stepper that had lost steps had its error "spread over the whole log"."""
    problem, simulated = of_true_model({}, 31)
    runs = np.repeat([unit.run for unit in problem.units], np.diff(problem.starts))
    late = (runs == 1) & (problem.time > 5.0)
    error = (simulated[:, 0] - problem.measured[:, 0] - np.where(late, off, 0.0)) / problem.noise
    told = where(problem, simulated, np.where(problem.judged, error, np.nan))
    found = re.search(r"a shift in run 2: from ([\d.]+) s on the position is off by (\S+) mrad", told)
    assert found is not None, told
    assert float(found[1]) == pytest.approx(5.0, abs=0.3) and float(found[2]) == pytest.approx(1e3 * off, rel=0.05)


@pytest.mark.long
def test_the_size_of_what_is_left_is_that_of_the_effect() -> None:
    problem, simulated = of_true_model({}, 34)
    wave = 2e-3 * np.sin(2.0 * np.pi * 0.7 * problem.time)
    found = structure(replace(problem, measured=problem.measured + wave[:, None]), simulated)
    assert found.rms == pytest.approx(2e-3 / np.sqrt(2.0), rel=0.05)


def test_ticks_of_a_coarse_encoder_are_no_structure() -> None:
    problem, simulated = of_true_model({}, 35)
    tick = 2.0 * np.pi / 256
    coarse = np.round(problem.measured / tick) * tick
    weight = np.where(problem.weight > 0.0, np.sqrt(12.0) / tick, 0.0)
    assert not structure(replace(problem, measured=coarse, weight=weight), simulated).noticed


@pytest.mark.parametrize("judged", quick(["torque", "current", "duty"], 3))
def test_a_rigid_driven_joint_is_told_by_its_link_and_by_its_own_duty(judged: str) -> None:
    """Whichever column is judged, an error that follows the link's speed (or the duty) is traced to just that."""
    rng = np.random.default_rng(0)
    time = np.arange(0.0, 12.0, 0.005)
    signals: dict[str, np.ndarray] = dict.fromkeys(("torque", "current", "duty"), np.zeros(len(time)))
    runs = []
    for name in "abcdef":
        phase = rng.uniform(0.0, 6.3, 2)
        position = 0.6 * np.sin(1.9 * time + phase[0]) + 0.3 * np.sin(5.3 * time + phase[1])
        log = JointLog(goal=position + 0.1, position=position, **{judged: signals[judged]})
        runs.append(MeasuredRun(name, time, {"knee": log}, robot="dog", actuators={"knee": "sts3215"}))
    models = [JointModel(load_chain("sts3215"))] * len(runs)
    laid = driven_problem(runs, "knee", models, cut(runs, "knee"), 1e-3)
    assert laid.channels[0] == judged
    noise = 0.01
    laid = replace(laid, weight=np.array([1.0 / noise, 0.0, 0.0, 0.0]))
    # channels that have nothing to do with the motion: smooth, and each its own
    simulated = np.stack([gaussian_filter1d(rng.standard_normal(len(laid.time)), 20.0) for _ in range(4)], axis=1)
    measured = simulated.copy()
    measured[:, 0] += noise * rng.standard_normal(len(laid.time))
    speed, duty = laid.link[:, 1], simulated[:, laid.channels.index("duty")]
    for cause, name in ((speed, "speed"), (duty, "duty")):
        wrong = measured[:, :1] + 2.0 * noise * np.tanh(3.0 * cause / cause.std())[:, None]
        found = structure(replace(laid, measured=np.concatenate([wrong, measured[:, 1:]], axis=1)), simulated)
        assert found.depends_on and found.depends_on[0][0] == name
        assert found.predicted > 0.8


SEED = 402
POSITION = {"position": 1.0 / NOISE_FLOOR}


def recorded(weight: dict[str, float]) -> tuple[FreeProblem, dict[str, float]]:
    """A null, and the numbers of its machine as factors on what the sidecar believes."""
    data, truth = hidden_bench({}, SEED, ("light", "medium", "heavy"))
    models = [JointModel(load_chain(run.actuators["servo"])) for run in data.runs]
    return free_problem(data.runs, "servo", models, cut(data.runs, "servo"), weight), truth["nominal_factors"]


@pytest.mark.long
def test_columns_that_a_drive_holds_for_a_quarter_of_a_millisecond_are_not_taken_for_a_longer_delay() -> None:
    bare, factors = recorded(POSITION)
    problem = weigh_channels(converged(bare))
    assert problem.weight[problem.channels.index("duty")] > 0.0
    found = fit(problem, adjustable(problem.models[0]))
    believed = problem.models[0].value("delay.seconds")
    assert abs(found.values["delay.seconds*"] - factors["command_delay"]) * believed < 1e-4
    assert structure(problem, found.simulated).level < LIMITS.noticed


@pytest.mark.long
@pytest.mark.parametrize("margin", [0.8, 1.0, 1.25])
def test_noise_is_no_excess_however_large_it_is_taken_for(margin: float) -> None:
    problem, factors = recorded(POSITION)
    problem = replace(problem, weight=problem.weight / margin)
    names = {"motor_constant": "dc_motor", "resistance": "dc_motor", "armature": "dc_motor"}
    names |= {"coulomb": "friction", "viscous": "friction"}
    true = {f"{stage}.{name}*": factors[name] for name, stage in names.items()}
    true["delay.seconds*"] = factors["command_delay"]
    right, wrong = problem.simulate([true, {**true, "friction.coulomb*": 1.4}])
    assert excess(problem, right) < DEFAULT.least_excess < 0.2 < excess(problem, wrong)


def test_an_excess_is_what_an_error_adds_to_noise() -> None:
    """Slow errors of half a noise floor add a quarter of its square; of fast ones nothing is shared."""
    problem, _ = recorded(POSITION)
    rng = np.random.default_rng(0)
    simulated = np.repeat(problem.measured[:, :1], 4, axis=1)
    noise = NOISE_FLOOR * rng.standard_normal(len(problem.time))
    slow = 0.5 * NOISE_FLOOR * np.sqrt(2.0) * np.sin(2.0 * np.pi * 0.7 * problem.time)
    levels = [excess(problem, simulated + error[:, None]) for error in (noise, noise + slow)]
    assert levels[0] < 0.01
    assert levels[1] == pytest.approx(0.25, abs=0.03)
