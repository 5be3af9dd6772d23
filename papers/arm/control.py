"""A robust controller for flexible joints, which the paper (paper 002) asks for in its conclusions.

A sliding mode with a boundary layer (Slotine and Li, Applied Nonlinear Control, 1991) on the links' encoders, around
the torque of the ideal robot:

    s    = de + lambda e                 e = q_d - q of the link
    tau  = tau_d + M(q_d) (lambda de + gain s) + rho sat(s / layer)

tau_d and the mass matrix M along the line are those of the model that is believed. The links are read, not the
rotors: a rotor of 5e-7 kg.m2 on its spring is too quick for feedback of a millisecond, and misses the deflection.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np

from ...common.errors import SealegsError
from ...envs.arm.kinematics import tool
from ...envs.arm.tables import JOINTS
from ...envs.arm.trajectory import Line
from .dynamics import PERFECT, Joints, Motion, ideal_torques, model_of

PERIOD = 0.001  # [s] of the controller, assumed
TICKS = 2**18  # per turn of a link's encoder, assumed
COARSE = 201  # times at which the mass matrix is computed


@dataclass(frozen=True)
class Robust:
    """Gains of the sliding mode; all assumed, from the bandwidth alone: nothing is tuned to a plant.

    Attributes:
        slope: lambda [1/s].
        gain: of s [1/s].
        bound: rho, torque that the model may be wrong by [N.m].
        layer: of s, in which the switch is linear [rad/s].
        sliding: False leaves feedforward and linear feedback: a computed torque controller.
    """

    slope: float = 30.0
    gain: float = 30.0
    bound: tuple[float, float, float] = (0.15, 0.15, 0.01)
    layer: tuple[float, float, float] = (0.02, 0.02, 0.02)
    sliding: bool = True


def closed_loop(
    controller: Robust | None,
    joints: Joints,
    params: Mapping[str, float] | None = None,
    believed: Mapping[str, float] | None = None,
    line: Line | None = None,
) -> Motion:
    """The arm with these joints on the line, under a controller or (None) the ideal robot's torques alone.

    Args:
        controller: its gains.
        joints: of the arm.
        params: numbers of the arm.
        believed: numbers that the controller takes it to have.
        line: to follow; default: the paper's, septic.

    Raises:
        SealegsError: the arm became unstable.
    """
    line = line or Line()
    model = model_of(joints, params)
    model.opt.timestep = PERIOD
    data, count = mujoco.MjData(model), round(line.seconds / PERIOD)
    links = [int(model.joint(name).qposadr[0]) for name in JOINTS]
    times = PERIOD * np.arange(count + 1)
    wanted, speeds, _ = line.joints(times)
    forward, masses = _believed(line, tuple(sorted((believed or {}).items())))
    angles, tick = np.zeros((count + 1, 3)), 2.0 * np.pi / TICKS
    before, speed = np.zeros(3), np.zeros(3)
    for k in range(count):
        torque = forward[k]
        if controller is not None:
            reading = np.round(data.qpos[links] / tick) * tick
            speed = speed + 0.2 * ((reading - before) / PERIOD - speed)  # 5 ms against the encoder's ticks
            before = reading
            error, change = wanted[k] - reading, speeds[k] - speed
            s = change + controller.slope * error
            torque = torque + masses[k] @ (controller.slope * change + controller.gain * s)
            if controller.sliding:
                torque = torque + np.array(controller.bound) * np.clip(s / np.array(controller.layer), -1.0, 1.0)
        data.ctrl[:] = torque
        mujoco.mj_step(model, data)
        angles[k + 1] = data.qpos[links]
    if not np.isfinite(angles).all() or any(w.number for w in data.warning[int(mujoco.mjtWarning.mjWARN_BADQPOS) :]):
        raise SealegsError("the simulation of the arm became unstable under its controller.")
    return Motion(times, angles, tool(angles, line.lengths), line.tool(times))


@cache
def _believed(line: Line, params: tuple[tuple[str, float], ...]) -> tuple[np.ndarray, np.ndarray]:
    """Torque of the ideal robot in the middle of each period (n, 3) [N.m], and its mass matrix (n, 3, 3) [kg.m2]."""
    times = PERIOD * np.arange(round(line.seconds / PERIOD) + 1)
    coarse = np.linspace(0.0, line.seconds, COARSE)
    masses = mass_matrices(line.joints(coarse)[0], dict(params)).reshape(COARSE, 9)
    between = np.stack([np.interp(times, coarse, column) for column in masses.T], axis=1)
    return ideal_torques(line, dict(params))(times + 0.5 * PERIOD), between.reshape(-1, 3, 3)


def mass_matrices(angles: np.ndarray, params: Mapping[str, float] | None = None) -> np.ndarray:
    """Mass matrix of the ideal robot (n, 3, 3) [kg.m2] at joint angles (n, 3) [rad]."""
    model = model_of(PERFECT, params)
    data, found = mujoco.MjData(model), np.empty((len(angles), 3, 3))
    for k, place in enumerate(angles):
        data.qpos[:] = place
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, found[k])
    return found
