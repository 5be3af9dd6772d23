"""The reference controller: a tripod gait with double stance (paper 001, 7.1).

Legs 0, 2, 4 and legs 1, 3, 5 take turns. Printed: the gait, a heading velocity of 1.5 cm/s, a cycle of 12 s, a double
stance, new references every 10 ms; vertical references stand still in support and move quickly in the transfer, while
horizontal ones always move (7.2). The paper leaves the gait algorithm to its references, so the rest is assumed: at
other speeds the steps stay as long and the cycle follows, and the transfer has no jumps of speed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .kinematics import Joints, foot_from_joints, joints_from_foot, leg_angle, stance
from .parameters import GOAL_RANGE, LEGS

PERIOD = 0.01  # [s] between references, 2.2
SPEED = 0.015  # [m/s], 7.1
CYCLE = 12.0  # [s] at that speed, 7.1


@dataclass(frozen=True)
class Tripod:
    """Parameters of the gait.

    Attributes:
        speed: heading velocity [m/s].
        double_stance: share of the cycle, twice in it, in which all legs stand; assumed.
        lift: of the foot in the transfer [m], assumed.
        lifting: share of the transfer in which a foot rises, and that in which it sinks; assumed.
    """

    speed: float = SPEED
    double_stance: float = 1.0 / 12.0
    lift: float = 0.04
    lifting: float = 0.3

    @property
    def cycle(self) -> float:
        """Time of a step cycle [s]."""
        return CYCLE * SPEED / abs(self.speed)

    @property
    def transfer(self) -> float:
        """Share of the cycle in which a leg is in the air."""
        return 0.5 - self.double_stance

    def phase(self, leg: int, time: np.ndarray | float) -> np.ndarray:
        """Share of the cycle since the leg last lifted off; time 0 lies in the middle of a double stance."""
        return (np.asarray(time) / self.cycle - 0.5 * self.double_stance + 0.5 * (leg % 2)) % 1.0

    def in_transfer(self, leg: int, time: np.ndarray | float) -> np.ndarray:
        """Whether the leg is in the air."""
        return self.phase(leg, time) < self.transfer

    def foot(self, leg: int, time: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """Way of the foot ahead of the middle of its support, and its height over the ground [m]."""
        phase, air, ground = self.phase(leg, time), self.transfer, 1.0 - self.transfer
        stroke = self.speed * ground * self.cycle
        standing = 0.5 - (phase - air) / ground
        s = np.clip(phase / air, 0.0, 1.0)
        slope = -air / ground  # a foot leaves and meets the ground with the ground's speed
        ahead = -0.5 + slope * s + (1.0 - slope) * s**2 * (3.0 - 2.0 * s)
        rise = np.clip(np.minimum(s, 1.0 - s) / self.lifting, 0.0, 1.0)
        moving = phase < air
        return stroke * np.where(moving, ahead, standing), np.where(
            moving, 0.5 * self.lift * (1.0 - np.cos(np.pi * rise)), 0.0
        )

    def goals(self, values: Mapping[str, float], time: np.ndarray | float) -> np.ndarray:
        """References of all joints (..., 18) at times (...) [rad, m], in the robot's order."""
        columns: list[np.ndarray] = []
        for leg in range(LEGS):
            ahead, height = self.foot(leg, time)
            angle = leg_angle(leg)
            x = values["stance_radius"] - values["leg_radius"] + ahead * np.cos(angle)
            z = values["foot_radius"] - values["stance_height"] + height
            joints = joints_from_foot(values, x, -ahead * np.sin(angle), z)
            columns += [np.broadcast_to(value, np.shape(ahead)) for value in joints]
        return np.stack(columns, axis=-1)


# --- the same gait with parameters that a policy changes while it walks ----------------------------------------------
#
# Feet that stand move back with the commanded speed, whatever the action, so that none drags another; an action
# changes how the clock runs and where and how feet in the air land. All zero is the reference gait. This is what
# Iscen et al., "Policies Modulating Trajectory Generators" (CoRL 2018), describe: the policy sees the generator's
# clock and memory.

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
SHORTEST = 0.04  # [m] of a cycle, however little room a foot has; assumed
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
_EDGES = np.stack([_ANGLE - GOAL_RANGE["rotation"], _ANGLE + GOAL_RANGE["rotation"]])  # of the legs' sectors
_INWARD = np.stack([[-np.sin(_EDGES[0]), np.cos(_EDGES[0])], [np.sin(_EDGES[1]), -np.cos(_EDGES[1])]])


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


