"""The paper's reference controller: two-legged hopping in five phases (paper 003, VIII-B and appendix C).

Its formulas reached us damaged; they are read as follows. The controlled variables are leg angle and motor position of
both sides, h = (qLA left, qmLS left, qLA right, qmLS right), and in every phase (34)

    u = K_p (h_ref - h) - K_d h'

with h' by numerical differentiation. With d = delta_LA / 2, e = eta_Tor and the gear ratio g of the leg shape:

    I     flight     angles -d - e, +d - e;  shapes g eta_LS                                     until both feet touch
    II    touchdown  angles q_Tor + (left + right) / 2 - e -+ d;  shapes g eta_LS   until the horizontal speed is small
    III   kick-off   angles as in II;  shapes g (eta_LS - delta_minus)                     until a foot leaves the floor
    IV    lift-off   angles held;  shape of the lifted leg g (eta_LS + delta_plus)               until both feet are off
    V     retract    angles held;  both shapes g (eta_LS + delta_plus)                                      for 50 ms

Angles count from the leg that hangs down the torso, where the paper has 180 degrees. The event-based update (44) sets
eta_Tor at every touchdown to eta_Tor0 + K_Tor (delta_phi - delta_phi_d), delta_phi being the boom's turn since the
touchdown before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from ...envs.biped.drive import ANGLE, RATIO, SHAPE

PERIOD = 0.001  # [s], VIII-C
RETRACTION = 0.050  # [s], (43)
RATIOS = np.array([RATIO[ANGLE], RATIO[SHAPE]] * 2)


class Phase(IntEnum):
    """Phases of Fig. 20."""

    FLIGHT = 1
    TOUCHDOWN = 2
    KICK_OFF = 3
    LEFT_OFF = 4
    RIGHT_OFF = 5
    RETRACT = 6


@dataclass(frozen=True)
class Gait:
    """Parameters of the controller; angles [rad], order of sides: left, right.

    Printed in (46): leg_spread, shape, kick, retraction, torso_gain. Assumed: the rest.

    Attributes:
        leg_spread: delta_LA, between the legs.
        shape: eta_LS.
        kick: delta_minus, by which the legs are stretched.
        retraction: delta_plus, by which they are drawn in.
        torso: eta_Tor0, lean of the torso.
        torso_gain: K_Tor, torso lean per turn of the boom.
        travel: delta_phi_d, turn of the boom per hop.
        slow: horizontal speed of the centre of mass below which the legs kick [m/s].
        gains: K_p of leg angle and leg shape at the motor [N.m/rad].
        dampings: K_d of leg angle and leg shape at the motor [N.m.s/rad].
        limits: largest commanded torque of leg angle and leg shape [N.m].
    """

    leg_spread: float = math.radians(30.0)
    shape: tuple[float, float] = (math.radians(12.0), math.radians(12.0))
    kick: tuple[float, float] = (math.radians(5.0), math.radians(18.0))
    retraction: tuple[float, float] = (math.radians(5.0), math.radians(5.0))
    torso: float = 0.151
    torso_gain: float = 8.0
    travel: float = math.radians(-0.69)
    slow: float = 0.01
    gains: tuple[float, float] = (28.0, 6.3)
    dampings: tuple[float, float] = (2.7, 0.19)
    limits: tuple[float, float] = (8.0, 16.0)


@dataclass
class HoppingController:
    """The controller and its memory; one call of :meth:`torques` per millisecond."""

    gait: Gait = field(default_factory=Gait)
    phase: Phase = Phase.FLIGHT
    hops: int = 0
    lean: float = 0.0
    _since: float = 0.0
    _landing: float = 0.0
    _held: np.ndarray = field(default_factory=lambda: np.zeros(2))
    _boom: float | None = None
    _before: np.ndarray | None = None

    def __post_init__(self) -> None:
        gait = self.gait
        self.lean = gait.torso
        self._spread = np.array([-0.5, 0.5]) * gait.leg_spread
        self._gains, self._dampings, self._limits = (
            np.array(pair * 2) for pair in (gait.gains, gait.dampings, gait.limits)
        )
        rest, kick, drawn = (np.array(angle) * RATIO[SHAPE] for angle in (gait.shape, gait.kick, gait.retraction))
        lifted = {
            Phase.KICK_OFF: (False, False),
            Phase.LEFT_OFF: (True, False),
            Phase.RIGHT_OFF: (False, True),
            Phase.RETRACT: (True, True),
        }
        self._shapes = dict.fromkeys(Phase, rest)
        self._shapes |= {phase: rest + np.where(off, drawn, -kick) for phase, off in lifted.items()}

    def torques(
        self,
        time: float,
        pitch: float,
        angles: np.ndarray,
        motors: np.ndarray,
        contact: np.ndarray,
        speed: float,
        boom: float,
    ) -> np.ndarray:
        """Commanded torques at the motors [N.m], (4,): leg angle and leg shape of the left, then of the right.

        Args:
            time: now [s].
            pitch: of the torso [rad].
            angles: leg angles from the joints' encoders (2,) [rad].
            motors: positions of the leg shape motors (2,) [rad at the motor].
            contact: whether each foot is on the floor (2,).
            speed: forward speed of the centre of mass [m/s].
            boom: its turn about the tower [rad].
        """
        self._advance(time, contact, speed, boom)
        spread = self._spread
        if self.phase == Phase.FLIGHT:
            wanted = spread - self.lean
        elif self.phase in (Phase.TOUCHDOWN, Phase.KICK_OFF):
            wanted = self._held = spread + (pitch + 0.5 * (angles[0] + angles[1]) - self.lean)
        else:
            wanted = self._held
        shapes = self._shapes[self.phase]
        goal = np.array([wanted[0], shapes[0], wanted[1], shapes[1]])
        controlled = np.array([angles[0], motors[0], angles[1], motors[1]])
        rate = (controlled - self._before) / PERIOD if self._before is not None else np.zeros(4)
        self._before = controlled
        torque = self._gains * (goal - controlled) - self._dampings * rate
        return np.minimum(np.maximum(torque, -self._limits), self._limits)

    def _advance(self, time: float, contact: np.ndarray, speed: float, boom: float) -> None:
        """Go on to the phase that the measurements ask for."""
        left, right = bool(contact[0]), bool(contact[1])
        phase = self.phase
        if phase == Phase.FLIGHT and left and right:
            phase, self._landing = Phase.TOUCHDOWN, speed
            self._update(boom)
        elif phase == Phase.TOUCHDOWN and (abs(speed) < self.gait.slow or speed * self._landing < 0.0):
            phase = Phase.KICK_OFF  # small, or through zero between two samples
        elif phase in (Phase.KICK_OFF, Phase.LEFT_OFF, Phase.RIGHT_OFF) and not left and not right:
            phase = Phase.RETRACT
        elif phase == Phase.KICK_OFF and not left:
            phase = Phase.LEFT_OFF
        elif phase == Phase.KICK_OFF and not right:
            phase = Phase.RIGHT_OFF
        elif phase == Phase.RETRACT and time >= self._since + RETRACTION:
            phase = Phase.FLIGHT
        if phase != self.phase:
            self.phase, self._since = phase, time

    def _update(self, boom: float) -> None:
        """The event-based update of the torso's lean at touchdown, (44)."""
        self.hops += 1
        if self._boom is not None:
            self.lean = self.gait.torso + self.gait.torso_gain * (boom - self._boom - self.gait.travel)
        self._boom = boom
