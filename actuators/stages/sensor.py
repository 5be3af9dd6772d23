"""Encoder: what firmware and host see of the position."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from ..compiled import compiled
from ..layout import LATENCY_SAMPLES, P_LATENCY, P_LATENCY_MEMORY, P_OFFSET, P_SCALE, P_TICKS
from .base import Quantity, Stage, parameter, register
from .parity import EVEN, Reading


@register
@dataclass(frozen=True, kw_only=True)
class Encoder(Stage):
    """Position sensor of the servo.

    Ticks, offset and scale are in what the servo's own controller reads too; latency is the age of a reading when the
    host gets it.
    """

    name: ClassVar[str] = "encoder"
    after: ClassVar[str] = "backlash"
    at_end: ClassVar[bool] = True
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.TORQUE,)

    ticks: float = parameter(0.0, "1/turn", 0.0, 1e9, "steps per turn, 0: continuous", parity=EVEN)
    offset: float = parameter(0.0, "rad", -10.0, 10.0, "reading at position zero", parity=Reading("scale"))
    scale: float = parameter(1.0, "-", 0.01, 100.0, "reading per position", parity=EVEN)
    latency: float = parameter(0.0, "s", 0.0, 0.5, "age of the reading when the host receives it", parity=EVEN)

    def header(self, memory: int) -> dict[int, float]:
        return {
            P_TICKS: self.ticks,
            P_OFFSET: self.offset,
            P_SCALE: self.scale,
            P_LATENCY: self.latency,
            P_LATENCY_MEMORY: memory,
        }

    def memory_size(self) -> int:
        return 1 + 2 * LATENCY_SAMPLES if self.latency > 0.0 else 0


@compiled()
def encoder_reading(p, q):
    """Reading of the encoder at position ``q`` [rad]."""
    reading = p[P_SCALE] * q + p[P_OFFSET]
    if p[P_TICKS] > 0.0:
        step = 2.0 * math.pi / p[P_TICKS]
        reading = math.floor(reading / step + 0.5) * step
    return reading


@compiled()
def start_latency(p, s, q):
    """Forget the past: the joint has always stood at ``q``."""
    m = int(p[P_LATENCY_MEMORY])
    s[m] = 0.0
    for k in range(LATENCY_SAMPLES):
        s[m + 1 + 2 * k] = -1e30
        s[m + 2 + 2 * k] = q


@compiled()
def record_latency(p, s, time, q):
    """Remember the position at ``time``, often enough to interpolate over the latency."""
    m = int(p[P_LATENCY_MEMORY])
    slot = int(s[m])
    if time - s[m + 1 + 2 * slot] < p[P_LATENCY] / (LATENCY_SAMPLES - 4):
        return
    slot = (slot + 1) % LATENCY_SAMPLES
    s[m + 1 + 2 * slot] = time
    s[m + 2 + 2 * slot] = q
    s[m] = slot


@compiled()
def late_position(p, s, time, q):
    """Position as it was one latency before ``time``, where it is ``q``."""
    m = int(p[P_LATENCY_MEMORY])
    slot = int(s[m])
    wanted = time - p[P_LATENCY]
    later_time, later = time, q
    for _ in range(LATENCY_SAMPLES):
        at, value = s[m + 1 + 2 * slot], s[m + 2 + 2 * slot]
        if at <= wanted:
            if later_time - at < 1e-12 or at < -1e29:
                return value
            return value + (later - value) * (wanted - at) / (later_time - at)
        later_time, later = at, value
        slot = (slot + LATENCY_SAMPLES - 1) % LATENCY_SAMPLES
    return later


@compiled(allocates=True)
def late_positions(programs, states, time, positions):
    """:func:`late_position` for a batch: arrays (n, length), (n, state size), (n,), (n,)."""
    late = positions.copy()
    for k in range(len(positions)):
        if programs[k, P_LATENCY] > 0.0:
            late[k] = late_position(programs[k], states[k], time[k], positions[k])
    return late
