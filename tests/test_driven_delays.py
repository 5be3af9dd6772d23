"""A command that is late by whole samples, at a joint whose link moves as measured."""

from __future__ import annotations

import numpy as np
from sealegs.gap.diagnose import diagnose
from sealegs.gap.log.arrays import measured_set
from sealegs.gap.log.types import MeasuredSet

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


def test_a_command_that_is_late_by_whole_samples_is_found_along_a_measured_motion() -> None:
    """Between the samples a fit had no slope: 0.008 s (0.004 to 0.2) with a confidence of 0 % in place of 0.02 s."""
    found = diagnose(walked(ROWS), causes=["drive.delay", "friction.coulomb", "drive.gain"]).joint("hip")
    assert [cause.name for cause in found.causes] == ["drive.delay"]
    delay = found.causes[0].parameters["delay.seconds"]
    assert abs(delay.value - ROWS * PERIOD) < PERIOD and delay.high < (ROWS + 2) * PERIOD
    assert found.causes[0].confidence > 0.9


def test_a_command_that_is_not_late_has_no_delay() -> None:
    assert not diagnose(walked(0), causes=["drive.delay", "friction.coulomb", "drive.gain"]).joint("hip").causes
