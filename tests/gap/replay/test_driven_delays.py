"""A command that is late by whole samples, at a joint whose link moves as measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.diagnose import diagnose
from sealegs.gap.log.arrays import measured_set
from sealegs.gap.log.parts import FIT_A, FIT_B, cut
from sealegs.gap.log.types import JointLog, MeasuredRun, MeasuredSet
from sealegs.gap.replay.driven import DrivenProblem, driven_problem
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.parameters import Parameter
from sealegs.gap.search.delays import with_centred_times, with_started_delays
from sealegs.gap.search.fit import Fit, fit
from sealegs.gap.search.intervals import intervals

ROWS, PERIOD = 4, 0.005
SERVO = [{"ideal": {"stiffness": 25.0, "damping": 0.5, "torque_limit": 20.0}}]


def late_servo(rows: int, seed: int) -> dict[str, np.ndarray]:
    """A joint of a walking robot: something moves it, and its servo's goal is late by so many samples."""
    rng = np.random.default_rng(seed)
    time = PERIOD * np.arange(2400)
    phases = rng.uniform(0.0, 6.0, 4)
    tones = [0.15 * np.sin(2.0 * np.pi * f * time + p) for f, p in zip((0.4, 0.9, 1.7, 2.6), phases, strict=True)]
    goal = np.sum(tones, axis=0)
    swing = 0.08 * np.sin(2.0 * np.pi * 1.3 * time + phases[0])
    position, speed = 0.8 * goal + swing, np.gradient(0.8 * goal + swing, time)
    torque = 25.0 * (np.concatenate([np.full(rows, goal[0]), goal])[: len(goal)] - position) - 0.5 * speed
    return {
        "time": time,
        "hip.goal": goal,
        "hip.position": position + 2e-4 * rng.normal(size=len(time)),
        "hip.torque": torque + 0.02 * rng.normal(size=len(time)),
    }


def walked(rows: int) -> MeasuredSet:
    return measured_set([late_servo(rows, seed) for seed in range(3)], {"robot": "walker", "actuators": {"hip": SERVO}})


@pytest.mark.long
def test_a_command_that_is_late_by_whole_samples_is_found_along_a_measured_motion() -> None:
    """Between the samples a fit had no slope: 0.008 s (0.004 to 0.2) with a confidence of 0 % in place of 0.02 s."""
    found = diagnose(walked(ROWS), causes=["drive.delay", "friction.coulomb", "drive.gain"]).joint("hip")
    assert [cause.name for cause in found.causes] == ["drive.delay"]
    delay = found.causes[0].parameters["delay.seconds"]
    assert abs(delay.value - ROWS * PERIOD) < PERIOD and delay.high < (ROWS + 2) * PERIOD
    assert delay.low <= ROWS * PERIOD <= delay.high
    assert found.causes[0].confidence > 0.9


def test_a_command_that_is_not_late_has_no_delay() -> None:
    assert not diagnose(walked(0), causes=["drive.delay", "friction.coulomb", "drive.gain"]).joint("hip").causes


def late_by(seconds: float, held: bool = True) -> DrivenProblem:
    """The same joint, a run of it, where each goal acts so many seconds after its sample.

    It holds until the next, or the log has samples of goals that come faster.
    """
    logged = late_servo(0, 0)
    time, goal = logged["time"], logged["hip.goal"]
    acting = goal[np.clip(np.floor((time - seconds) / PERIOD + 1e-9).astype(int), 0, None)]
    if not held:
        acting = np.interp(time - seconds, time, goal)
    torque = logged["hip.torque"] + 25.0 * (acting - goal)
    run = MeasuredRun("a", time, {"hip": JointLog(goal, logged["hip.position"], torque=torque)}, robot="walker")
    return driven_problem([run], "hip", [JointModel(load_chain(SERVO))], cut([run], "hip"), 2e-4)


def told(seconds: float, held: bool = True) -> tuple[DrivenProblem, tuple[Parameter, ...], Fit]:
    """What was fitted, the delay, and the fit."""
    problem = late_by(seconds, held)
    (cause,) = (one for one in catalogue(problem.models[0]) if one.name == "drive.delay")
    ((seen,), fitted) = with_started_delays(problem, [cause]), problem.part(FIT_A, FIT_B)
    return fitted, seen.variants[0], with_centred_times(fitted, seen.variants[0], fit(fitted, seen.variants[0]))


@pytest.mark.parametrize("seconds", [0.003, 0.012, 0.0171, 0.0199, 0.020001, 0.033, 0.04])
def test_the_interval_of_a_delay_holds_all_delays_that_are_one_at_the_samples(seconds: float) -> None:
    """33 ms at 200 Hz was told as 31.59 ms (31.44 to 31.75), and none of five intervals held the truth."""
    problem, parameters, found = told(seconds)
    seen_after = np.ceil(seconds / PERIOD - 1e-9) * PERIOD  # the first sample at which the command can be seen
    assert found.values["delay.seconds"] == pytest.approx(seen_after - 0.5 * PERIOD, abs=2e-5)
    low, high = intervals(problem, parameters, found, 0)["delay.seconds"]
    assert low <= seconds <= high and high - low < 1.6 * PERIOD
    assert low > 0.0, "a command that is not late is seen a sample earlier"


@pytest.mark.parametrize("seconds", [0.008, 0.012, 0.0171, 0.0199, 0.033])
def test_the_interval_holds_the_delay_of_goals_that_come_faster_than_the_log(seconds: float) -> None:
    problem, parameters, found = told(seconds, held=False)
    low, high = intervals(problem, parameters, found, 0)["delay.seconds"]
    assert low <= seconds <= high


def test_a_fit_that_ended_a_sample_too_early_goes_on_to_where_the_loss_is_least() -> None:
    problem, parameters, found = told(0.033)
    early = {"delay.seconds": 0.028}
    off = Fit(early, problem.simulate([early])[0], 1e9)
    after = with_centred_times(problem, parameters, off)
    assert after.values["delay.seconds"] == pytest.approx(0.0325, abs=2e-5)
    assert after.cost == pytest.approx(found.cost)
    np.testing.assert_array_equal(after.simulated, found.simulated)


def test_a_range_of_delays_that_holds_the_believed_one_has_nothing_to_be_told() -> None:
    problem, parameters, found = told(0.012)
    believed = [model.with_values({"delay.seconds": 0.011}) for model in problem.models]
    known = replace(problem, models=tuple(believed))
    here = Fit({"delay.seconds": 0.013}, found.simulated, found.cost)
    assert with_centred_times(known, parameters, here).values == here.values
