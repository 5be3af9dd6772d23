"""The ground of paper 001, equations (19) and (20), as the engine's own contact.

Hunt and Crossley's normal force is ``K d^1.5`` at a penetration ``d`` (Hertz, 4.2.1). At rest the engine's contact
pushes with ``S D^2 d / (w^2 (1 - D) A)``. ``D(d)`` is its impedance between ``D_0`` and ``w``, ``S`` its stiffness, and
``A`` the inverse mass that it assigns to the foot. The impedance below is fitted so that this is
``d^1.5`` within 3 % from 0.6 to 4 mm; ``S`` then follows from the penetration that the paper prints.
"""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from ...actuators.gravity import GRAVITY

SOLIMP = (0.358, 0.527, 0.024, 0.025, 12.0)
"""Impedance at touch and at full depth, that depth [m], and shape."""
EXPONENT = 1.5  # p_K: "chosen to fit with the Hertz's theory"
SUPPORTS = 3  # legs that stand where the penetration is printed


def impedance(depth: np.ndarray | float) -> np.ndarray:
    """Impedance at a penetration [m], as the engine computes it from :data:`SOLIMP`."""
    low, high, width, middle, power = SOLIMP
    x = np.minimum(np.abs(depth) / width, 1.0)
    early = x**power / middle ** (power - 1.0)
    late = 1.0 - (1.0 - x) ** power / (1.0 - middle) ** (power - 1.0)
    return low + (high - low) * np.where(x <= middle, early, late)


def shape(depth: np.ndarray | float) -> np.ndarray:
    """Force at rest over ``S / A``, [m]."""
    reached = impedance(depth)
    return reached**2 * np.asarray(depth) / (SOLIMP[1] ** 2 * (1.0 - reached))


def penetration(values: Mapping[str, float], load: float, weight: float) -> float:
    """How deep a foot stands in the ground under a load [N], by (19) at rest [m].

    Args:
        values: numbers of the robot.
        load: on the foot [N].
        weight: of the robot [N], whose third sinks in by the printed penetration.
    """
    return values["penetration"] * (load * SUPPORTS / weight) ** (1.0 / EXPONENT)


def soften(spec: mujoco.MjSpec, floor: mujoco.MjsGeom, values: Mapping[str, float], foot_body: str) -> None:
    """Give the floor its softness, from the weight of the robot in ``spec`` and the mobility of its feet."""
    model = spec.compile()
    depth, mobility = values["penetration"], float(model.body_invweight0[model.body(foot_body).id, 0])
    load = float(model.body_mass.sum()) * GRAVITY / SUPPORTS
    reached = float(impedance(depth))
    stiffness = load * mobility / float(shape(depth))
    damping = values["ground_damping"] * mobility * (1.0 - reached) * SOLIMP[1] / reached
    floor.solref, floor.solimp = (-stiffness, -damping), SOLIMP
    # a foot slips with R f / b, at most slip_speed where friction is whole: the engine's friction rows have D_0
    softness = mobility * (1.0 - SOLIMP[0]) / SOLIMP[0]
    creep = softness * values["floor_friction"] * load * SOLIMP[1] / damping
    spec.option.impratio = max(creep / values["slip_speed"], 1.0)
