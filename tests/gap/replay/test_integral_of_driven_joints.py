"""An integral of a joint that moves as measured begins with what its drive said, in every piece of a log.

The plant of this file: a joint that something moves as it will, and a PI controller written out again.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.diagnose import diagnose
from sealegs.gap.log.arrays import measured_set
from sealegs.gap.log.parts import cut
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.replay.driven import DrivenProblem, driven_problem, read_before_goal
from sealegs.gap.replay.joint_model import JointModel

PERIOD = 0.005
VOLTS, RESISTANCE, CONSTANT = 12.0, 2.4, 1.4
COLUMNS = ("duty", "current", "torque")


def chain(period: float) -> list[dict[str, Any]]:
    return [
        {"position_pi": {"gain": 6.0, "integral": 12.0, "period": period}},
        {"duty_limit": {"limit": 1.0}},
        {"supply": {"volts": VOLTS}},
        {"dc_motor": {"motor_constant": CONSTANT, "resistance": RESISTANCE, "armature": 0.01}},
    ]


@functools.cache
def walked(column: str, period: float, gain: float = 6.0) -> MeasuredSet:
    """Two runs whose integral has been at work before; ``period`` of the controller [s], 0: continuous."""
    tables = []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        steps = 10  # of the plant in a row
        fine = PERIOD / steps * np.arange(2400 * steps)
        goal, angle, speed = np.zeros((3, len(fine)))
        for hertz, phase in zip((0.4, 0.9, 1.7, 2.6), rng.uniform(0.0, 6.0, 4), strict=True):
            w = 2.0 * np.pi * hertz
            held = PERIOD * np.floor(fine / PERIOD + 1e-9)
            goal += 0.15 * np.sin(w * held + phase)
            angle += 0.14 * np.sin(w * (fine - 0.02) + phase)
            speed += 0.14 * w * np.cos(w * (fine - 0.02) + phase)
        every = max(round(period * steps / PERIOD), 1)
        integral, now, duty = 0.3, 0.0, np.zeros(len(fine))
        for k in range(len(fine)):
            if k % every == 0:
                integral += 12.0 * (goal[k] - angle[k]) * every * PERIOD / steps
                now = gain * (goal[k] - angle[k]) + integral
            duty[k] = now
        duty = np.clip(duty, -1.0, 1.0)
        current = (VOLTS * duty - CONSTANT * speed) / RESISTANCE
        logged = {"duty": duty, "current": current, "torque": CONSTANT * current}[column][::steps]
        noise = rng.normal(size=(2, 2400))
        tables.append({
            "time": fine[::steps], "hip.goal": goal[::steps], "hip.position": angle[::steps] + 1e-5 * noise[0],
            f"hip.{column}": logged + 0.005 * noise[1],
        })  # fmt: skip
    return measured_set(tables, {"robot": "walker", "actuators": {"hip": chain(period)}, "meta": {"torque": "drive"}})


def driven(data: MeasuredSet) -> DrivenProblem:
    models = [JointModel(load_chain(run.actuators["hip"])) for run in data.runs]
    return driven_problem(data.runs, "hip", models, cut(data.runs, "hip"), 1e-5)


def error(data: MeasuredSet, values: dict[str, float]) -> float:
    """Rms error over the rms noise of the column."""
    problem = driven(data)
    return float(np.sqrt(np.mean(problem.position_error(problem.simulate([values])[0]) ** 2))) / 0.005


@pytest.mark.parametrize("column", COLUMNS)
@pytest.mark.parametrize("period", [0.0, PERIOD])
def test_a_right_model_of_an_integral_leaves_the_noise(column: str, period: float) -> None:
    """Each piece began with an integral of zero, and an error as large as the duty was left to the end."""
    assert error(walked(column, period), {}) < 2.0


@pytest.mark.parametrize("column", COLUMNS)
def test_the_right_gain_beside_an_integral_leaves_the_noise_and_the_believed_one_does_not(column: str) -> None:
    data = walked(column, PERIOD, gain=4.0)
    assert error(data, {"position_pi.gain": 4.0}) < 2.0 and error(data, {}) > 5.0


@pytest.mark.parametrize("gain", [6.0, 4.0])
@pytest.mark.parametrize("period", [0.0, PERIOD])
def test_a_wrong_gain_beside_an_integral_is_no_early_reading(period: float, gain: float) -> None:
    assert not read_before_goal(driven(walked("duty", period, gain=gain)))


@pytest.mark.long
def test_an_integral_is_no_cause_along_a_measured_motion_and_a_gain_is() -> None:
    """A null was told as a gap that no known cause explains."""
    causes = ["drive.gain", "drive.offset", "drive.delay", "sensor.offset", "drive.goal_filter"]
    null = diagnose(walked("duty", PERIOD), causes=causes).joint("hip")
    assert not null.causes and "explains" not in null.sentence, null.text
    found = diagnose(walked("duty", PERIOD, gain=4.0), causes=causes).joint("hip")
    assert [cause.name for cause in found.causes] == ["drive.gain"], found.text
    assert found.causes[0].parameters["position_pi.gain"].value == pytest.approx(4.0, rel=0.03)
