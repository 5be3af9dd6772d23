"""Whether a hop that is off heals: the return map of the gait (paper 003, VIII-D), iterated instead of linearised.

The state is taken at the highest point of the hip, hop by hop, of a run whose torso is put off once and of one that is
not. A Jacobian would mislead here: the first hop answers to a pitch that is off with up to three times as much lean,
which the next ones take back, and touchdowns are seen at samples of 1 ms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ...common.errors import SealegsError
from .controller import PERIOD, Gait, Phase
from .hopping import HoppingExperiment

SETTLING = 25  # hops before the torso is put off
FINE = 2**26  # steps per turn of the encoders on joints and boom
LONGEST = 1.6  # [s] from one highest point to the next
AIR = (Phase.RETRACT, Phase.FLIGHT)  # of the highest point that counts: the hip has another one in the stance
OFF = 1e-3  # [rad] by which the pitch is put off, to either side
HOPS = 10  # after which it is looked at


@dataclass(frozen=True)
class Healing:
    """What becomes of a pitch that is off.

    Attributes:
        pitch: off what it would have been, at each highest point, by sign (2, hops) [rad]; nan after a fall.
    """

    pitch: np.ndarray

    @property
    def fell(self) -> bool:
        """Whether the biped fell."""
        return bool(np.isnan(self.pitch).any())

    @property
    def left(self) -> float:
        """Largest deviation of the last three hops [rad]; inf after a fall."""
        return math.inf if self.fell else float(np.abs(self.pitch[:, -3:]).max())

    @property
    def multiplier(self) -> float:
        """By how much a hop multiplies the deviation, in the mean over all of them; inf after a fall."""
        return (self.left / OFF) ** (1.0 / self.pitch.shape[1])


def settled(gait: Gait | None = None, substeps: int = 2) -> HoppingExperiment:
    """The biped at the highest point of a hop, after so many.

    Raises:
        SealegsError: it fell before.
    """
    experiment = HoppingExperiment(gait, joint_ticks=FINE, substeps=substeps)
    if experiment.run(SETTLING).fell or math.isnan(to_apex(experiment)):
        raise SealegsError(f"the biped fell before {SETTLING} hops; what a hop hands on needs a gait that lasts.")
    return experiment


def healing(apex: HoppingExperiment, update: bool) -> Healing:
    """Put the pitch off at ``apex`` and go on.

    Args:
        apex: as :func:`settled` leaves it.
        update: whether the lean is updated by (44); without, it stays as it is in this hop.
    """
    gait = apex.gait
    if not update:
        gait = replace(gait, torso=float(apex.controller.lean), torso_gain=0.0)

    def pitches(off: float) -> np.ndarray:
        experiment = HoppingExperiment(gait, joint_ticks=FINE, substeps=apex.substeps)
        experiment.start_from(apex)
        experiment.controller.gait = gait
        experiment.data.qpos[2] += off
        return np.array([to_apex(experiment) for _ in range(HOPS)])

    undisturbed = pitches(0.0)
    return Healing(np.stack([pitches(sign * OFF) - undisturbed for sign in (1.0, -1.0)]))


def to_apex(experiment: HoppingExperiment) -> float:
    """Pitch at the next highest point of a flight [rad], between two periods of the controller; nan: it fell."""
    data, controller = experiment.data, experiment.controller
    begun, before, rising = data.time, float(data.qpos[2]), float(data.qvel[1])
    while data.time - begun < LONGEST:
        experiment.step()
        pitch, speed = float(data.qpos[2]), float(data.qvel[1])
        if data.qpos[1] < 0.5 or abs(pitch) > 1.0:
            return math.nan
        if rising > 0.0 >= speed and controller.phase in AIR and data.time - begun > 2.0 * PERIOD:
            return before + rising / (rising - speed) * (pitch - before)
        before, rising = pitch, speed
    return math.nan
