"""Logs of the hidden bench with other columns than were recorded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.interpolate import make_smoothing_spline
from sealegs.gap.log.types import MeasuredRun, MeasuredSet

JOINT = "servo"
"""Joint of the hidden bench."""


def with_log(run: MeasuredRun, **signals: np.ndarray | None) -> MeasuredRun:
    """The run with other columns of its joint, each (n,); None: without it."""
    return replace(run, joints={JOINT: replace(run.joints[JOINT], **signals)})


def signal(run: MeasuredRun, name: str) -> np.ndarray:
    """A column of the run's joint (n,)."""
    return run.joints[JOINT].signals()[name]


def with_torque(
    data: MeasuredSet, truth: Mapping[str, Any], delay: float = 0.0, factor: float = 1.0, armature: float = 0.0
) -> MeasuredSet:
    """Logs of a bench with the torque that its true motion, an armature [kg.m2] and some dry friction need, logged late
    by a delay [s] and with a factor.
    """
    rng, runs = np.random.default_rng(0), []
    for run, position in zip(data.runs, truth["clean_position"], strict=True):
        motion = make_smoothing_spline(run.time, position, lam=1e-9)
        velocity, acceleration = motion.derivative(1)(run.time), motion.derivative(2)(run.time)
        mass, length, arm = (run.robot_params[key] for key in ("mass", "length", "arm_mass"))
        torque = (mass * length**2 + arm * length**2 / 3 + armature) * acceleration + 0.05 * np.tanh(velocity / 0.1)
        torque += 9.81 * length * (mass + arm / 2) * np.sin(position) + rng.normal(0, 0.005, len(position))
        runs.append(with_log(run, torque=factor * np.interp(run.time - delay, run.time, torque)))
    return replace(data, runs=tuple(runs))
