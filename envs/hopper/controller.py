"""The paper's reference controller: a bang-bang law on the springs that makes the leg hop without a model or a clock.

Paper 004, section IV-B: "Whenever a defined torque threshold (epsilon = 0.3) was crossed, a 1D-control signal theta_z =
0.23 was triggered. This signal was then transformed to position commands for each servo by a weighting vector (w =
[-0.5, 1])". The paper leaves the rest to its references; read here as in Lakatos' work on switching control of
compliant robots: the torque is that of the springs along w, and the signal has its sign, so that the springs are always
loaded further in the direction they are loaded in:

    tau   = k (theta - q)            spring torques, from motor and link encoders
    tau_z = w . tau
    z     = theta_z sign(tau_z)  if |tau_z| > epsilon, else 0
    goal  = q0 + w z

The printed numbers bear this reading out: a step of theta_z raises |tau_z| by k |w|^2 theta_z = 0.575 N.m where the
motor is ideal, and its end lowers it from 0.3 to -0.275 N.m, which is just inside the threshold, so the signal does not
chatter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...actuators import Chain
from ...common.errors import SealegsError


@dataclass(frozen=True)
class BangBang:
    """Parameters of the controller, as printed in paper 004, IV-A and IV-B; order of coordinates: hip, knee.

    Attributes:
        threshold: epsilon [N.m].
        amplitude: theta_z [rad].
        weights: w.
        rest: q0 [rad].
        stiffness: k [N.m/rad].
    """

    threshold: float = 0.3
    amplitude: float = 0.23
    weights: tuple[float, float] = (-0.5, 1.0)
    rest: tuple[float, float] = (-0.61, 0.61)
    stiffness: float = 2.0

    def goals(self, motor: np.ndarray, link: np.ndarray) -> np.ndarray:
        """Position goals [rad] from motor and link positions [rad], all (..., 2)."""
        torque = self.stiffness * (motor - link)
        along = torque[..., 0] * self.weights[0] + torque[..., 1] * self.weights[1]
        signal = self.amplitude * np.sign(along) * (np.abs(along) > self.threshold)
        return np.asarray(self.rest) + signal[..., None] * np.asarray(self.weights)


def spring_stiffness(chain: Chain) -> float:
    """Stiffness between motor and link [N.m/rad]: of the series spring, or of the ideal servo that stands for it.

    Raises:
        SealegsError: the chain has neither, so there is no torque that the controller could feel.
    """
    for stage in ("spring", "ideal"):
        if (element := chain.find(stage)) is not None:
            return element.stiffness
    raise SealegsError(
        f"actuator '{chain.label}' has no 'spring' and is not 'ideal': the reference controller needs one."
    )
