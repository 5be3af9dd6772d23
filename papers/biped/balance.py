"""Static balance of paper 003, VI: does the centre of mass that the drawings give lie over what the robot stands on?"""

from __future__ import annotations

import mujoco
import numpy as np

from ...actuators.gravity import GRAVITY
from ...envs.biped.kinematics import centre_of_mass, feet, place, segments
from ...envs.biped.parameters import SIDES
from ...envs.biped.robot import BIPED, TORSO, coordinate
from .hopping import JOINT_TICKS, quantised
from .rig import FINGERTIP

ON_FOOT, HANGING = 10, 7
"""Postures of the two experiments."""
PRINTED = 6e-3  # [m] largest distance, Fig. 17


def distances(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Horizontal distance of the calculated centre of mass from the supporting toe (10,), and from the hip of the
    fixed robot whose legs hang (7,) [m].

    The engine's robot, boom off, is balanced in each posture until no more is left than fingertips hold; then its
    encoders are read, and the centre of mass is calculated from them.
    """
    drivetrain = BIPED.drivetrain("ideal")
    model, values = drivetrain.model, BIPED.parameters()
    data = mujoco.MjData(model)
    torso, point, ends = model.body(TORSO).id, centre_of_mass(values), feet(values)
    weight = GRAVITY * float(model.body_subtreemass[torso])

    def offset(pitch: float, link: np.ndarray, on_foot: bool) -> float:
        """True distance of the centre of mass in front of the support [m]."""
        for column, side in ((0, SIDES[0]), (2, SIDES[1])):
            drivetrain.set_position(coordinate(side, "leg_shape"), data.qpos, link[column + 1])
            drivetrain.set_position(coordinate(side, "leg_angle"), data.qpos, link[column])
        data.qpos[:3] = 0.0, 1.0, pitch
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        support = float(data.geom(f"{SIDES[1]}_foot").xpos[0]) if on_foot else 0.0
        return float(data.subtree_com[torso, 0]) - support

    rows: list[list[float]] = [[], []]
    for on_foot, count in ((True, ON_FOOT), (False, HANGING)):
        for _ in range(count):
            # the right leg is the longer one, VI
            left = rng.uniform([-0.3, 0.4], [0.3, 0.7])
            link = np.concatenate([left, rng.uniform([-0.15, 0.1], [0.15, 0.3])])
            held = rng.uniform(-FINGERTIP, FINGERTIP) / weight
            low, high = -0.6, 0.6
            sign = np.sign(offset(high, link, on_foot) - offset(low, link, on_foot))
            for _ in range(40):
                middle = 0.5 * (low + high)
                low, high = (low, middle) if sign * (offset(middle, link, on_foot) - held) > 0.0 else (middle, high)
            pitch = 0.5 * (low + high)
            angles = segments(float(quantised(np.array(pitch), JOINT_TICKS)), quantised(link, JOINT_TICKS))
            support = float(place(ends[1], angles)[0]) if on_foot else 0.0
            rows[0 if on_foot else 1].append(float(place(point, angles)[0]) - support)
    return np.array(rows[0]), np.array(rows[1])
