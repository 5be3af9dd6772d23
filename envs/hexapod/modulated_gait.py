"""The tripod gait of :mod:`envs.hexapod.gait` with parameters that a policy changes while it walks.

Feet that stand move back with the commanded speed, whatever the action, so that none drags another; an action changes
how the clock runs and where and how feet in the air land. All zero is the reference gait. This is what Iscen et al.,
"Policies Modulating Trajectory Generators" (CoRL 2018), describe: the policy sees the generator's clock and memory.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from envs.hexapod.gait import CYCLE, PERIOD, SPEED, Tripod
from envs.hexapod.kinematics import Joints, foot_from_joints, joints_from_foot, leg_angle
from envs.hexapod.parameters import LEGS

_REFERENCE = Tripod()
MODULATED = {
    "cycle length": (CYCLE * SPEED, 0.08, 0.10, 0.26, "m"),
    "double stance": (_REFERENCE.double_stance, 0.125, 0.0, 0.2, "of the cycle"),
    "lift": (_REFERENCE.lift, 0.05, 0.005, 0.08, "m"),
    "lifting": (_REFERENCE.lifting, 0.2, 0.1, 0.5, "of the transfer"),
    "width": (0.0, 0.15, -0.1, 0.1, "m"),
    "spread": (0.0, 0.04, -0.04, 0.04, "m"),
}
"""Parameters by name: value at action 0, change per unit of action, lowest and highest value, unit.

``cycle length`` is the way of the body in a step cycle, ``double stance``, ``lift`` and ``lifting`` are those of
:class:`envs.hexapod.gait.Tripod`, ``width`` is how much farther out, away from the body, the feet of legs 1, 2, 4 and 5
land, and ``spread`` how much farther ahead those of 1 and 5 and farther back those of 2 and 4. Ranges are assumed: what
the legs reach, and what leaves the actions in between some room.
"""
LAG = 1.0  # [s] time constant with which parameters follow the action: a foot in the air must not jump

CLOCK, PARAMETERS = 0, slice(1, 1 + len(MODULATED))
_PLACE = slice(PARAMETERS.stop, PARAMETERS.stop + 2 * LEGS)  # of the feet, from their stance (LEGS, 2) [m]
_LEFT = slice(_PLACE.stop, _PLACE.stop + 2 * LEGS)  # where they last stood
MEMORY = _LEFT.stop

_MIDDLE, _PER_ACTION, _LOW, _HIGH = (np.array([row[k] for row in MODULATED.values()]) for k in range(4))
_FOLLOWED = 1.0 - np.exp(-PERIOD / LAG)
_ANGLE = np.array([leg_angle(leg) for leg in range(LEGS)])
_COSINE, _SINE = np.cos(_ANGLE), np.sin(_ANGLE)
_SIDE = np.array([0.0 if leg % 3 == 0 else 1.0 for leg in range(LEGS)])
_AHEAD = _SIDE * np.sign(_COSINE)
_OFFSET = 0.5 * (np.arange(LEGS) % 2)


def begin(values: Mapping[str, float], start: np.ndarray, goals: np.ndarray) -> np.ndarray:
    """Memory at the start of m episodes (m, MEMORY).

    Args:
        values: numbers of the robot.
        start: uniform random numbers (m,): which tripod goes first.
        goals: joint positions from which the feet go (m, 18) [rad, m].
    """
    memory = np.zeros((len(goals), MEMORY))
    memory[:, CLOCK] = np.where(start < 0.5, 0.0, 0.5)
    memory[:, PARAMETERS] = _MIDDLE
    x, y, _ = foot_from_joints(values, Joints(goals[:, 0::3], goals[:, 1::3], goals[:, 2::3]))
    out = np.asarray(x) - (values["stance_radius"] - values["leg_radius"])
    place = np.stack([out * _COSINE - y * _SINE, out * _SINE + y * _COSINE], axis=2).reshape(len(goals), 2 * LEGS)
    memory[:, _PLACE] = memory[:, _LEFT] = place
    return memory


def advance(values: Mapping[str, float], action: np.ndarray, speed: np.ndarray, memory: np.ndarray) -> np.ndarray:
    """Goals :data:`~envs.hexapod.gait.PERIOD` later (n, 18) [rad, m]; ``memory`` (n, MEMORY) moves on in place.

    Args:
        values: numbers of the robot.
        action: (n, 6), in the order of :data:`MODULATED`.
        speed: commanded (n,) [m/s].
        memory: of the generator.
    """
    parameters = memory[:, PARAMETERS]
    parameters += _FOLLOWED * (np.clip(_MIDDLE + _PER_ACTION * action, _LOW, _HIGH) - parameters)
    length, double_stance, lift, lifting, width, spread = (column[:, None] for column in parameters.T)
    memory[:, CLOCK] = (memory[:, CLOCK] + PERIOD * np.abs(speed) / length[:, 0]) % 1.0
    phase = (memory[:, CLOCK, None] - 0.5 * double_stance + _OFFSET) % 1.0
    air = 0.5 - double_stance
    moving, s = phase < air, np.minimum(phase / air, 1.0)

    place = memory[:, _PLACE].reshape(-1, LEGS, 2)
    left = memory[:, _LEFT].reshape(-1, LEGS, 2)
    way = np.sign(speed)[:, None] * length  # of the body in a cycle
    x, y = place[..., 0] - PERIOD * speed[:, None], place[..., 1]
    land_x = 0.5 * (1.0 - air) * way + width * _SIDE * _COSINE + spread * _AHEAD
    land_y = width * _SIDE * _SINE
    blend = s**2 * (3.0 - 2.0 * s)  # over the ground, which the foot leaves and meets without slip
    over_x = left[..., 0] - air * way * s + (land_x - left[..., 0] + air * way) * blend
    over_y = left[..., 1] + (land_y - left[..., 1]) * blend
    x, y = np.where(moving, over_x, x), np.where(moving, over_y, y)
    memory[:, _PLACE] = np.stack([x, y], axis=2).reshape(len(memory), -1)
    left[:] = np.where(moving[..., None], left, np.stack([x, y], axis=2))
    memory[:, _LEFT] = left.reshape(len(memory), -1)

    rise = np.minimum(np.minimum(s, 1.0 - s) / lifting, 1.0)
    height = np.where(moving, 0.5 * lift * (1.0 - np.cos(np.pi * rise)), 0.0)
    reach = values["stance_radius"] - values["leg_radius"]
    z = values["foot_radius"] - values["stance_height"] + height
    joints = joints_from_foot(values, reach + x * _COSINE + y * _SINE, y * _COSINE - x * _SINE, z)
    return np.stack([np.asarray(value) for value in joints], axis=2).reshape(len(memory), 3 * LEGS)
