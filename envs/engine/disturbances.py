"""What disturbs a simulation while it runs: noise and bias of sensors, pushes, late and lost goals and readings.

How much of it there is, every episode draws anew (:mod:`sealegs.envs.engine.randomization`). What it is in each control
step follows from a key that the episode drew and from the number of the step, by a hash: for all simulations at once,
and alike in a batch and alone.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from mujoco.batch import Batch
from scipy.special import ndtri

from . import keyed, turns
from .terrain import Terrain, floors

READING, TILT, TURN_RATE, LOST_READING, LOST_GOAL, PUSH, SLOPE, PLACE, BIAS = range(9)
"""Streams of random numbers; those of biases are beyond the last."""
COLUMNS = 1024  # of a stream
SMALLEST = 2.0**-54  # in place of a uniform number that is 0, for a quantile
PUSH_INTERVAL = 3.0  # [s] where none is given; assumed


class Disturbances:
    """Those of n simulations.

    Attributes:
        drawn: how much of each, by ``group.name`` of the randomisation, (n,) each; the engine writes it.
        keys: of the running episodes (n,).
    """

    def __init__(self, count: int, base: tuple[int, int] | None, drawn: Mapping[str, np.ndarray]) -> None:
        """``base``: where the free joint begins in positions and in speeds; None: there is none."""
        self.drawn, self._base = drawn, base
        self.keys = np.zeros(count, np.uint64)

    def start(self, chosen: np.ndarray, random: np.ndarray) -> None:
        """Episodes begin in ``chosen`` (m,), with uniform numbers in [0, 1), (m,)."""
        self.keys[chosen] = keyed.key_of(random)

    # --- what the robot feels ------------------------------------------------------------------------------------

    def push(self, steps: np.ndarray, dt: float, qvel: np.ndarray) -> None:
        """Change the horizontal speed of the base in ``qvel`` (n, nv), where a push is due in this control step."""
        if self._base is None or (speed := self.drawn.get("push.speed")) is None:
            return
        interval = np.maximum(self.drawn.get("push.interval", PUSH_INTERVAL), dt)
        phase = self._uniform(np.zeros_like(steps), PUSH, 1)[:, 0]  # the first comes within an interval
        number = np.floor(steps * dt / interval + phase)
        due = (number > np.floor((steps - 1) * dt / interval + phase)) & (steps > 0)
        way = 2.0 * np.pi * self._uniform(number.astype(np.int64), PUSH, 2)[:, 1]
        for k, part in enumerate((np.cos(way), np.sin(way))):
            qvel[:, self._base[1] + k] += np.where(due, speed * part, 0.0)

    def slope(self, chosen: np.ndarray) -> np.ndarray | None:
        """Turn of the floor of some simulations as quaternions (m, 4); None: it is level."""
        if (angle := self.drawn.get("floor.slope")) is None:
            return None
        half = 0.5 * angle[chosen]
        way = 2.0 * np.pi * self._uniform(np.zeros(len(self.keys), np.int64), SLOPE, 1)[chosen, 0]
        return np.stack([np.cos(half), np.sin(half) * np.cos(way), np.sin(half) * np.sin(way), 0.0 * half], axis=1)

    def place(self, chosen: np.ndarray, terrain: Terrain) -> np.ndarray:
        """Where some simulations start on uneven ground (m, 3) [m]."""
        drawn = {name: self.drawn[f"floor.{name}"][chosen] for name in terrain.spans}
        return terrain.starts(drawn, self._uniform(np.zeros(len(self.keys), np.int64), PLACE, 2)[chosen])

    # --- what host and servos do ---------------------------------------------------------------------------------

    def late(self, timestep: float) -> np.ndarray | None:
        """Physics steps from a goal of the policy to the servos (n,); None: no delay is drawn."""
        delay = self.drawn.get("delay.goals")
        return None if delay is None else np.rint(delay / timestep).astype(np.int64)

    def lost_goals(self, steps: np.ndarray) -> np.ndarray | None:
        """Whether all goals of this control step are lost on their way (n,); None: none is."""
        if (share := self.drawn.get("lost.goals")) is None:
            return None
        return self._uniform(steps, LOST_GOAL, 1)[:, 0] < share

    def readings(self, steps: np.ndarray, readings: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Encoders as the host has them (n, k): biased, noisy, and as ``before`` where a servo's reply is lost."""
        found = readings + self._off(steps, "reading", READING, readings.shape[1])
        if (share := self.drawn.get("lost.readings")) is None:
            return found
        lost = self._uniform(steps, LOST_READING, readings.shape[1]) < share[:, None]
        return np.where(lost & (steps > 0)[:, None], before, found)

    def base(self, steps: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n, nq) and speeds (n, nv) with tilt and turn rate of the base as they are measured."""
        if self._base is None:
            return qpos, qvel
        if {"noise.tilt", "bias.tilt"} & self.drawn.keys():
            at, half = self._base[0] + 3, 0.5 * self._off(steps, "tilt", TILT, 2)
            w, x, y, z = (qpos[:, at + k] for k in range(4))
            a, b = half[:, 0], half[:, 1]  # a small turn about the base's x and y, after its own
            qpos = qpos.copy()
            turned = (w - a * x - b * y, x + a * w - b * z, y + b * w + a * z, z + b * x - a * y)
            qpos[:, at : at + 4] = np.stack(turned, axis=1) / np.sqrt(1.0 + a * a + b * b)[:, None]
        if {"noise.turn_rate", "bias.turn_rate"} & self.drawn.keys():
            at, qvel = self._base[1] + 3, qvel.copy()
            qvel[:, at : at + 3] += self._off(steps, "turn_rate", TURN_RATE, 3)
        return qpos, qvel

    def _off(self, steps: np.ndarray, name: str, stream: int, columns: int) -> np.ndarray:
        """Noise of this step and bias of this episode (n, columns)."""
        found = np.zeros((len(steps), columns))
        if (size := self.drawn.get(f"noise.{name}")) is not None:
            found = found + size[:, None] * ndtri(np.maximum(self._uniform(steps, stream, columns), SMALLEST))
        if (size := self.drawn.get(f"bias.{name}")) is not None:
            whole = self._uniform(np.zeros_like(steps), BIAS + stream, columns)
            found = found + size[:, None] * (2.0 * whole - 1.0)
        return found

    def _uniform(self, steps: np.ndarray, stream: int, columns: int) -> np.ndarray:
        """Uniform in [0, 1) (n, columns)."""
        return keyed.uniform(self.keys[:, None], steps[:, None], stream * COLUMNS + np.arange(columns))


def tilt_floor(batch: Batch, chosen: np.ndarray, turn: np.ndarray) -> None:
    """Turn the floor of some simulations by quaternions (m, 4)."""
    for floor in floors(batch.model):
        batch.expand("geom_quat")[chosen, floor] = turn
        batch.expand("geom_sameframe")[chosen, floor] = 0  # else the engine takes the world's axes for its own


def stand_on_slope(turn: np.ndarray, pose: np.ndarray) -> None:
    """Turn bases (m, 7), place and quaternion, about the world's origin by quaternions (m, 4)."""
    pose[:, :3] = turns.applied(turn, pose[:, :3])
    pose[:, 3:] = turns.multiply(turn, pose[:, 3:])
