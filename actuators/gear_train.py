"""Inertia of a servo from its dismantled parts: paper 004, section III-D and table I."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class GearStage:
    """A pinion that drives a wheel.

    Attributes:
        pinion_teeth, wheel_teeth: teeth counts.
        pinion, wheel: their inertias [kg.m2].
        shaft: inertia of what else turns with the wheel, such as a connector or the output shaft [kg.m2].
    """

    pinion_teeth: int
    wheel_teeth: int
    pinion: float
    wheel: float
    shaft: float = 0.0

    @property
    def ratio(self) -> float:
        """Turns of the pinion per turn of the wheel."""
        return self.wheel_teeth / self.pinion_teeth


def disk_inertia(mass: float, diameter: float) -> float:
    """Inertia of a disk of ``mass`` [kg] and ``diameter`` [m] about its axis [kg.m2]."""
    return mass * diameter**2 / 8.0


def total_ratio(stages: Sequence[GearStage]) -> float:
    """Turns of the rotor per turn of the output shaft."""
    ratio = 1.0
    for stage in stages:
        ratio *= stage.ratio
    return ratio


def output_inertia(rotor: float, stages: Sequence[GearStage]) -> float:
    """Inertia of all rotating parts at the output shaft [kg.m2]: each times the square of its turns per output turn.

    Args:
        rotor: inertia of the motor's rotor [kg.m2].
        stages: from the motor to the output.
    """
    ratio = total_ratio(stages)
    total = rotor * ratio**2
    for stage in stages:
        total += stage.pinion * ratio**2
        ratio /= stage.ratio
        total += (stage.wheel + stage.shaft) * ratio**2
    return total


G_MM2 = 1e-9  # [kg.m2]
SV1270TG_ROTOR = 114.69 * G_MM2
SV1270TG_STAGES = (
    GearStage(12, 59, 0.31 * G_MM2, 12.86 * G_MM2),
    GearStage(11, 48, 0.35 * G_MM2, 41.11 * G_MM2, shaft=20.02 * G_MM2),  # the connector
    GearStage(12, 48, 1.07 * G_MM2, 8.94 * G_MM2),
    GearStage(17, 57, 6.42 * G_MM2, 473.74 * G_MM2, shaft=7.42 * G_MM2),
)
"""Table I; its totals are 287.74 and 9578657.94 g.mm2."""
