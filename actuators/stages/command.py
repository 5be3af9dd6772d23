"""Stages on the way of a command to the controller: delay, rate limit, dead band, offset, gain."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from ..compiled import compiled
from ..layout import DELAY_EVENTS, S_READING, S_TIME
from .base import Quantity, Stage, parameter, register

EVENT = 3  # doubles of a remembered command: when it came, its value, changes since the event before it
SIGNALS = (Quantity.POSITION_GOAL, Quantity.DUTY, Quantity.TORQUE)


@register
@dataclass(frozen=True, kw_only=True)
class Delay(Stage):
    """The command reaches the controller late, by any time, not only whole simulation steps."""

    name: ClassVar[str] = "delay"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.POSITION_GOAL,)
    opcode: ClassVar[int] = 1

    seconds: float = parameter(None, "s", 0.0, 10.0, "time from sending a command to its effect")

    def law_parameters(self, chain: Any) -> list[float]:
        del chain
        return [self.seconds, 2.0 * self.seconds / (DELAY_EVENTS - 4)]

    def memory_size(self) -> int:
        return 2 + EVENT * DELAY_EVENTS


@compiled()
def start_delay(s, m, value):
    """Forget the past: the delay holds ``value`` as if it had always been commanded."""
    s[m] = 1.0  # events stored
    s[m + 1] = 0.0  # slot of the newest
    s[m + 2] = -1e30
    s[m + 3] = value
    s[m + 4] = 1.0


@compiled()
def record_delay(s, m, time, value, spacing):
    """Remember ``value`` as commanded at ``time``, if it differs from the newest event.

    Where the goal changes in every step, changes within ``spacing`` after an event become one: the last, with their
    count. Three events in a row so take longer than ``spacing``, and the ring outlasts the delay.
    """
    slot = int(s[m + 1])
    at = m + 2 + EVENT * slot
    if s[at + 1] == value:
        return
    if time - s[at] < 1e-12:  # the same evaluation again, with another goal
        s[at + 1] = value
        return
    before = m + 2 + EVENT * ((slot + DELAY_EVENTS - 1) % DELAY_EVENTS)
    if s[m] > 1.0 and time - s[before] <= spacing:
        s[at] = time
        s[at + 1] = value
        s[at + 2] += 1.0
        return
    slot = (slot + 1) % DELAY_EVENTS
    at = m + 2 + EVENT * slot
    s[at] = time
    s[at + 1] = value
    s[at + 2] = 1.0
    s[m + 1] = slot
    if s[m] < DELAY_EVENTS:
        s[m] += 1.0


@compiled()
def delayed(s, m, time):
    """The value commanded at ``time``.

    A pure function of the events, so every Runge-Kutta stage may ask for its own time. Changes that became one event
    are taken to have come evenly, in equal steps: of a ramp or a sampled curve, they did.
    """
    slot = int(s[m + 1])
    later = -1
    for _ in range(int(s[m]) - 1):
        if s[m + 2 + EVENT * slot] <= time + 1e-9:
            break
        later = slot
        slot = (slot + DELAY_EVENTS - 1) % DELAY_EVENTS
    at = m + 2 + EVENT * slot
    value = s[at + 1]
    if later < 0 or s[m + 2 + EVENT * later + 2] <= 1.0 or s[at] < -1e29:
        return value
    end = m + 2 + EVENT * later
    passed = math.floor((time + 1e-9 - s[at]) / (s[end] - s[at]) * s[end + 2])
    return value + (s[end + 1] - value) * min(max(passed, 0.0), s[end + 2]) / s[end + 2]


@register
@dataclass(frozen=True, kw_only=True)
class RateLimit(Stage):
    """The firmware lets its goal move no faster than this (goal speed profile)."""

    name: ClassVar[str] = "rate_limit"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.POSITION_GOAL,)
    opcode: ClassVar[int] = 2

    speed: float = parameter(None, "rad/s", 1e-3, 1e4, "largest speed of the goal")

    def memory_size(self) -> int:
        return 2


@compiled()
def rate_limited(p, i, s, m, time, goal):
    """Goal after the profile at ``time``; memory is [profile at the start of the step, its target]."""
    reach = p[i] * max(time - s[S_TIME], 0.0)
    return s[m] + min(max(goal - s[m], -reach), reach)


@register
@dataclass(frozen=True, kw_only=True)
class DeadBand(Stage):
    """Errors (before the controller) or duties and torques (after it) smaller than this have no effect."""

    name: ClassVar[str] = "dead_band"
    takes: ClassVar[tuple[Quantity, ...]] = SIGNALS
    opcode: ClassVar[int] = 3

    width: float = parameter(None, "rad, duty or N.m", 0.0, 10.0, "largest size ignored; larger ones pass whole")

    def law_parameters(self, chain: Any) -> list[float]:
        return [self.width, 1.0 if chain.quantity_before(self) == Quantity.POSITION_GOAL else 0.0]


@compiled()
def dead_banded(p, i, s, value):
    """``value`` unless it is within the dead band (of the encoder reading for goals, of zero otherwise)."""
    centre = s[S_READING] if p[i + 1] > 0.5 else 0.0
    return centre if abs(value - centre) < p[i] else value


@register
@dataclass(frozen=True, kw_only=True)
class Offset(Stage):
    """A constant added to what passes: a mounting error of the goal, a bias of an amplifier."""

    name: ClassVar[str] = "offset"
    takes: ClassVar[tuple[Quantity, ...]] = SIGNALS
    opcode: ClassVar[int] = 4

    value: float = parameter(None, "rad, duty or N.m", -10.0, 10.0, "added to the signal")


@register
@dataclass(frozen=True, kw_only=True)
class Scale(Stage):
    """A factor on what passes, such as a degree taken for a radian."""

    name: ClassVar[str] = "scale"
    takes: ClassVar[tuple[Quantity, ...]] = SIGNALS
    opcode: ClassVar[int] = 5

    factor: float = parameter(None, "-", -1e4, 1e4, "multiplies the signal")
