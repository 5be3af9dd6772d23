"""A hidden wheel on a servo in speed mode: its firmware holds a speed, and a flywheel hangs on its shaft.

Nothing here is shared with the simulator under test: the speed loop is a digital one at 1 kHz, dry friction is
integrated by events at 20 kHz, and what is logged is read at jittered times, with noise and in ticks.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from .recording import Recording

STEP = 5e-5  # [s]
FIRMWARE_STEPS = 20  # of the integration, between two looks of the speed loop: 1 ms
PERIOD, JITTER = 0.005, 3e-4  # [s] of the log
TICK = 2.0 * math.pi / 4096
NOISE = 3.9e-4  # [rad] before ticks


class Wheel(NamedTuple):
    """One hidden wheel, values at the shaft."""

    delay: float = 0.005
    goal_scale: float = 1.0  # of the speed that the firmware makes of a goal
    gain: float = 0.25  # [s/rad] duty per speed error
    integral: float = 5.3  # [1/rad]
    duty_limit: float = 0.97
    volts: float = 7.4
    motor_constant: float = 1.2
    resistance: float = 2.7
    armature: float = 0.026
    coulomb: float = 0.052
    viscous: float = 0.059
    inertia: float = 0.004  # [kg.m2] of the flywheel


@numba.njit(cache=True)
def simulate(m, goal_time, goal, duration):
    """Integrate from rest: rows of time, angle, speed, duty and current, every 5 steps."""
    steps = int(duration / STEP)
    record = np.empty((steps // 5 + 1, 5))
    inertia, q, v, summed, duty, command, wanted = m.armature + m.inertia, 0.0, 0.0, 0.0, 0.0, -1, 0.0
    for step in range(steps + 1):
        time = step * STEP
        while command + 1 < len(goal_time) and goal_time[command + 1] + m.delay <= time:
            command += 1
            wanted = m.goal_scale * goal[command]
        if step % FIRMWARE_STEPS == 0:
            error = wanted - v
            summed = min(max(summed + m.integral * error * STEP * FIRMWARE_STEPS, -1.0), 1.0)
            duty = min(max(m.gain * error + summed, -m.duty_limit), m.duty_limit)
        current = (duty * m.volts - m.motor_constant * v) / m.resistance
        if step % 5 == 0:
            row = record[step // 5]
            row[0], row[1], row[2], row[3], row[4] = time, q, v, duty, current
        torque = m.motor_constant * current - m.viscous * v
        if v == 0.0 and abs(torque) <= m.coulomb:
            continue
        side = math.copysign(1.0, torque if v == 0.0 else v)
        then = v + STEP * (torque - side * m.coulomb) / inertia
        if v != 0.0 and then * v < 0.0:
            then = 0.0  # it comes to rest within the step
        q, v = q + 0.5 * STEP * (v + then), then
    return record


def speeds(time: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Speed goals [rad/s]: jumps, ramps and a chirp, forwards and backwards, with rests between."""
    levels = random.uniform(-4.0, 4.0, 64)
    jumps = np.where((time / 0.8).astype(int) % 4 == 3, 0.0, levels[(time / 0.8).astype(int) % 64])
    slow = 1.2 * (4.0 * np.abs(time / 5.0 % 1.0 - 0.5) - 1.0)
    sweep = 2.5 * np.sin(2.0 * np.pi * (0.2 * (time % 8.0) + 0.1 * (time % 8.0) ** 2))
    return np.choose((time / 8.0).astype(int) % 3, [jumps, slow, sweep])


def record_wheel(
    robot: str,
    wheel: Wheel | None = None,
    *,
    seed: int = 0,
    runs: int = 3,
    duration: float = 24.0,
    joint: str = "wheel",
) -> list[Recording]:
    """Record runs of a wheel that whoever logs it takes for the servo of :func:`nominal`."""
    found = []
    for run in range(runs):
        random = np.random.default_rng([seed, run])
        count = int(duration / PERIOD)
        time = PERIOD * (1.0 + np.arange(count)) + np.clip(random.normal(0.0, JITTER, count), -1.5e-3, 1.5e-3)
        goal = speeds(time, random)
        record = simulate(wheel or Wheel(), time, goal, time[-1] + 2e-3)
        angle = np.interp(time, record[:, 0], record[:, 1]) + random.normal(0.0, NOISE, count)
        held = np.clip(np.searchsorted(record[:, 0], time, side="right") - 1, 0, len(record) - 1)
        signals = {
            "goal_velocity": goal,
            "position": TICK * np.round(angle / TICK),
            "duty": np.round(record[held, 3], 3),
            "current": 0.0065 * np.round((record[held, 4] + random.normal(0.0, 0.0065, count)) / 0.0065),
        }
        found.append(Recording(f"wheel{run}", time, {joint: signals}, {}, robot, {}, {joint: nominal()}))
    return found


def nominal() -> list[dict[str, dict[str, float]]]:
    """The chain that its sidecar believes in."""
    m = Wheel()
    motor = {"motor_constant": m.motor_constant, "resistance": m.resistance, "armature": m.armature}
    return [
        {"delay": {"seconds": m.delay}},
        {"velocity_pi": {"gain": m.gain, "integral": m.integral}},
        {"duty_limit": {"limit": m.duty_limit}},
        {"supply": {"volts": m.volts, "resistance": 0.0}},
        {"dc_motor": motor},
        {"friction": {"coulomb": m.coulomb, "viscous": m.viscous}},
        {"encoder": {"ticks": 4096}},
    ]
