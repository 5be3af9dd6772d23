"""Everyday machines that run: many copies of one, each with goals of its own, step by step as a host runs them."""

from __future__ import annotations

import math

import numpy as np

from .machines import links_of
from .physics import STEP, TICK, State, advance, at_rest, room
from .recorded import READING_NOISE, Drawn


class Running:
    """Copies of a machine with all that it hides.

    Attributes:
        count: of the copies.
        states: of each.
    """

    def __init__(self, case: Drawn, count: int, period: float, seed: int = 0) -> None:
        """Place them at the middle of their motion.

        Args:
            case: the machine.
            count: of copies.
            period: from one goal to the next [s], a whole number of physics steps.
            seed: of the encoders' noise.
        """
        self._servos, tip = case.with_effects(case.effects)
        self._links = links_of(case.machine, case.masses, tip)
        self.count, self.joints = count, len(case.machine.bodies)
        self._room, self._steps = room(self.joints), round(period / STEP)
        kept = math.ceil(self._servos.latency / period) + 1
        self._sent = np.zeros((count, kept, self.joints))
        self._since = period * np.arange(kept)
        self._random = np.random.default_rng(seed)
        middle = np.array(case.machine.middle, float)
        self.states: list[State] = [at_rest(middle, self._servos.volts) for _ in range(count)]

    def place(self, which: np.ndarray, angles: np.ndarray) -> None:
        """Put some copies (m,) at rest at angles (m, n) [rad], which are their goals."""
        for row, k in enumerate(which):
            self.states[k] = at_rest(np.asarray(angles[row], float), self._servos.volts)
            self._sent[k] = angles[row]

    def step(self, goals: np.ndarray) -> None:
        """Send goals (count, n) [rad] and let a period pass."""
        self._sent[:, 1:] = self._sent[:, :-1].copy()
        self._sent[:, 0] = goals
        for k, state in enumerate(self.states):
            advance(self._links, self._servos, state, self._room, self._sent[k], self._since, self._steps)

    @property
    def links(self) -> np.ndarray:
        """True angles of the links (count, n) [rad]."""
        return np.array([state.q for state in self.states])

    @property
    def torques(self) -> np.ndarray:
        """Of the motors (count, n) [N.m]."""
        return np.array([state.torque for state in self.states])

    @property
    def speeds(self) -> np.ndarray:
        """Of the motors (count, n) [rad/s]."""
        split = self._servos.play > 0.0
        return np.array([np.where(split, state.motor_w, state.w) for state in self.states])

    @property
    def duties(self) -> np.ndarray:
        """Of the drives (count, n)."""
        return np.array([state.duty for state in self.states])

    def read(self) -> np.ndarray:
        """What the encoders say (count, n) [rad]."""
        behind = (self._servos.output_side > 0.0) | ~(self._servos.play > 0.0)
        angles = np.array([np.where(behind, state.q, state.motor) for state in self.states])
        return TICK * np.round((angles + self._random.normal(0.0, READING_NOISE, angles.shape)) / TICK)
