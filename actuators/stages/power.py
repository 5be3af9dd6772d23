"""Power stage: from a duty to the voltage at the motor, with its limits and the sag of the supply."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from ..compiled import compiled
from .base import ChainError, Quantity, Stage, parameter, register


def motor_behind(chain: Any, stage: Stage) -> list[float]:
    """Motor constant at the joint [V.s/rad] and resistance [ohm] of the chain's motor, for limits and sag."""
    motor = chain.find("dc_motor")
    if motor is None:
        raise ChainError(f"{chain.label}: stage '{stage.name}' needs a 'dc_motor' behind it.")
    return [motor.motor_constant * chain.gear_ratio() * chain.magnetisation(), motor.resistance]


@register
@dataclass(frozen=True, kw_only=True)
class DutyLimit(Stage):
    """The duty saturates."""

    name: ClassVar[str] = "duty_limit"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.DUTY,)
    opcode: ClassVar[int] = 20

    limit: float = parameter(1.0, "-", 0.0, 1.0, "largest duty")


@register
@dataclass(frozen=True, kw_only=True)
class MinimumDuty(Stage):
    """Minimum start-up force of hobby servos: a duty that is not zero is at least this large."""

    name: ClassVar[str] = "minimum_duty"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.DUTY,)
    opcode: ClassVar[int] = 21

    value: float = parameter(None, "-", 0.0, 1.0, "smallest duty that is applied")


@compiled()
def at_least(duty, value):
    """Raise the size of a duty to ``value``, smoothly through zero over 1e-4 so that rest stays rest."""
    if abs(duty) >= value:
        return duty
    return value * min(max(duty / 1e-4, -1.0), 1.0)


@register
@dataclass(frozen=True, kw_only=True)
class DutyStep(Stage):
    """Firmware that computes with integers: the duty moves in steps, rounded down or towards zero."""

    name: ClassVar[str] = "duty_step"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.DUTY,)
    opcode: ClassVar[int] = 24

    size: float = parameter(None, "-", 0.0, 1.0, "one step of the duty; 0: continuous")
    towards_zero: float = parameter(0.0, "-", 0.0, 1.0, "1: rounded towards zero (division); 0: down (bit shift)")


@compiled()
def stepped(p, i, duty):
    """The duty on its lattice."""
    if p[i] == 0.0:
        return duty
    steps = duty / p[i]
    return p[i] * (math.trunc(steps) if p[i + 1] > 0.5 else math.floor(steps))


@register
@dataclass(frozen=True, kw_only=True)
class Supply(Stage):
    """Supply voltage, which sags with the current that the bridge draws."""

    name: ClassVar[str] = "supply"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.DUTY,)
    gives: ClassVar[Quantity | None] = Quantity.VOLTAGE
    opcode: ClassVar[int] = 22

    volts: float = parameter(None, "V", 0.0, 1e3, "open-circuit supply voltage")
    resistance: float = parameter(0.0, "ohm", 0.0, 1e3, "of battery, wires and bridge together")

    def law_parameters(self, chain: Any) -> list[float]:
        motor = motor_behind(chain, self) if self.resistance > 0.0 else [0.0, 1.0]
        return [self.volts, self.resistance, *motor]


@compiled()
def supplied_voltage(p, i, duty, w):
    """Motor voltage: duty (volts - resistance duty current), with the current that this very voltage drives.

    A chopping bridge draws ``duty`` times the motor current from the supply, so the sag follows from
    ``R i + k w = duty (V - R_s duty i)``, solved for ``i``.
    """
    if p[i + 1] == 0.0:
        return duty * p[i]
    current = (duty * p[i] - p[i + 2] * w) / (p[i + 3] + duty * duty * p[i + 1])
    drawn = max(duty * current, 0.0)  # a supply does not rise by what the motor brakes into it
    return duty * (p[i] - p[i + 1] * drawn)


@register
@dataclass(frozen=True, kw_only=True)
class CurrentLimit(Stage):
    """The power stage lowers the voltage so that the motor current stays within a limit."""

    name: ClassVar[str] = "current_limit"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.VOLTAGE,)
    opcode: ClassVar[int] = 23

    limit: float = parameter(None, "A", 0.0, 1e4, "largest motor current")

    def law_parameters(self, chain: Any) -> list[float]:
        return [self.limit, *motor_behind(chain, self)]


@compiled()
def current_limited_voltage(p, i, voltage, w):
    """Voltage whose steady current is within the limit."""
    back_emf = p[i + 1] * w
    reach = p[i] * p[i + 2]
    return min(max(voltage, back_emf - reach), back_emf + reach)
