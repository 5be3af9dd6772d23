"""Motors: from voltage or duty to torque."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from ..compiled import compiled
from ..layout import S_CURRENT, S_DUTY, S_TIME
from .base import Law, Quantity, Stage, parameter, register
from .parity import EVEN, ODD


@register
@dataclass(frozen=True, kw_only=True)
class DCMotor(Stage):
    """Brushed or vector-controlled DC motor: current from voltage and back-EMF, torque from current."""

    name: ClassVar[str] = "dc_motor"
    after: ClassVar[str] = "current_limit"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.VOLTAGE,)
    gives: ClassVar[Quantity | None] = Quantity.TORQUE

    motor_constant: float = parameter(
        None, "N.m/A = V.s/rad", 1e-6, 1e3, "torque per current; at the joint, unless a gear follows", parity=EVEN
    )
    resistance: float = parameter(None, "ohm", 1e-4, 1e4, "of the winding", parity=EVEN)
    armature: float = parameter(
        0.0, "kg.m2", 0.0, 1e3, "rotor inertia; at the joint, unless a gear follows", parity=EVEN, in_law=False
    )
    inductance: float = parameter(0.0, "H", 0.0, 10.0, "of the winding; 0: the current follows at once", parity=EVEN)
    emf_ratio: float = parameter(
        1.0, "-", 0.1, 10.0, "back-EMF constant over torque constant, where a data sheet has two", parity=EVEN
    )

    @property
    def back_emf(self) -> float:
        """Voltage per speed [V.s/rad]; at the joint, unless a gear follows."""
        return self.motor_constant * self.emf_ratio

    def law_values(self, chain: Any) -> dict[str, float]:
        constant = self.motor_constant * chain.gear_ratio() * chain.magnetisation()
        return {**super().law_values(chain), "motor_constant": constant}

    def memory_size(self) -> int:
        return 4


MOTOR = DCMotor.offsets()


@register
@dataclass(frozen=True, kw_only=True)
class Thermal(Stage):
    """A warm motor's magnets are weaker: its motor constant falls with the temperature."""

    name: ClassVar[str] = "thermal"
    after: ClassVar[str] = "gear"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.TORQUE,)

    loss: float = parameter(
        None,
        "1/K",
        -0.1,
        0.1,
        "share of the motor constant lost per kelvin above the reference",
        parity=EVEN,
        neutral=0.0,
    )
    temperature: float = parameter(25.0, "degC", -60.0, 250.0, "of the motor", parity=EVEN)
    reference: float = parameter(
        25.0, "degC", -60.0, 250.0, "temperature at which the motor constant holds", parity=EVEN
    )

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
    span, inductance = time - s[S_TIME], p[i + MOTOR.inductance]
    if inductance > 0.0 and span > 0.0:
        seen = s[m + 3] - s[S_TIME]
        slope = (s[m + 2] - s[m + 1]) / seen if seen > 0.0 else 0.0
        s[m] = lagged_current(s[m], s[m + 1], s[m + 1] + slope * span, span, inductance / p[i + MOTOR.resistance])


@compiled()
def motor_torque(p, i, s, m, time, value, w, first):
    """Torque of a DC motor at the voltage ``value`` [N.m].

    Memory: current and steady current at the step's start, steady current at the latest evaluation, and its time.
    """
    constant, resistance, inductance = p[i + MOTOR.motor_constant], p[i + MOTOR.resistance], p[i + MOTOR.inductance]
    steady = (value - p[i + MOTOR.emf_ratio] * constant * w) / resistance
    current = steady
    if inductance > 0.0:
        if first:
            s[m + 1] = steady
        s[m + 2] = steady
        s[m + 3] = time
        span = time - s[S_TIME]
        current = lagged_current(s[m], s[m + 1], steady, span, inductance / resistance) if span > 0.0 else s[m]
    s[S_CURRENT] = current
    return constant * current


DCMotor.law = Law(advance=advance_current, act=motor_torque)


@register
@dataclass(frozen=True, kw_only=True)
class Regression(Stage):
    """Torque as a linear map of duty and speed, fitted on a brake bench (paper 004, equation (3))."""

    name: ClassVar[str] = "regression"
    after: ClassVar[str] = "duty_limit"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.DUTY,)
    gives: ClassVar[Quantity | None] = Quantity.TORQUE

    duty_torque: float = parameter(None, "N.m", -1e4, 1e4, "torque per duty", parity=EVEN)
    speed_torque: float = parameter(None, "N.m.s/rad", -1e4, 1e4, "torque per speed, negative for a motor", parity=EVEN)
    constant: float = parameter(0.0, "N.m", -1e3, 1e3, "torque at zero duty and speed", parity=ODD)
    armature: float = parameter(
        0.0, "kg.m2", 0.0, 1e3, "rotor inertia; at the joint, unless a gear follows", parity=EVEN, in_law=False
    )

    def law_values(self, chain: Any) -> dict[str, float]:
        ratio = chain.gear_ratio()
        return {
            "duty_torque": self.duty_torque * ratio,
            "speed_torque": self.speed_torque * ratio**2,
            "constant": self.constant * ratio,
        }


REGRESSION = Regression.offsets()


@compiled()
def regression_torque(p, i, s, value, w):
    """Torque of the fitted map at the duty ``value`` [N.m]."""
    s[S_DUTY] = value
    return p[i + REGRESSION.duty_torque] * value + p[i + REGRESSION.speed_torque] * w + p[i + REGRESSION.constant]


Regression.law = Law(act=regression_torque)


@register
@dataclass(frozen=True, kw_only=True)
class TorqueLimit(Stage):
    """The torque saturates: that of the motor in front of a gear, that at the joint elsewhere."""

    name: ClassVar[str] = "torque_limit"
    after: ClassVar[str] = "dc_motor"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.TORQUE,)

    limit: float = parameter(
        None, "N.m", 0.0, 1e6, "largest torque; of the motor, if a gear follows", parity=EVEN, neutral=1e3
    )

    def law_values(self, chain: Any) -> dict[str, float]:
        names = [stage.name for stage in chain.stages]
        geared = "gear" in names and names.index("gear") > names.index(self.name)
        return {"limit": self.limit * (chain.gear_ratio() if geared else 1.0)}


TORQUE_LIMIT = TorqueLimit.offsets()


@compiled()
def limited_torque(p, i, value):
    """A torque within the limit [N.m]."""
    return min(max(value, -p[i + TORQUE_LIMIT.limit]), p[i + TORQUE_LIMIT.limit])


TorqueLimit.law = Law(act=limited_torque)
