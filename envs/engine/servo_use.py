"""How hard a policy drives its servos, in every control step: what heats and wears them, and what they cannot follow.

An environment's argument ``servo={"goal_rate": 0.5, "heat": 1.0}`` makes it cost. Measures are means over the joints:

goal_rate    by how much goals move faster than the servo without load, in its speeds: 0 where it can follow
saturation   share of the joints whose drive gives all it has
reversals    how often a motor's torque changes its sign [1/s], where it is beyond a twentieth of the stalled one's
heat         square of the torque, as a share of the stalled servo's: i2t, since heat goes with the current's square

A chain that tells no speed, duty or stall torque has none of what would need it. All joints have the same weight.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...actuators import Chain
from ...actuators.chain import largest_duty, no_load_speed, stall_torque
from ...common.errors import SealegsError, nearest

MEASURES = ("goal_rate", "saturation", "reversals", "heat")
FULL = 0.999  # share of the largest duty that counts as all of it
SLIGHT = 0.05  # share of the stall torque below which its sign counts for nothing
UNITS = {
    "goal_rate": "goals beyond the servo's speed [no-load speeds]",
    "saturation": "saturated duty [share of the time]",
    "reversals": "torque reversals of a joint [1/s]",
    "heat": "heat, i2t [share of a stalled servo's]",
}


class ServoUse:
    """The measures of n simulations, from control step to control step."""

    def __init__(self, chains: Mapping[str, Chain], num_envs: int, dt: float, weights: Any) -> None:
        """Prepare.

        Args:
            chains: by coordinate, in the order of goals.
            num_envs: simulations.
            dt: control step [s].
            weights: of terms of the reward by measure; None: none.

        Raises:
            SealegsError: a weight is of no measure, or is no number from 0.
        """
        weights = {} if weights is None else weights
        if not isinstance(weights, Mapping):
            raise SealegsError(f"servo is {weights!r}; it takes weights of {', '.join(MEASURES)}.")
        for name, value in weights.items():
            if name not in MEASURES:
                raise SealegsError(
                    f"servo.{name} is no measure{nearest(name, MEASURES)}; there are {', '.join(MEASURES)}."
                )
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < np.inf:
                raise SealegsError(f"servo.{name} is {value!r}; it must be a number from 0.")
        self.weights = {name: float(value) for name, value in weights.items() if value > 0.0}
        self._dt = dt
        self._speed = np.array([no_load_speed(chain) for chain in chains.values()])
        self._full = FULL * np.array([largest_duty(chain) for chain in chains.values()])
        stall = np.array([stall_torque(chain) for chain in chains.values()])
        self._stall = np.where(stall > 0.0, stall, np.inf)
        self._goals, self._sign = (np.zeros((num_envs, len(chains))) for _ in range(2))

    def start(self, chosen: np.ndarray, goals: np.ndarray) -> None:
        """New episodes, at rest at their goals (m, k)."""
        self._goals[chosen], self._sign[chosen] = goals, 0.0

    def step(self, goals: np.ndarray, torque: np.ndarray, duty: np.ndarray) -> dict[str, np.ndarray]:
        """Measures (n,) of a control step that ends with these goals, torques and duties (n, k)."""
        rate = np.abs(goals - self._goals) / self._dt
        self._goals = goals.copy()
        share = torque / self._stall
        sign = np.where(np.abs(share) > SLIGHT, np.sign(share), 0.0)
        turned = sign * self._sign < 0.0
        self._sign = np.where(sign == 0.0, self._sign, sign)  # the last one that counted
        return {
            "goal_rate": np.maximum(rate / self._speed - 1.0, 0.0).mean(axis=1),
            "saturation": (np.abs(duty) >= self._full).mean(axis=1),
            "reversals": turned.mean(axis=1) / self._dt,
            "heat": np.square(share).mean(axis=1),
        }

    def terms(self, measures: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Terms of the reward (n,) by name."""
        return {f"reward_servo_{name}": -weight * measures[name] for name, weight in self.weights.items()}
