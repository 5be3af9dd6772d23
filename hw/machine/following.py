"""Whether joints follow their goals: limits by servo model, out of the chain that the servo is believed to be.

A healthy servo whose goal is so far away that its controller gives full duty gets there at no less than half of its
no-load speed, unless it carries more than half of its stall torque. What does not is blocked, overloaded, without its
horn, or blind.

An encoder that is stuck shows earlier: friction holds a servo at one step while its goal moves by twice the error at
which the motor breaks away, and no further. A blind servo turns from there on, at a duty that nothing takes back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...actuators import Chain
from ...actuators.ability import largest_duty, no_load_speed, stall_torque

GOAL_SPEED = 4.0  # times the no-load speed: a goal that moves so fast calls for full duty within a cycle or two
REACHED = 0.5  # share of the no-load speed at which a goal counts as reachable
SLACK = 1.5  # times what friction explains that a goal may move while the encoder stays at one step; assumed
LOADED = 0.1  # share of the load that friction in the gears takes, where the chain says less; assumed
UNKNOWN_ERROR, UNKNOWN_SPEED = 0.3, 10.0  # [rad], [rad/s] for chains that tell neither; assumed
UNKNOWN_REST = 0.05  # share of the error of full duty that friction holds, where the chain tells none; assumed
LEAST = 0.1  # [rad] that any joint may be behind: stiff controllers reach full duty within their own lag
LEAST_REST = 0.015  # [rad] that any goal may move without a step: ten steps of an encoder with 4096
SHAKING = 0.1  # [s] time constant over which a goal is smoothed: what is faster moves no joint by a step; assumed


@dataclass(frozen=True)
class Ability:
    """What a servo can do.

    Attributes:
        error: of the position at which the controller gives all it has, at least :data:`LEAST` [rad or m].
        speed: without load [rad/s or m/s].
        full: as ``error``, however small.
        rest: way that a goal may move while friction holds the unloaded servo at one step [rad or m].
        loaded: by how much more, per error that a load keeps up.
    """

    error: float
    speed: float
    full: float
    rest: float
    loaded: float


def ability(chain: Chain, per_radian: float = 1.0) -> Ability:
    """What a chain can do, as far as it tells, in units of the joint, which moves ``per_radian`` of the shaft."""
    duty, error, speed = largest_duty(chain), UNKNOWN_ERROR * per_radian, no_load_speed(chain)
    stall = stall_torque(chain)  # [N.m or N]
    for stage in ("position_p", "position_pd", "position_pi"):
        if chain.find(stage) is not None and (gain := chain.value(f"{stage}.gain")) > 0.0:
            error = duty / gain
    if chain.find("ideal") is not None and math.isfinite(stall):
        error = stall / max(chain.value("ideal.stiffness"), 1e-6)
    speed = speed if math.isfinite(speed) else UNKNOWN_SPEED * per_radian
    stall = stall if math.isfinite(stall) else 0.0
    rest, loaded = _held(chain, error, stall)
    return Ability(max(error, LEAST * per_radian), speed, error, rest + LEAST_REST * per_radian, loaded)


def _held(chain: Chain, full: float, stall: float) -> tuple[float, float]:
    """``rest`` and ``loaded`` of a servo: friction acts to either side, so twice the error at which it breaks away."""
    friction = chain.find("friction")
    share, load = UNKNOWN_REST, LOADED
    if friction is not None and stall > 0.0:
        load = max(load, friction.load + friction.load_stribeck)
        share = (friction.coulomb + friction.stribeck + abs(friction.asymmetry) + friction.ripple) / stall
    if chain.find("minimum_duty") is None and chain.find("duty_step") is not None:
        share += chain.value("duty_step.size")
    dead = chain.value("dead_band.width") if chain.find("dead_band") is not None else 0.0
    return SLACK * (2.0 * share * full + dead), SLACK * 2.0 * load


class Following:
    """Watches joints follow their goals.

    Attributes:
        error: by which each joint is beyond what it could have reached (k,) [rad or m].
        behind: for how long that has been more than its limit (k,) [s].
        stuck: for how long a position has not changed though its goal has moved (k,) [s].
    """

    def __init__(self, abilities: list[Ability], limit: np.ndarray, period: float) -> None:
        """Prepare.

        Args:
            abilities: of the joints' servos (k).
            limit: of the error (k,) [rad or m]; NaN: that at which each servo gives all it has.
            period: of the loop [s].
        """
        self.limits = np.where(np.isnan(limit), [item.error for item in abilities], limit)
        self._full, self._rest, self._loaded = np.array([(a.full, a.rest, a.loaded) for a in abilities]).T
        self._speed = REACHED * np.array([item.speed for item in abilities])
        self._period, self._time = period, 0.0
        self._reachable: np.ndarray | None = None
        self._position = self._smooth = np.zeros(0)
        self._least = self._most = np.zeros((2, 0))  # of the goal, and of the smoothed one, since the position changed
        self.error, self.behind, self.stuck = (np.zeros(len(abilities)) for _ in range(3))

    def see(self, goal: np.ndarray, position: np.ndarray, fresh: np.ndarray, time: float) -> None:
        """One cycle.

        Args:
            goal: that the servos have (k,) [rad or m].
            position: as read (k,) [rad or m].
            fresh: whether it was read in this cycle (k,).
            time: of the reading [s].
        """
        if self._reachable is None:
            self._reachable, self._position, self._time = position.copy(), position, time - self._period
            self._smooth, self._least, self._most = goal, np.stack([goal, goal]), np.stack([goal, goal])
        dt, self._time = max(time - self._time, 0.0), time
        step = dt * self._speed
        self._reachable = self._reachable + np.clip(goal - self._reachable, -step, step)
        low, high = np.minimum(goal, self._reachable), np.maximum(goal, self._reachable)
        self.error = np.maximum(np.maximum(low - position, position - high), 0.0)
        self.behind = self._lasting(self.error > self.limits, self.behind, dt)
        changed = fresh & (position != self._position)
        self._position = np.where(changed, position, self._position)
        self._smooth = goal + (self._smooth - goal) * np.exp(-dt / SHAKING)
        both = np.stack([goal, self._smooth])
        self._least = np.where(changed, both, np.minimum(self._least, both))
        self._most = np.where(changed, both, np.maximum(self._most, both))
        held = self._rest + self._loaded * np.minimum(np.abs(goal - self._position), self._full)
        # smoothed alone, a goal that has just stopped would still come after it
        moved = (np.maximum(self._most - both, both - self._least) > held).all(axis=0)
        self.stuck = self._lasting(moved & ~changed, self.stuck, dt)

    def _lasting(self, beyond: np.ndarray, lasted: np.ndarray, dt: float) -> np.ndarray:
        return np.where(beyond, lasted + np.where(lasted > 0.0, dt, min(dt, self._period)), 0.0)
