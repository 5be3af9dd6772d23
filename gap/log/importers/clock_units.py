"""In which of several units a clock without one is: by what moves beside it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..types import Array
from ..units import FACTOR
from .evidence import CLOCKS, as_derivative
from .names import said
from .recording import Recording
from .unit_words import measures
from .velocities import FITS, NEAR

FASTEST_USUAL = 1e-4  # [s] sample period of the fastest logs that are usual
EPOCH = (9e8, 4.2e9)  # [s] since 1970, of 1998 to 2103
ANGLES, RATES = ("rad", "deg", "turn"), ("rad/s", "deg/s", "rpm", "turn/s")
"""Units that a position and a velocity may be in where they say none."""
COARSE = 0.1
"""Share of its whole motion that no joint moves in a ten-thousandth of a second, nor in a few."""


def rivals(step: float, possible: Sequence[str]) -> list[str]:
    """Units in which a clock's step is a usual sample period: as 0.5 is in s and in ms."""
    return [unit for unit in possible if step * CLOCKS[unit] > 0.99 * FASTEST_USUAL]


def told(recording: Recording, name: str, units: Sequence[str]) -> tuple[str, str]:
    """The unit of a clock and what tells it; empty where nothing does.

    Args:
        recording: with the clock.
        name: of its column.
        units: that it may be in, the longest first.
    """
    values = recording.columns[name]
    first = float(values[np.isfinite(values)][0])
    since = [unit for unit in units if EPOCH[0] < first * CLOCKS[unit] < EPOCH[1]]
    if len(since) == 1:
        return since[0], "since 1970"
    by_joint = _by_joint(recording)
    pairs = [(own["position"], own["velocity"]) for own in by_joint.values() if {"position", "velocity"} <= own.keys()]
    times = {unit: (values - first) * CLOCKS[unit] for unit in units}
    fits = {unit for unit, time in times.items() for pair in pairs if _is_derivative(recording, time, *pair)}
    if len(fits) == 1:
        return fits.pop(), "in it the velocity is the derivative of the position"
    positions = [own["position"] for own in by_joint.values() if "position" in own]
    if any(_jumps(recording.columns[position]) for position in positions):
        return units[0], "in a smaller unit a joint would move too far in one sample"
    return "", ""


def _by_joint(recording: Recording) -> dict[str, dict[str, str]]:
    """Columns of positions and velocities by joint and signal."""
    out: dict[str, dict[str, str]] = {}
    for name in recording.columns:
        spoken = said(name)
        joint, signal = spoken.joint, spoken.signal
        if name in recording.roles:
            joint, _, signal = recording.roles[name].rpartition(".")
        if signal in ("position", "velocity"):
            out.setdefault(joint, {}).setdefault(signal, name)
    return out


def _is_derivative(recording: Recording, time: Array, position: str, velocity: str) -> bool:
    """Whether a velocity is the derivative of a position, each in its unit or else in one that is usual."""
    slope = as_derivative(time, recording.columns[position], recording.columns[velocity])
    if slope.fit < FITS or slope.scale <= 0.0:
        return False
    sizes = [_factors(recording, name, usual) for name, usual in ((position, ANGLES), (velocity, RATES))]
    return any(abs(math.log(slope.scale * rate / angle)) < math.log(NEAR) for angle in sizes[0] for rate in sizes[1])


def _factors(recording: Recording, name: str, usual: Sequence[str]) -> list[float]:
    known = measures(recording.units.get(name) or said(name).unit, "angle", "way", "rate", "speed")
    return [known.factor] if known else [FACTOR[unit] for unit in usual]


def _jumps(position: Array) -> bool:
    """Whether a position (n,) goes through much of its motion from sample to sample, and not by its noise."""
    known = position[np.isfinite(position)]
    steps = np.diff(known)
    if len(steps) < 50 or np.ptp(known) == 0.0:
        return False
    smooth = float(np.mean(np.diff(steps) ** 2)) < float(np.mean(steps**2))
    return smooth and float(np.quantile(np.abs(steps), 0.99)) > COARSE * float(np.ptp(known))
