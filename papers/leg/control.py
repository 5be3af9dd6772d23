"""Controllers of the leg, compared on the same paths: PID, and the model based control of paper 000, section 4.4.

All of them run in the servo's firmware every 2 ms. What a model adds is a duty in advance, which the host sends as a
shift of the goal: ``goal = reference + (duty + damping speed) / gain``. The model is the paper's simplified one: a
constant equivalent inertia (17) to (19), a perturbation that is linear in the horizontal lengthening (28) to (30), and,
where asked for, the friction (16) of the reference's motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from mujoco.batch import Batch

from ...actuators import Chain
from ...actuators.stages.meshing import Meshing
from ...common.errors import SealegsError
from ...envs.leg import path
from ...envs.leg.inertia import rotors
from ...envs.leg.kinematics import angles, foot, lengthening
from ...envs.leg.robot import JOINTS, LEG, chains_of
from .dynamics import constants, coriolis, gravity, mass_matrix

PERIOD = 0.002  # [s] of goals, and of the digital controllers
SETTLING = 0.2  # [s] of the start that no figure looks at
STEP = 1e-3  # [s] over which the reference is differentiated


@dataclass(frozen=True)
class Lines:
    """The simplified perturbation: torque of joint ``k`` at the joint is ``slope[k] R_h + offset[k]`` [N.m]."""

    slope: tuple[float, float, float]
    offset: tuple[float, float, float]


@dataclass(frozen=True)
class Model:
    """What the host knows of the leg.

    Attributes:
        perturbation: the simplified one (28) to (30), or ``whole``, that of (25); None: none is compensated.
        friction: whether (16) is compensated; ``sliding``: its Coulomb and viscous parts alone.
        inertia: whether the constant equivalent inertia is; ``rotors``: the part of it that turns in motors and gears.
    """

    perturbation: Lines | Literal["whole"] | None
    friction: bool | Literal["sliding"]
    inertia: bool | Literal["rotors"] = True


def paths(count: int, speed: tuple[float, float] = (0.05, 0.15), seed: int = 0) -> np.ndarray:
    """Commands of random paths (count, 7), as the environment draws them."""
    random = np.random.default_rng(seed).random((count, 7))
    return path.drawn(random[:, 1:], speed[0] + random[:, 0] * (speed[1] - speed[0]))


def friction_torque(chain: Chain, q: np.ndarray, speed: np.ndarray, sliding: bool = False) -> np.ndarray:
    """Friction (16) with the viscous part, at the joint, of the same shape as ``q`` [N.m].

    Args:
        chain: of the joint.
        q, speed: of the joint [rad], [rad/s].
        sliding: leaves Coulomb and viscous friction alone, without static and meshing friction.

    Raises:
        SealegsError: the chain has no ``meshing``.
    """
    stage = chain.find("meshing")
    if not isinstance(stage, Meshing):
        raise SealegsError(f"actuator '{chain.label}' has no 'meshing' to compensate.")
    n = stage.law_values(chain)
    size, total = np.abs(speed), np.zeros_like(q)
    for way, moving in (("positive", speed > 0.0), ("negative", speed < 0.0)):
        limit = n[f"coulomb_{way}"] + n[f"viscous_{way}"] * size
        if not sliding:
            drop = np.exp(-size / n[f"stribeck_velocity_{way}"])
            limit = limit + (n[f"breakaway_{way}"] - n[f"coulomb_{way}"]) * drop
            limit = limit + n[f"ripple_1_{way}"] * np.sin(n["frequency_1"] * q + n["phase_1"])
            for k in (2, 3):
                amplitude = n[f"ripple_{k}_{way}"] * np.exp(-n[f"decay_{k}_{way}"] * size)
                limit = limit + amplitude * np.sin(n[f"frequency_{k}"] * q + n[f"phase_{k}"])
        total += np.where(moving, limit, 0.0)
    return total * np.sign(speed)


def advance_duty(
    chains: Mapping[str, Chain], model: Model, q: np.ndarray, speed: np.ndarray, acceleration: np.ndarray
) -> np.ndarray:
    """Duty that the model asks for in advance, from the reference's motion, all (..., 3)."""
    values = LEG.parameters()
    k = constants(values)
    torque = np.zeros_like(q)
    if model.inertia:
        links = 0.0 if model.inertia == "rotors" else np.array([k.h, k.l, k.m])
        torque += (rotors(values) + links) * acceleration
    if model.perturbation == "whole":
        constant = np.array([k.h, k.l, k.m]) * acceleration
        torque += np.einsum("...ij,...j->...i", mass_matrix(k, q), acceleration) - constant
        torque += coriolis(k, q, speed) + gravity(k, q)
    elif model.perturbation is not None:
        reach = lengthening(values, q)[..., None]
        torque += np.array(model.perturbation.slope) * reach + np.array(model.perturbation.offset)
    duty = np.empty_like(q)
    for j, name in enumerate(JOINTS):
        chain = chains[name]
        motor, ratio, volts = chain.find("dc_motor"), chain.gear_ratio(), chain.find("supply").volts
        asked = torque[..., j]
        if model.friction:
            asked = asked + friction_torque(chain, q[..., j], speed[..., j], model.friction == "sliding")
        voltage = motor.resistance * asked / (motor.motor_constant * ratio) + motor.back_emf * ratio * speed[..., j]
        duty[..., j] = voltage / volts
    return duty


