"""Goal trajectories of the hidden bench, each a few seconds long and seeded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SEGMENT = 6.0
"""Length of one excitation [s]."""
RAMP = 0.3
"""Time to move from one excitation to the next [s]."""


def chirp(t: Array, rng: np.random.Generator) -> Array:
    """Sine from 0.1 to 2 Hz, amplitude falling from 0.55 to 0.3 rad."""
    low, high = 0.1, rng.uniform(1.7, 2.1)
    phase = 2 * np.pi * (low * t + (high - low) * t**2 / (2 * SEGMENT))
    return np.linspace(0.55, 0.3, len(t)) * np.sin(phase) * rng.choice([-1.0, 1.0])


def multisine(t: Array, rng: np.random.Generator) -> Array:
    """Six sines between 0.15 and 2.2 Hz with random phases."""
    frequencies = np.array([0.17, 0.33, 0.67, 1.0, 1.5, 2.17])
    amplitudes = 0.3 / np.sqrt(1.0 + (frequencies / 0.4) ** 2)
    phases = rng.uniform(0, 2 * np.pi, len(frequencies))
    return 1.3 * (amplitudes[:, None] * np.sin(2 * np.pi * frequencies[:, None] * t + phases[:, None])).sum(axis=0)


def triangle(t: Array, rng: np.random.Generator) -> Array:
    """Slow triangle, +-0.5 rad at about 0.35 rad/s."""
    period = rng.uniform(5.4, 6.6)
    x = (t / period + rng.uniform(0, 1)) % 1.0
    return 0.5 * (4 * np.abs(x - 0.5) - 1.0)


def steps(t: Array, rng: np.random.Generator) -> Array:
    """A new random goal within +-1 rad every 0.75 s."""
    levels = rng.uniform(-1.0, 1.0, int(np.ceil(SEGMENT / 0.75)) + 1)
    return levels[(t / 0.75).astype(int)]


def lift_and_drop(t: Array, rng: np.random.Generator) -> Array:
    """Lift in two seconds, hold, let the goal fall back to hanging at once."""
    height = rng.uniform(1.1, 1.5) * rng.choice([-1.0, 1.0])
    x = t % 3.0
    return np.where(x < 1.5, height * 0.5 * (1 - np.cos(np.pi * np.minimum(x / 1.2, 1.0))), 0.0)


def hold(t: Array, rng: np.random.Generator) -> Array:
    """Hold three random poses."""
    levels = rng.uniform(-1.3, 1.3, 4)
    return levels[(t / 2.0).astype(int)]


EXCITATIONS = {f.__name__: f for f in (chirp, multisine, triangle, steps, lift_and_drop, hold)}
DEFAULT_SCHEDULES = (
    ("chirp", "steps", "triangle", "multisine"),
    ("multisine", "triangle", "steps", "chirp"),
    ("triangle", "lift_and_drop", "chirp", "hold"),
)


def trajectory(names: tuple[str, ...], t: Array, rng: np.random.Generator) -> Array:
    """Goal [rad] at the times ``t`` [s] for excitations one after the other, joined by ramps."""
    goal = np.zeros_like(t)
    before = 0.0
    for index, name in enumerate(names):
        inside = (
            (t >= index * SEGMENT) & (t < (index + 1) * SEGMENT) if index + 1 < len(names) else t >= index * SEGMENT
        )
        if not inside.any():
            break
        local = np.minimum(t[inside] - index * SEGMENT, SEGMENT - 1e-9)
        part = EXCITATIONS[name](local, rng)
        blend = np.clip(local / RAMP, 0.0, 1.0)
        goal[inside] = before + blend * (part - before) if name != "steps" else part
        before = goal[inside][-1]
    return goal
