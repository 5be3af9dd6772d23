"""The ground of paper 003, table VI, and how close the engine's contact comes to it.

The printed law is that of the reference [26] of the paper (Plestan and others, on stable walking of a biped), with
depth z and its speed z':

    F_n = lambda_b |z|^n + lambda_a |z|^n z'        F_t = mu F_n, mu a bristle of stiffness sigma_h0

reconstructed from that literature, as the paper prints only its parameters; 4.38e7, the fourth parameter of the normal
force, has lost its name and is not used. The engine's contact was fitted to it: solref and solimp such that the force
over depth and speed of a biped that drops from 5 cm and stands is that of the law.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from ...envs.biped.drive import ANGLE, SHAPE
from ...envs.biped.parameters import SIDES
from ...envs.biped.robot import BIPED, coordinate, foot

LAMBDA_A = 3.0e6  # [N.s/m2.5], table VI
LAMBDA_B = 4.5e6  # [N/m1.5], table VI
EXPONENT = 1.5  # table VI
DROP = 0.05  # [m]
DURATION = 0.5  # [s]


def normal_force(depth: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Force of the printed ground [N] at a depth [m] that grows by ``speed`` [m/s]; it never pulls."""
    stiff = np.maximum(depth, 0.0) ** EXPONENT
    return np.maximum(LAMBDA_B * stiff + LAMBDA_A * stiff * speed, 0.0)


@dataclass(frozen=True)
class Landing:
    """Contact of both feet while the biped drops and stands.

    Attributes:
        depth: (n,) [m].
        speed: of the depth (n,) [m/s].
        force: normal, in the engine (n,) [N].
    """

    depth: np.ndarray
    speed: np.ndarray
    force: np.ndarray

    @property
    def misfit(self) -> float:
        """Difference of engine and printed law, rms [N]."""
        return float(np.sqrt(np.mean((self.force - normal_force(self.depth, self.speed)) ** 2)))


def land(params: Mapping[str, float] | None = None) -> Landing:
    """Drop the biped from 5 cm onto its feet, with its own chains and perhaps other contact numbers."""
    drivetrain = BIPED.drivetrain(None, params)
    model, data = drivetrain.model, mujoco.MjData(drivetrain.model)
    angle, shape = 0.26, 0.21
    for side, sign in zip(SIDES, (-1.0, 1.0), strict=True):
        drivetrain.set_position(coordinate(side, SHAPE), data.qpos, shape)
        drivetrain.set_position(coordinate(side, ANGLE), data.qpos, sign * angle)
    data.ctrl[:] = -angle, shape, angle, shape
    feet = [model.geom(foot(side)).id for side in SIDES]
    data.qpos[1] = 1.0
    mujoco.mj_kinematics(model, data)
    data.qpos[1] += DROP - min(float(data.geom_xpos[number, 2] - model.geom_size[number, 0]) for number in feet)
    rows, before, force = [], dict.fromkeys(feet, np.nan), np.zeros(6)
    for _ in range(round(DURATION / model.opt.timestep)):
        mujoco.mj_step(model, data)
        now = dict.fromkeys(feet, np.nan)
        for contact in range(data.ncon):
            number = int(max(data.contact.geom[contact]))
            mujoco.mj_contactForce(model, data, contact, force)
            now[number] = depth = max(-float(data.contact.dist[contact]), 0.0)
            rows.append((depth, (depth - before[number]) / model.opt.timestep, force[0]))
        before = now
    table = np.array(rows)
    depth, speed, pushed = table[np.isfinite(table).all(axis=1)].T
    return Landing(depth, speed, pushed)
