"""Motors: from voltage or duty to torque."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from ..compiled import compiled
from ..layout import S_CURRENT, S_TIME
from .base import Quantity, Stage, parameter, register


@register
@dataclass(frozen=True, kw_only=True)
class DCMotor(Stage):
    """Brushed or vector-controlled DC motor: current from voltage and back-EMF, torque from current."""

    name: ClassVar[str] = "dc_motor"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.VOLTAGE,)
    gives: ClassVar[Quantity | None] = Quantity.TORQUE
    opcode: ClassVar[int] = 30

    motor_constant: float = parameter(
        None, "N.m/A = V.s/rad", 1e-6, 1e3, "torque per current; at the joint, unless a gear follows"
    )
    resistance: float = parameter(None, "ohm", 1e-4, 1e4, "of the winding")
    armature: float = parameter(0.0, "kg.m2", 0.0, 1e3, "rotor inertia; at the joint, unless a gear follows")
    inductance: float = parameter(0.0, "H", 0.0, 10.0, "of the winding; 0: the current follows at once")

    def law_parameters(self, chain: Any) -> list[float]:
        ratio = chain.gear_ratio()
        return [self.motor_constant * ratio * chain.magnetisation(), self.resistance, self.inductance]

    def memory_size(self) -> int:
        return 4


@register
@dataclass(frozen=True, kw_only=True)
class Thermal(Stage):
    """A warm motor's magnets are weaker: its motor constant falls with the temperature."""

    name: ClassVar[str] = "thermal"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.TORQUE,)

    loss: float = parameter(None, "1/K", -0.1, 0.1, "share of the motor constant lost per kelvin above the reference")
    temperature: float = parameter(25.0, "degC", -60.0, 250.0, "of the motor")
    reference: float = parameter(25.0, "degC", -60.0, 250.0, "temperature at which the motor constant holds")

    def factor(self, temperature: float) -> float:
        """Motor constant at a temperature [degC] over that at the reference."""
        return max(1.0 - self.loss * (temperature - self.reference), 0.05)


@compiled()
def lagged_current(current, steady, later, span, lag):
    """Current of a winding, exact while its steady value goes from ``steady`` to ``later`` in a line over ``span`` [A].

    ``lag`` is inductance by resistance [s]; solves ``lag di/dt + i = steady + (later - steady) t / span``.
    """
    x = span / lag
    decayed = -math.expm1(-x)
    return later - (later - steady) * decayed / x + (current - steady) * (1.0 - decayed)


@compiled()
def advance_current(p, i, s, m, time):
    """Carry the winding current over the step that has passed, along the steady current that its evaluations saw."""
    span = time - s[S_TIME]
    if p[i + 2] > 0.0 and span > 0.0:
        seen = s[m + 3] - s[S_TIME]
        slope = (s[m + 2] - s[m + 1]) / seen if seen > 0.0 else 0.0
        s[m] = lagged_current(s[m], s[m + 1], s[m + 1] + slope * span, span, p[i + 2] / p[i + 1])


@compiled()
def motor_torque(p, i, s, m, time, voltage, w, first):
    """Torque of a DC motor [N.m].

    Memory: current and steady current at the step's start, steady current at the latest evaluation, and its time.
    """
    steady = (voltage - p[i] * w) / p[i + 1]
    current = steady
    if p[i + 2] > 0.0:
        if first:
            s[m + 1] = steady
        s[m + 2] = steady
        s[m + 3] = time
        span = time - s[S_TIME]
        current = lagged_current(s[m], s[m + 1], steady, span, p[i + 2] / p[i + 1]) if span > 0.0 else s[m]
    s[S_CURRENT] = current
    return p[i] * current


@register
@dataclass(frozen=True, kw_only=True)
class Regression(Stage):
    """Torque as a linear map of duty and speed, fitted on a brake bench (paper 004, equation (3))."""

    name: ClassVar[str] = "regression"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.DUTY,)
    gives: ClassVar[Quantity | None] = Quantity.TORQUE
    opcode: ClassVar[int] = 31

    duty_torque: float = parameter(None, "N.m", -1e4, 1e4, "torque per duty")
    speed_torque: float = parameter(None, "N.m.s/rad", -1e4, 1e4, "torque per speed, negative for a motor")
    constant: float = parameter(0.0, "N.m", -1e3, 1e3, "torque at zero duty and speed")
    armature: float = parameter(0.0, "kg.m2", 0.0, 1e3, "rotor inertia; at the joint, unless a gear follows")

    def law_parameters(self, chain: Any) -> list[float]:
        ratio = chain.gear_ratio()
        return [self.duty_torque * ratio, self.speed_torque * ratio**2, self.constant * ratio]


@compiled()
def regression_torque(p, i, duty, w):
    """Torque of the fitted map [N.m]."""
    return p[i] * duty + p[i + 1] * w + p[i + 2]


@register
@dataclass(frozen=True, kw_only=True)
class TorqueLimit(Stage):
    """The torque saturates: that of the motor in front of a gear, that at the joint elsewhere."""

    name: ClassVar[str] = "torque_limit"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.TORQUE,)
    opcode: ClassVar[int] = 32

    limit: float = parameter(None, "N.m", 0.0, 1e6, "largest torque; of the motor, if a gear follows")

    def law_parameters(self, chain: Any) -> list[float]:
        names = [stage.name for stage in chain.stages]
        geared = "gear" in names and names.index("gear") > names.index(self.name)
        return [self.limit * (chain.gear_ratio() if geared else 1.0)]
