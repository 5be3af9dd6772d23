"""Motors: from voltage or duty to torque."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numba

from actuators.layout import S_CURRENT, S_TIME
from actuators.stages.base import Quantity, Stage, parameter, register


@register
@dataclass(frozen=True, kw_only=True)
class DCMotor(Stage):
    """Brushed or vector-controlled DC motor: current from voltage and back-EMF, torque from current."""

    name: ClassVar[str] = "dc_motor"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.VOLTAGE,)
    gives: ClassVar[Quantity | None] = Quantity.TORQUE
    opcode: ClassVar[int] = 30

    motor_constant: float = parameter(None, "N.m/A = V.s/rad", 1e-6, 1e3, "torque per current; at the joint, unless a gear follows")
    resistance: float = parameter(None, "ohm", 1e-4, 1e4, "of the winding")
    armature: float = parameter(0.0, "kg.m2", 0.0, 1e3, "rotor inertia; at the joint, unless a gear follows")
    inductance: float = parameter(0.0, "H", 0.0, 10.0, "of the winding; 0: the current follows at once")

    def law_parameters(self, chain: Any) -> list[float]:
        ratio = chain.gear_ratio()
        return [self.motor_constant * ratio, self.resistance, self.inductance]

    def memory_size(self) -> int:
        return 2


@numba.njit(cache=True)
def advance_current(p, i, s, m, time):
    """Carry the winding current over the step that has passed: exact for the voltage and speed at its start."""
    if p[i + 2] > 0.0:
        decay = math.exp(-(time - s[S_TIME]) * p[i + 1] / p[i + 2])
        s[m] = s[m + 1] + (s[m] - s[m + 1]) * decay


@numba.njit(cache=True)
def motor_torque(p, i, s, m, time, voltage, w, first):
    """Torque of a DC motor [N.m]; memory is [current at the step's start, steady current then]."""
    steady = (voltage - p[i] * w) / p[i + 1]
    current = steady
    if p[i + 2] > 0.0:
        if first:
            s[m + 1] = steady
        current = steady + (s[m] - steady) * math.exp(-max(time - s[S_TIME], 0.0) * p[i + 1] / p[i + 2])
    s[S_CURRENT] = current
    return p[i] * current


@register
@dataclass(frozen=True, kw_only=True)
class Regression(Stage):
    """Torque as a linear map of duty and speed, fitted on a brake bench (seed 004, equation (3))."""

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


@numba.njit(cache=True)
def regression_torque(p, i, duty, w):
    """Torque of the fitted map [N.m]."""
    return p[i] * duty + p[i + 1] * w + p[i + 2]


@register
@dataclass(frozen=True, kw_only=True)
class TorqueLimit(Stage):
    """The torque saturates."""

    name: ClassVar[str] = "torque_limit"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.TORQUE,)
    opcode: ClassVar[int] = 32

    limit: float = parameter(None, "N.m", 0.0, 1e6, "largest torque")