def with_gains(gains: Mapping[str, Mapping[str, float]]) -> dict[str, Chain]:
    """The printed chains with other gains of the controller: by joint, ``gain``, ``integral`` and ``damping``."""
    chains = chains_of("silo4")
    for name, values in gains.items():
        for key, value in values.items():
            chains[name] = chains[name].with_value(f"position_pi.{key}", float(value))
    return chains


def errors(
    chains: Mapping[str, Chain],
    command: np.ndarray,
    seconds: float = 3.0,
    preview: float = 0.0,
    model: Model | None = None,
) -> np.ndarray:
    """Distance of the foot from its path every 2 ms, from :data:`SETTLING` on (samples, n) [m].

    Args:
        chains: of the joints.
        command: paths (n, 7).
        seconds: of each.
        preview: by which goals are ahead [s].
        model: that computes a duty in advance.
    """
    values = LEG.parameters()
    drivetrain = LEG.drivetrain(dict(chains))
    count, samples = len(command), round(seconds / PERIOD)
    every = round(PERIOD / drivetrain.model.opt.timestep)
    batch = Batch(drivetrain.model, count, 0)
    qpos, ctrl = batch.bind("qpos"), batch.bind("ctrl")
    time = np.arange(samples + 1) * PERIOD

    def reference(shift: float) -> np.ndarray:
        return np.stack([angles(values, path.position(command, np.full(count, t + shift))) for t in time])

    goals = reference(preview)
    if model is not None:
        ahead, behind = reference(preview + STEP), reference(preview - STEP)
        speed, acceleration = (ahead - behind) / (2.0 * STEP), (ahead - 2.0 * goals + behind) / STEP**2
        duty = advance_duty(chains, model, goals, speed, acceleration)
        for j, name in enumerate(JOINTS):
            stage = chains[name].find("position_pi")
            goals[..., j] += (duty[..., j] + stage.damping * speed[..., j]) / stage.gain
    start = angles(values, path.position(command, np.zeros(count)))
    for j, name in enumerate(JOINTS):
        drivetrain.set_position(name, qpos, start[:, j])
    ctrl[:] = goals[0]
    batch.forward()
    columns = [int(drivetrain.model.joint(name).qposadr[0]) for name in JOINTS]
    found = np.empty((samples, count))
    for k in range(samples):
        ctrl[:] = goals[k]
        batch.step(nstep=every)
        wanted = path.position(command, np.full(count, time[k + 1]))
        found[k] = np.linalg.norm(foot(values, qpos[:, columns]) - wanted, axis=1)
    return found[round(SETTLING / PERIOD) :]


def rms(values: np.ndarray) -> float:
    """Root mean square; infinite where the simulation went bad."""
    return float(np.sqrt(np.mean(np.square(values)))) if np.isfinite(values).all() else float("inf")
