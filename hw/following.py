"""Whether joints follow their goals: limits by servo model, out of the chain that the servo is believed to be.

A healthy servo whose goal is so far away that its controller gives full duty gets there at no less than half of its
no-load speed, unless it carries more than half of its stall torque. What does not is blocked, overloaded, without its
horn, or blind: an encoder that is stuck shows here first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..actuators import Chain

GOAL_SPEED = 4.0  # times the no-load speed: a goal that moves so fast calls for full duty within a cycle or two
REACHED = 0.5  # share of the no-load speed at which a goal counts as reachable
STUCK = 0.5  # share of the error of full duty by which a goal moves before a position must have changed
UNKNOWN_ERROR, UNKNOWN_SPEED = 0.3, 10.0  # [rad], [rad/s] for chains that tell neither; assumed
LEAST = 0.1  # [rad] that any joint may be behind: stiff controllers reach full duty within their own lag
BOUNDLESS = 1e3  # torque limits from here on are none [N.m]


@dataclass(frozen=True)
class Ability:
    """What a servo can do.

    Attributes:
        error: of the position at which the controller gives all it has, at least :data:`LEAST` [rad].
        speed: without load [rad/s].
    """

    error: float
    speed: float


def ability(chain: Chain, per_radian: float = 1.0) -> Ability:
    """What a chain can do, as far as it tells, in units of the joint, which moves ``per_radian`` of the shaft."""
    duty = chain.value("duty_limit.limit") if chain.find("duty_limit") is not None else 1.0
    error, speed = UNKNOWN_ERROR * per_radian, UNKNOWN_SPEED * per_radian
    for stage in ("position_p", "position_pd", "position_pi"):
        if chain.find(stage) is not None and (gain := chain.value(f"{stage}.gain")) > 0.0:
            error = duty / gain
    if chain.find("ideal") is not None and chain.value("ideal.torque_limit") < BOUNDLESS:
        error = chain.value("ideal.torque_limit") / max(chain.value("ideal.stiffness"), 1e-6)
    if chain.find("supply") is not None and chain.find("dc_motor") is not None:
        back_emf = chain.find("dc_motor").back_emf * chain.gear_ratio()
        speed = duty * chain.value("supply.volts") / max(back_emf, 1e-6)
    elif chain.find("regression") is not None and chain.value("regression.speed_torque") < 0.0:
        speed = -duty * chain.value("regression.duty_torque") / chain.value("regression.speed_torque")
        speed = abs(speed) / chain.gear_ratio()
    return Ability(max(error, LEAST * per_radian), speed)


class Following:
    """Watches joints follow their goals.

    Attributes:
        error: by which each joint is beyond what it could have reached (k,) [rad].
        behind: for how long that has been more than its limit (k,) [s].
        stuck: for how long a position has not changed though its goal has moved (k,) [s].
    """

    def __init__(self, abilities: list[Ability], limit: float | None, period: float) -> None:
        """Prepare.

        Args:
            abilities: of the joints' servos (k).
            limit: of the error [rad]; None: that at which each servo gives all it has.
            period: of the loop [s].
        """
        errors = np.array([item.error for item in abilities])
        self.limits = errors if limit is None else np.full(len(errors), limit)
        self._moved = STUCK * self.limits
        self._step = period * REACHED * np.array([item.speed for item in abilities])
        self._period = period
        self._reachable: np.ndarray | None = None
        self._position = self._goal = np.zeros(0)
        self.error, self.behind, self.stuck = (np.zeros(len(errors)) for _ in range(3))

    def see(self, goal: np.ndarray, position: np.ndarray, fresh: np.ndarray) -> None:
        """One cycle.

        Args:
            goal: that the servos have (k,) [rad].
            position: as read (k,) [rad].
            fresh: whether it was read in this cycle (k,).
        """
        if self._reachable is None:
            self._reachable, self._position, self._goal = position.copy(), position, goal
        self._reachable = self._reachable + np.clip(goal - self._reachable, -self._step, self._step)
        low, high = np.minimum(goal, self._reachable), np.maximum(goal, self._reachable)
        self.error = np.maximum(np.maximum(low - position, position - high), 0.0)
        self.behind = np.where(self.error > self.limits, self.behind + self._period, 0.0)
        changed = fresh & (position != self._position)
        self._position = np.where(changed, position, self._position)
        self._goal = np.where(changed, goal, self._goal)
        moved = np.abs(goal - self._goal) > self._moved
        self.stuck = np.where(changed, 0.0, np.where(moved | (self.stuck > 0.0), self.stuck + self._period, 0.0))
