"""Friction of high-geared transmissions, with what each pair of teeth adds as it meshes."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, ClassVar

from ..compiled import compiled
from ..layout import S_LIMIT
from .base import ChainError, Law, Quantity, Stage, parameter, register
from .friction import REST_SPEED
from .parity import EVEN, Phase, Swapped

MOTOR_TORQUE, MOTOR_SPEED = "N.m", "rad/s"


def _torque(doc: str, other: str) -> Any:
    return parameter(0.0, MOTOR_TORQUE, 0.0, 1e4, doc, parity=Swapped(other))


def _viscous(doc: str, other: str) -> Any:
    return parameter(0.0, "N.m.s/rad", 0.0, 1e4, doc, parity=Swapped(other))


def _speed(doc: str, other: str) -> Any:
    return parameter(1.0, MOTOR_SPEED, 1e-4, 1e5, doc, parity=Swapped(other))


def _decay(doc: str, other: str) -> Any:
    return parameter(0.0, "s/rad", 0.0, 1e3, doc, parity=Swapped(other))


def _frequency(doc: str) -> Any:
    return parameter(1.0, "1/rad", 0.0, 1e4, doc, parity=EVEN)


def _phase(doc: str, count: str) -> Any:
    return parameter(0.0, "rad", -10.0, 10.0, doc, parity=Phase(count, kept=False, of_motor=True))


@register
@dataclass(frozen=True, kw_only=True)
class Meshing(Stage):
    """Friction of a gear train with its meshing, each direction of rotation with numbers of its own.

    Behind a ``gear`` all numbers are the motor's: its torque, its speed ``w`` and its angle ``a``; elsewhere those of
    the joint. Paper 000, equation (16), with the third sine that its tables have and the viscous friction of (15):

        limit = coulomb + (breakaway - coulomb) exp(-|w| / stribeck_velocity) + viscous |w|
                + ripple_1 sin(frequency_1 a + phase_1)
                + ripple_2 exp(-decay_2 |w|) sin(frequency_2 a + phase_2)
                + ripple_3 exp(-decay_3 |w|) sin(frequency_3 a + phase_3)

    It adds to the limit of ``friction``, whose sticking must be rigid; there is no further gear efficiency in it.
    """

    name: ClassVar[str] = "meshing"
    after: ClassVar[str] = "friction"
    at_end: ClassVar[bool] = True
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.TORQUE,)

    breakaway_positive: float = _torque("dry friction at rest, turning positive", "breakaway_negative")
    breakaway_negative: float = _torque("the same, turning negative", "breakaway_positive")
    coulomb_positive: float = _torque(
        "dry friction far above the Stribeck velocity, turning positive", "coulomb_negative"
    )
    coulomb_negative: float = _torque("the same, turning negative", "coulomb_positive")
    stribeck_velocity_positive: float = _speed(
        "speed at which breakaway has fallen to 1/e, turning positive", "stribeck_velocity_negative"
    )
    stribeck_velocity_negative: float = _speed("the same, turning negative", "stribeck_velocity_positive")
    viscous_positive: float = _viscous("friction per speed, turning positive", "viscous_negative")
    viscous_negative: float = _viscous("the same, turning negative", "viscous_positive")
    ripple_1_positive: float = _torque(
        "amplitude of the first sine over position, turning positive", "ripple_1_negative"
    )
    ripple_1_negative: float = _torque("the same, turning negative", "ripple_1_positive")
    ripple_2_positive: float = _torque("amplitude of the second sine at rest, turning positive", "ripple_2_negative")
    ripple_2_negative: float = _torque("the same, turning negative", "ripple_2_positive")
    ripple_3_positive: float = _torque("amplitude of the third sine at rest, turning positive", "ripple_3_negative")
    ripple_3_negative: float = _torque("the same, turning negative", "ripple_3_positive")
    decay_2_positive: float = _decay("of the second sine over speed, turning positive", "decay_2_negative")
    decay_2_negative: float = _decay("the same, turning negative", "decay_2_positive")
    decay_3_positive: float = _decay("of the third sine over speed, turning positive", "decay_3_negative")
    decay_3_negative: float = _decay("the same, turning negative", "decay_3_positive")
    frequency_1: float = _frequency("periods per turn of the first sine")
    frequency_2: float = _frequency("periods per turn of the second sine")
    frequency_3: float = _frequency("periods per turn of the third sine")
    phase_1: float = _phase("of the first sine", "frequency_1")
    phase_2: float = _phase("of the second sine", "frequency_2")
    phase_3: float = _phase("of the third sine", "frequency_3")

    def check(self, chain: Any) -> None:
        friction = chain.find("friction")
        if friction is not None and (friction.bristle_stiffness > 0.0 or friction.slip_speed > 0.0):
            raise ChainError(
                f"{chain.label}: 'meshing' is a friction that sticks rigidly; take the bristles or the slip_speed out "
                "of 'friction'."
            )

    def law_values(self, chain: Any) -> dict[str, float]:
        """The numbers at the joint."""
        ratio = chain.gear_ratio()
        factors = {MOTOR_TORQUE: ratio, "N.m.s/rad": ratio**2, MOTOR_SPEED: 1.0 / ratio, "s/rad": ratio, "1/rad": ratio}
        units = {item.name: item.metadata["unit"] for item in dataclasses.fields(self)}
        return {key: value * factors.get(units[key], 1.0) for key, value in super().law_values(chain).items()}

    def coulomb(self, chain: Any) -> float:
        """Coulomb friction at the joint, mean of both directions [N.m]: what the engine alone knows of it."""
        return 0.5 * (self.coulomb_positive + self.coulomb_negative) * chain.gear_ratio()

    def shapes_dry_friction(self) -> bool:
        return True


MESHING = Meshing.offsets()
NEGATIVE = 1  # numbers of a direction stand in pairs
SMALL, LARGE = 1e-4, 40.0  # exponents below which a series of four terms, and from which 0, is exp(-x) to rounding


@compiled()
def fallen(x):
    """exp(-x) for x from 0 on."""
    if x < SMALL:
        return 1.0 - x * (1.0 - 0.5 * x * (1.0 - x / 3.0))
    return 0.0 if x > LARGE else math.exp(-x)


@compiled()
def meshing_limit(p, i, q, w, push):
    """Dry and viscous friction torque at most [N.m], for the direction in which the joint moves or is pushed."""
    speed = abs(w)
    direction = w if speed > REST_SPEED else push
    k = i if direction >= 0.0 else i + NEGATIVE
    limit = p[k + MESHING.coulomb_positive] + p[k + MESHING.viscous_positive] * speed
    extra = p[k + MESHING.breakaway_positive] - p[k + MESHING.coulomb_positive]
    if extra != 0.0:
        limit += extra * fallen(speed / p[k + MESHING.stribeck_velocity_positive])
    if p[k + MESHING.ripple_1_positive] != 0.0:
        limit += p[k + MESHING.ripple_1_positive] * math.sin(p[i + MESHING.frequency_1] * q + p[i + MESHING.phase_1])
    if p[k + MESHING.ripple_2_positive] != 0.0:
        amplitude = p[k + MESHING.ripple_2_positive] * fallen(p[k + MESHING.decay_2_positive] * speed)
        limit += amplitude * math.sin(p[i + MESHING.frequency_2] * q + p[i + MESHING.phase_2])
    if p[k + MESHING.ripple_3_positive] != 0.0:
        amplitude = p[k + MESHING.ripple_3_positive] * fallen(p[k + MESHING.decay_3_positive] * speed)
        limit += amplitude * math.sin(p[i + MESHING.frequency_3] * q + p[i + MESHING.phase_3])
    return max(limit, 0.0)


@compiled()
def meshing_friction(p, i, s, value, q, w, external):
    """Add to the limit of dry friction in the state; the torque passes as it is [N.m]."""
    s[S_LIMIT] += meshing_limit(p, i, q, w, value + external)
    return value


@compiled()
def undriven_meshing(p, i, s, q, w, external):
    """The same where no motor torque acts."""
    s[S_LIMIT] += meshing_limit(p, i, q, w, external)
    return 0.0


Meshing.law = Law(act=meshing_friction, idle=undriven_meshing)
