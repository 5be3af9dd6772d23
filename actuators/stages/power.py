"""Power stage: from a duty to the voltage at the motor, with its limits and the sag of the supply."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from ..compiled import compiled
from ..layout import S_BESIDE, S_DUTY, S_VOLTAGE
from .base import ChainError, Law, Quantity, Stage, parameter, register
from .parity import EVEN, ODD

MOTOR_BEHIND = ("back_emf", "motor_resistance")


def motor_behind(chain: Any, stage: Stage) -> dict[str, float]:
    """:data:`MOTOR_BEHIND`: at the joint [V.s/rad] and [ohm], of the chain's motor, for limits and sag."""
    motor = chain.find("dc_motor")
    if motor is None:
        raise ChainError(f"{chain.label}: stage '{stage.name}' needs a 'dc_motor' behind it.")
    back_emf = motor.back_emf * chain.gear_ratio() * chain.magnetisation()
    return {"back_emf": back_emf, "motor_resistance": motor.resistance}


@register
@dataclass(frozen=True, kw_only=True)
class DutyLimit(Stage):
    """The duty saturates."""

    name: ClassVar[str] = "duty_limit"
    after: ClassVar[str] = "minimum_duty"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.DUTY,)

    limit: float = parameter(1.0, "-", 0.0, 1.0, "largest duty", parity=EVEN)


DUTY_LIMIT = DutyLimit.offsets()


@compiled()
def limited_duty(p, i, s, value):
    """A duty within the limit."""
    value = min(max(value, -p[i + DUTY_LIMIT.limit]), p[i + DUTY_LIMIT.limit])
    s[S_DUTY] = value
    return value


DutyLimit.law = Law(act=limited_duty)


@register
@dataclass(frozen=True, kw_only=True)
class MinimumDuty(Stage):
    """Minimum start-up force of hobby servos: a duty that is not zero is at least this large."""

    name: ClassVar[str] = "minimum_duty"
    after: ClassVar[str] = "duty_step"
    switches: ClassVar[bool] = True
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.DUTY,)

    value: float = parameter(None, "-", 0.0, 1.0, "smallest duty that is applied", parity=EVEN, neutral=0.0)


@compiled()
def at_least(duty, value):
    """Raise the size of a duty to ``value``, smoothly through zero over 1e-4 so that rest stays rest."""
    if abs(duty) >= value:
        return duty
    return value * min(max(duty / 1e-4, -1.0), 1.0)


MINIMUM_DUTY = MinimumDuty.offsets()


@compiled()
def raised_duty(p, i, s, value):
    """A duty that is large enough or zero."""
    value = at_least(value, p[i + MINIMUM_DUTY.value])
    s[S_DUTY] = value
    return value


MinimumDuty.law = Law(act=raised_duty)


@register
@dataclass(frozen=True, kw_only=True)
class DutyStep(Stage):
    """Firmware that computes with integers: the duty moves in steps, rounded down or towards zero."""

    name: ClassVar[str] = "duty_step"
    after: ClassVar[str] = "net"
    switches: ClassVar[bool] = True
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.DUTY,)

    size: float = parameter(
        None, "-", -1.0, 1.0, "one step of the duty; 0: continuous; below 0: rounded up", parity=ODD, neutral=0.0
    )
    towards_zero: float = parameter(
        0.0, "-", 0.0, 1.0, "1: rounded towards zero (division); 0: down (bit shift)", parity=EVEN
    )


DUTY_STEP = DutyStep.offsets()


@compiled()
def stepped(p, i, s, value):
    """The duty on its lattice."""
    size = p[i + DUTY_STEP.size]
    if size != 0.0:
        steps = value / size
        value = size * (math.trunc(steps) if p[i + DUTY_STEP.towards_zero] > 0.5 else math.floor(steps))
    s[S_DUTY] = value
    return value


DutyStep.law = Law(act=stepped)


@register
@dataclass(frozen=True, kw_only=True)
class Supply(Stage):
    """Supply voltage, which sags with the current that the bridge draws."""

    name: ClassVar[str] = "supply"
    after: ClassVar[str] = "regression"
    derived: ClassVar[tuple[str, ...]] = MOTOR_BEHIND
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.DUTY,)
    gives: ClassVar[Quantity | None] = Quantity.VOLTAGE

    volts: float = parameter(None, "V", 0.0, 1e3, "open-circuit supply voltage", parity=EVEN)
    resistance: float = parameter(0.0, "ohm", 0.0, 1e3, "of battery, wires and bridge together", parity=EVEN)
    shared: float = parameter(1.0, "-", 0.0, 1.0, "1: all such drives draw from it, 0: this one", parity=EVEN)

    def law_values(self, chain: Any) -> dict[str, float]:
        if self.resistance > 0.0:
            return {**super().law_values(chain), **motor_behind(chain, self)}
        return {**super().law_values(chain), **dict.fromkeys(MOTOR_BEHIND, 0.0)}  # no sag: the law reads no motor


SUPPLY = Supply.offsets()


@compiled()
def supplied_voltage(p, i, duty, w, beside):
    """Motor voltage: duty (volts - resistance (beside + duty current)), with the current that this very voltage drives
    and what others draw ``beside`` it.

    A chopping bridge draws ``duty`` times the motor current from the supply, so the sag follows from
    ``R i + k w = duty (V - R_s duty i)``, solved for ``i``.
    """
    volts, resistance = p[i + SUPPLY.volts], p[i + SUPPLY.resistance]
    if resistance == 0.0:
        return duty * volts
    volts -= resistance * beside
    current = (duty * volts - p[i + SUPPLY.back_emf] * w) / (p[i + SUPPLY.motor_resistance] + duty * duty * resistance)
    drawn = max(duty * current, 0.0)  # a supply does not rise by what the motor brakes into it
    return duty * (volts - resistance * drawn)


@compiled()
def bridge_voltage(p, i, s, value, w):
    """Motor voltage at the duty ``value`` [V]."""
    s[S_DUTY] = value
    voltage = supplied_voltage(p, i, value, w, s[S_BESIDE])
    s[S_VOLTAGE] = voltage
    return voltage


Supply.law = Law(act=bridge_voltage)


@register
@dataclass(frozen=True, kw_only=True)
class CurrentLimit(Stage):
    """The power stage lowers the voltage so that the motor current stays within a limit."""

    name: ClassVar[str] = "current_limit"
    after: ClassVar[str] = "supply"
    derived: ClassVar[tuple[str, ...]] = MOTOR_BEHIND
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.VOLTAGE,)

    limit: float = parameter(None, "A", 0.0, 1e4, "largest motor current", parity=EVEN, neutral=1e3)

    def law_values(self, chain: Any) -> dict[str, float]:
        return {**super().law_values(chain), **motor_behind(chain, self)}


CURRENT_LIMIT = CurrentLimit.offsets()


@compiled()
def current_limited_voltage(p, i, s, value, w):
    """Voltage whose steady current is within the limit, from the voltage ``value``."""
    back_emf = p[i + CURRENT_LIMIT.back_emf] * w
    reach = p[i + CURRENT_LIMIT.limit] * p[i + CURRENT_LIMIT.motor_resistance]
    voltage = min(max(value, back_emf - reach), back_emf + reach)
    s[S_VOLTAGE] = voltage
    return voltage


CurrentLimit.law = Law(act=current_limited_voltage)
