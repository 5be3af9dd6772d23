"""Runs for an actuator net from a simulated chain: a pendulum that is commanded and pushed about.

The pushes matter: without them error and speed are tied to each other by the load, and a net would learn the load.
"""

from __future__ import annotations

import mujoco
import numpy as np

from ..common.errors import SealegsError
from .chain import GIVING, Chain
from .drivetrain import Drivetrain
from .layout import S_TORQUE
from .net_training import TrainingRun

STEP = 0.001  # [s]
LOADS = ((0.05, 0.05), (0.3, 0.08), (0.5, 0.12), (1.0, 0.15))  # mass [kg] and length [m] (assumed)
PENDULUM = """<mujoco><option timestep="{step}" integrator="RK4"/><worldbody><body><joint name="shaft" axis="0 1 0"/>
<inertial pos="0 0 -{length}" mass="{mass}" diaginertia="1e-6 1e-6 1e-6"/></body></worldbody></mujoco>"""
BEHIND = ("friction", *GIVING, "encoder")


def simulated_runs(chain: Chain, count: int, seconds: float, rate: float, seed: int) -> list[TrainingRun]:
    """Runs of a chain under random commands and pushes, with the motor's torque as target.

    Friction and what stands behind it are not part of the target: they stay stages of their own, so that a joint with a
    net sticks.

    Args:
        chain: to learn.
        count: runs.
        seconds: of each [s].
        rate: samples per second [Hz]; 1000 must be a multiple of it.
        seed: of commands and pushes.

    Raises:
        SealegsError: the rate does not divide the simulation's.
    """
    every = round(1.0 / (rate * STEP))
    if every < 1 or abs(every * STEP * rate - 1.0) > 1e-9:
        raise SealegsError(
            f"a rate of {rate:g} Hz does not divide the simulation's 1000 Hz; take 1000, 500, 250, 200 or 100."
        )
    rng = np.random.default_rng(seed)
    motor = Chain(tuple(stage for stage in chain.stages if stage.name not in GIVING), chain.label)
    runs = []
    for number in range(count):
        mass, length = LOADS[number % len(LOADS)]
        spec = mujoco.MjSpec.from_string(PENDULUM.format(step=STEP, mass=mass, length=length))
        drivetrain = Drivetrain(spec, {"shaft": motor})
        samples = round(seconds * rate)
        goal = commands(rng, samples, rate)
        push = rng.uniform(0.0, 1.5) * smooth_noise(rng, samples, rate, rng.uniform(1.0, 8.0))
        rows = _simulate(drivetrain, goal, push, every)
        time = np.arange(samples) / rate
        runs.append(TrainingRun(f"simulated {number}", time, goal, rows[:, 0], rows[:, 1], rows[:, 2]))
    return runs


def _simulate(drivetrain: Drivetrain, goal: np.ndarray, push: np.ndarray, every: int) -> np.ndarray:
    """Motor position, speed and torque at each sample, (n, 3)."""
    model, data = drivetrain.model, mujoco.MjData(drivetrain.model)
    rows = np.empty((len(goal), 3))
    for k, (command, torque) in enumerate(zip(goal, push, strict=True)):
        data.ctrl[0], data.qfrc_applied[0] = command, torque
        mujoco.mj_forward(model, data)  # the torque at this sample
        rows[k] = data.qpos[0], data.qvel[0], drivetrain.state("shaft", data.userdata, S_TORQUE)
        mujoco.mj_step(model, data, every)
    return rows


def commands(rng: np.random.Generator, samples: int, rate: float) -> np.ndarray:
    """Random position goals [rad]:

    Smooth noise and held steps of several sizes, in turns; some at 50 Hz, as a policy gives.
    """
    goal = np.empty(samples)
    at = 0
    while at < samples:
        span = min(samples - at, int(rate * rng.uniform(1.0, 3.0)))
        size = rng.choice((0.1, 0.4, 1.0, 2.0))
        if rng.random() < 0.5:
            part = size * smooth_noise(rng, span, rate, rng.uniform(0.5, 5.0))
        else:
            hold = max(1, int(rate * rng.uniform(0.05, 0.5)))
            part = np.repeat(rng.uniform(-size, size, span // hold + 1), hold)[:span]
        held = max(1, round(rate / 50.0)) if rng.random() < 0.5 else 1
        goal[at : at + span] = np.repeat(part[::held], held)[:span]
        at += span
    return goal


def smooth_noise(rng: np.random.Generator, samples: int, rate: float, bandwidth: float) -> np.ndarray:
    """Noise of unit deviation below ``bandwidth`` [Hz], (samples,)."""
    from scipy.signal import butter, sosfilt

    sections = butter(2, min(bandwidth, 0.45 * rate), fs=rate, output="sos")
    noise = np.asarray(sosfilt(sections, rng.standard_normal(samples + 4 * int(rate)))[4 * int(rate) :])
    return noise / max(float(noise.std()), 1e-9)
