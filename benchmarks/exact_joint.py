"""An exact servo joint to measure the engine against: motor, stick-slip friction, spring or play, pendulum.

It shares no code with :mod:`actuators`: a plain loop at 20 us or less in which a joint that stops is held at rest until
the torque exceeds the friction, instead of a friction force smeared over small speeds.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass

import numba
import numpy as np


@dataclass(frozen=True)
class ExactJoint:
    """A position servo with a pendulum on it; everything at the output shaft."""

    gain: float = 5.3  # duty per radian [1/rad]
    volts: float = 7.4  # [V]
    motor_constant: float = 0.78  # [N.m/A]
    resistance: float = 2.0  # [ohm]
    armature: float = 0.006  # [kg.m2]
    viscous: float = 0.03  # [N.m.s/rad]
    coulomb: float = 0.06  # [N.m]
    mass: float = 0.5  # [kg]
    length: float = 0.12  # [m]
    stiffness: float = 0.0  # between motor and link [N.m/rad]; 0: one rigid body
    damping: float = 0.0  # of that spring [N.m.s/rad]
    play: float = 0.0  # whole play between motor and link [rad]

    def simulate(self, goal: np.ndarray, hold: float, step: float = 20e-6) -> np.ndarray:
        """Motor and link position at the start of every hold, shape (n, 2) [rad].

        Args:
            goal: commands (n,) [rad], each held for ``hold`` [s].
            hold: time between two commands [s].
            step: of the integration [s].
        """
        return _simulate(np.array(astuple(self)), np.asarray(goal, float), round(hold / step), step)


@numba.njit(cache=True)
def _simulate(parameters, goal, steps, h):  # type: ignore[no-untyped-def]
    gain, volts, kt, ohm, rotor, viscous, coulomb, mass, length, stiffness, damping, play = parameters
    link = mass * length**2
    out = np.empty((len(goal), 2))
    q, w, lq, lw = goal[0], 0.0, goal[0], 0.0
    for n in range(len(goal)):
        out[n, 0], out[n, 1] = q, lq
        for _ in range(steps):
            duty = min(max(gain * (goal[n] - q), -1.0), 1.0)
            push = kt * (volts * duty - kt * w) / ohm - viscous * w
            if stiffness == 0.0:
                inertia = rotor + link
                push -= mass * 9.81 * length * math.sin(lq)
            else:
                inertia = rotor
                twist = q - lq
                free = max(abs(twist) - 0.5 * play, 0.0)
                pull = math.copysign(stiffness * free, twist)
                if free > 0.0 or play == 0.0:
                    pull += damping * (w - lw)
                push -= pull
                lw += h * (pull - mass * 9.81 * length * math.sin(lq)) / link
                lq += h * lw
            if w == 0.0 and abs(push) <= coulomb:
                pass
            else:
                way = math.copysign(1.0, w if w != 0.0 else push)
                new = w + h * (push - way * coulomb) / inertia
                w = 0.0 if w * new < 0.0 else new  # it stops before it can turn around
                q += h * w
            if stiffness == 0.0:
                lq = q
    return out


def excitation(seconds: float = 24.0, hold: float = 0.01) -> np.ndarray:
    """Goals [rad] of a log: a chirp, steps, a slow triangle and a multisine, a quarter of the time each."""
    quarter = round(seconds / 4.0 / hold)
    t = np.arange(quarter) * hold
    span = t[-1] + hold
    chirp = 0.6 * np.sin(2.0 * np.pi * (0.2 * t + (3.0 - 0.2) * t**2 / (2.0 * span)))
    steps = 0.8 * np.array([0.0, 1.0, -0.5, 0.3, -1.0, 0.1])[np.minimum((t / 1.0).astype(int), 5)]
    triangle = 0.5 * np.abs((t / 3.0 + 0.5) % 2.0 - 1.0) - 0.25
    tones = ((0.3, 0.25), (0.7, 0.2), (1.3, 0.12), (2.1, 0.08))
    multisine = np.sum([a * np.sin(2.0 * np.pi * f * t + k) for k, (f, a) in enumerate(tones)], axis=0)
    return np.concatenate([chirp, steps, triangle, multisine])