def room(values: Mapping[str, float], place: np.ndarray, way: float) -> np.ndarray:
    """How far feet can move ahead (``way`` 1) or back (-1) within the ranges of their joints (..., LEGS) [m].

    Args:
        values: numbers of the robot.
        place: of the feet, from their stance (..., LEGS, 2) [m].
        way: 1 or -1.
    """
    middle, reach = stance(values).horizontal, values["stance_radius"] - values["leg_radius"]
    x, y = place[..., 0] + reach * _COSINE, place[..., 1] + reach * _SINE  # from the leg's upright axis
    free = np.full(x.shape, np.inf)
    for normal in _INWARD:
        inside, closer = x * normal[0] + y * normal[1], -way * normal[0]
        free = np.minimum(free, np.where(closer > 0.0, inside / np.where(closer > 0.0, closer, 1.0), np.inf))
    low, high = (values["ratio"] * (float(middle) + sign * GOAL_RANGE["horizontal"]) for sign in (-1.0, 1.0))
    free = np.minimum(free, np.sqrt(np.maximum(high**2 - y**2, 0.0)) - way * x)
    blocked = (np.abs(y) < low) & (way * x < 0.0)
    return np.where(blocked, np.minimum(free, np.abs(x) - np.sqrt(np.maximum(low**2 - y**2, 0.0))), free)


def advance(values: Mapping[str, float], action: np.ndarray, speed: np.ndarray, memory: np.ndarray) -> np.ndarray:
    """Goals :data:`PERIOD` later (n, 18) [rad, m]; ``memory`` (n, MEMORY) moves on in place.

    Args:
        values: numbers of the robot.
        action: (n, 6), in the order of :data:`MODULATED`.
        speed: commanded (n,) [m/s].
        memory: of the generator.
    """
    parameters = memory[:, PARAMETERS]
    parameters = parameters + _FOLLOWED * (np.clip(_MIDDLE + _PER_ACTION * action, _LOW, _HIGH) - parameters)
    length, double_stance, lift, lifting, width, spread = (column[:, None] for column in parameters.T)
    air = 0.5 - double_stance
    place = memory[:, _PLACE].reshape(-1, LEGS, 2)
    left = memory[:, _LEFT].reshape(-1, LEGS, 2)
    phase = (memory[:, CLOCK, None] - 0.5 * double_stance + _OFFSET) % 1.0
    free = np.where(speed[:, None] > 0.0, room(values, place, -1.0), room(values, place, 1.0))
    fits = np.where(phase < air, np.inf, free / np.maximum(1.0 - phase, 1e-9)).min(axis=1)
    cycle = np.minimum(length[:, 0], np.maximum(fits, SHORTEST))
    # the clock runs faster where a foot would be at the end of its range before it lifts off
    clock = (memory[:, CLOCK] + PERIOD * np.abs(speed) / cycle) % 1.0
    phase = (clock[:, None] - 0.5 * double_stance + _OFFSET) % 1.0
    moving, s = phase < air, np.minimum(phase / air, 1.0)

    way = np.sign(speed)[:, None] * length  # of the body in a cycle
    x, y = place[..., 0] - PERIOD * speed[:, None], place[..., 1]
    land_y = width * _SIDE * _SINE
    middle = np.stack([np.zeros_like(land_y), land_y], axis=2)
    land_x = 0.5 * (1.0 - air) * way + width * _SIDE * _COSINE + spread * _AHEAD
    land_x = np.clip(land_x, -room(values, middle, -1.0), room(values, middle, 1.0))
    # over the ground, which the foot leaves and meets without slip where the clock runs as the length of a cycle asks
    blend = s**2 * (3.0 - 2.0 * s)
    over_x = left[..., 0] - air * way * s + (land_x - left[..., 0] + air * way) * blend
    over_y = left[..., 1] + (land_y - left[..., 1]) * blend
    x, y = np.where(moving, over_x, x), np.where(moving, over_y, y)
    there = np.stack([x, y], axis=2)
    memory[:, CLOCK], memory[:, PARAMETERS] = clock, parameters
    memory[:, _PLACE] = there.reshape(len(memory), -1)
    memory[:, _LEFT] = np.where(moving[..., None], left, there).reshape(len(memory), -1)

    rise = np.minimum(np.minimum(s, 1.0 - s) / lifting, 1.0)
    height = np.where(moving, 0.5 * lift * (1.0 - np.cos(np.pi * rise)), 0.0)
    reach = values["stance_radius"] - values["leg_radius"]
    z = values["foot_radius"] - values["stance_height"] + height
    joints = joints_from_foot(values, reach + x * _COSINE + y * _SINE, y * _COSINE - x * _SINE, z)
    return np.stack(list(joints), axis=2).reshape(len(memory), 3 * LEGS)
