"""What no cause explains: how much is left, and what it depends on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from actuators.chain import load_chain
from gap.joint_model import JointModel
from gap.problem import Problem, lay_out
from gap.structure import Structure, structure
from gap.units import cut
from tests.plant import NOISE_FLOOR, hidden_bench

FACTORS = {
    "motor_constant": "dc_motor.motor_constant*",
    "resistance": "dc_motor.resistance*",
    "armature": "dc_motor.armature*",
    "coulomb": "friction.coulomb*",
    "viscous": "friction.viscous*",
    "command_delay": "delay.seconds*",
}


def of_true_model(effects: dict[str, Any], seed: int) -> tuple[Problem, np.ndarray]:
    """The data, and what a model with the machine's true numbers, but none of its hidden effects, makes of them."""
    data, truth = hidden_bench(effects, seed, ("light", "medium", "heavy"))
    models = [JointModel(load_chain(run.actuators["servo"])) for run in data.runs]
    problem = lay_out(data.runs, "servo", models, cut(data.runs, "servo"), {"position": 1.0 / NOISE_FLOOR})
    return problem, problem.simulate([{FACTORS[name]: value for name, value in truth["nominal_factors"].items()}])[0]


def left(effects: dict[str, Any], seed: int) -> Structure:
    return structure(*of_true_model(effects, seed))


def test_a_right_model_leaves_noise() -> None:
    found = left({}, 31)
    assert not found.noticed
    assert found.sentence == "What is left is noise."


@pytest.mark.parametrize(
    ("stranger", "signal"), [("stranger.air_drag", "speed"), ("stranger.friction_drift", "time since the start")]
)
def test_what_is_left_is_traced_to_the_signal_it_depends_on(stranger: str, signal: str) -> None:
    found = left({stranger: "moderate"}, 32)
    assert found.noticed
    assert signal in [name for name, _ in found.depends_on]
    assert signal in found.sentence


def test_events_at_random_times_depend_on_no_signal() -> None:
    found = left({"stranger.jams": "clear"}, 33)
    assert found.noticed
    assert found.depends_on == ()
    assert "random times" in found.sentence


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
