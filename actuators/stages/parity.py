"""What becomes of a stage's number where the joint's angle is counted the other way round, or from another zero.

A log may count an angle otherwise than the robot's model does: ``model = sign (log - zero)``. A chain that was found in
the one frame then has other numbers in the other. Each parameter of a stage states its own (``parameter(...,
parity=)``), so that nothing else has to know the stage; :func:`sealegs.actuators.turning.apart` tries whether what a
chain's parameters state is true of its laws.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

Fields = Mapping[str, Mapping[str, Any]]
"""Metadata of a stage's fields by their names."""


@dataclass(frozen=True)
class Frame:
    """How two ways to count a joint's angle stand to each other: ``new = sign (old - zero)``.

    Attributes:
        zero: the old angle where the new one is 0 [rad or m].
        sign: 1, or -1 where the other direction counts as positive.
        of_goals: whether what passes the stage is an angle, which the zero moves.
        ratio: motor turns per joint turn.
    """

    zero: float
    sign: float
    of_goals: bool = False
    ratio: float = 1.0


class Parity:
    """How a parameter follows a turn of its joint's frame. This one does not: a size, a time, a limit of both sides."""

    def turned(self, values: Mapping[str, Any], key: str, frame: Frame) -> Any:
        """The number ``key`` of a stage's ``values`` in the new frame."""
        del frame
        return values[key]

    def fault(self, fields: Fields, key: str) -> str | None:
        """Why the parameter ``key`` cannot have this parity, in words; None: it can."""
        del fields, key
        return None


class _Odd(Parity):
    def turned(self, values: Mapping[str, Any], key: str, frame: Frame) -> Any:
        return frame.sign * values[key]

    def fault(self, fields: Fields, key: str) -> str | None:
        low, high = fields[key]["low"], fields[key]["high"]
        fault = f"changes sign, so its bounds must be equal up to that, not {low:g} and {high:g}"
        return None if low == -high else fault


@dataclass(frozen=True)
class Swapped(Parity):
    """The number of one direction; turned, it is that of the other, the parameter ``other``."""

    other: str

    def turned(self, values: Mapping[str, Any], key: str, frame: Frame) -> Any:
        return values[self.other if frame.sign < 0.0 else key]

    def fault(self, fields: Fields, key: str) -> str | None:
        if fields.get(self.other, {}).get("parity") != Swapped(key):
            return f"swaps with '{self.other}', which must swap with it"
        own, its = ([fields[name][end] for end in ("low", "high")] for name in (key, self.other))
        return None if own == its else f"swaps with '{self.other}', which has other bounds"


@dataclass(frozen=True)
class Phase(Parity):
    """The phase of something periodic [rad], beside ``count`` times the angle.

    Attributes:
        count: the parameter with the periods per turn.
        kept: whether at phase zero the term is the same in both directions: a cosine in a limit, a sine in a torque.
            Otherwise it changes sign: a sine in a limit, a cosine in a torque.
        of_motor: whether the angle is the motor's, in front of a ``gear``.
    """

    count: str
    kept: bool = True
    of_motor: bool = False

    def turned(self, values: Mapping[str, Any], key: str, frame: Frame) -> Any:
        phase = values[key] + values[self.count] * (frame.ratio if self.of_motor else 1.0) * frame.zero
        if frame.sign < 0.0:
            phase = -phase if self.kept else math.pi - phase
        return math.remainder(phase, 2.0 * math.pi)

    def fault(self, fields: Fields, key: str) -> str | None:
        if "unit" not in fields.get(self.count, {}):
            return f"is the phase of '{self.count}', which is no parameter of the stage"
        whole = fields[key]["low"] <= -math.pi and fields[key]["high"] >= math.pi
        return None if whole else "is a phase, so its bounds must hold all from -pi to pi"


class _Angle(Parity):
    def turned(self, values: Mapping[str, Any], key: str, frame: Frame) -> Any:
        return frame.sign * (values[key] - frame.zero if frame.of_goals else values[key])

    def fault(self, fields: Fields, key: str) -> str | None:
        return ODD.fault(fields, key)


@dataclass(frozen=True)
class Reading(Parity):
    """The offset of a reading ``scale`` angle + offset, whose scale is the parameter ``scale``."""

    scale: str

    def turned(self, values: Mapping[str, Any], key: str, frame: Frame) -> Any:
        return frame.sign * (values[key] + (values[self.scale] - 1.0) * frame.zero)


EVEN: Parity = Parity()
"""Unchanged."""
ODD: Parity = _Odd()
"""Changes sign with the direction: a bias, what one direction has more than the other."""
ANGLE: Parity = _Angle()
"""An angle where goals pass, which moves with the zero as well; odd where a duty or a torque passes."""
