"""Controllers: from position goal and encoder reading to a duty (servo firmware) or directly to a torque (ideal)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ..compiled import compiled
from ..layout import S_GOAL, S_READING, S_SPEED, S_TIME
from .base import ChainError, Quantity, Stage, parameter, register


class PositionController(Stage):
    """What position_p, position_pd and position_pi share: one law with gains that may be zero."""

    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.POSITION_GOAL,)
    gives: ClassVar[Quantity | None] = Quantity.DUTY
    opcode: ClassVar[int] = 10

    def law_parameters(self, chain: Any) -> list[float]:
        del chain
        values = self.parameters()
        return [values.get(key, 0.0) for key in ("gain", "damping", "integral", "integral_limit", "period", "band")]

    def memory_size(self) -> int:
        return 6 if self.parameters().get("period") else 2


@register
@dataclass(frozen=True, kw_only=True)
class PositionP(PositionController):
    """duty = gain (goal - reading)."""

    name: ClassVar[str] = "position_p"

    gain: float = parameter(None, "1/rad", 0.0, 1e4, "duty per radian of position error")


@register
@dataclass(frozen=True, kw_only=True)
class PositionPD(PositionController):
    """duty = gain (goal - reading) - damping speed."""

    name: ClassVar[str] = "position_pd"

    gain: float = parameter(None, "1/rad", 0.0, 1e4, "duty per radian of position error")
    damping: float = parameter(0.0, "s/rad", 0.0, 1e3, "duty per rad/s of speed")


@register
@dataclass(frozen=True, kw_only=True)
class PositionPI(PositionController):
    """duty = gain (goal - reading) + integral of it, held within a limit (anti-windup).

    With a ``period`` it is a digital controller: it computes once a period and holds its duty between (paper 001,
    equations (24) and (25)). With a ``band``, an error within it counts as none and lets the integral run out in its
    own time constant ``gain / integral``, so that a joint which sticks near its goal draws no current and does not
    hunt.
    """

    name: ClassVar[str] = "position_pi"

    gain: float = parameter(None, "1/rad", 0.0, 1e4, "duty per radian of position error")
    integral: float = parameter(None, "1/(rad.s)", 0.0, 1e6, "duty per radian second")
    integral_limit: float = parameter(1.0, "-", 0.0, 1.0, "largest duty of the integral part")
    damping: float = parameter(0.0, "s/rad", 0.0, 1e3, "duty per rad/s of speed")
    period: float = parameter(0.0, "s", 0.0, 1.0, "of a digital controller; 0: continuous")
    band: float = parameter(0.0, "rad", 0.0, 1.0, "error that counts as none, of a digital controller")

    def law_parameters(self, chain: Any) -> list[float]:
        if self.band > 0.0 and self.period == 0.0:
            raise ChainError(
                f"{chain.label}: 'position_pi' has a band, which takes a digital controller; add its period."
            )
        return super().law_parameters(chain)


@compiled()
def advance_integral(p, i, s, m, time):
    """Add the error of the step that has passed; memory is [integral duty, error at the step's start]."""
    change = p[i + 2] * s[m + 1] * (time - s[S_TIME])
    s[m] = min(max(s[m] + change, -p[i + 3]), p[i + 3])


@compiled()
def position_duty(p, i, s, m, goal):
    """Duty of a position controller."""
    s[S_GOAL] = goal
    return p[i] * (goal - s[S_READING]) - p[i + 1] * s[S_SPEED] + s[m]


@compiled()
def sampled_duty(p, i, s, m, time, goal, first):
    """Duty of a digital controller, computed once a period and held between.

    Memory: integral duty, -, its value before the latest sample, time of that sample, duty held, 1 once it has sampled.
    """
    s[S_GOAL] = goal
    if first:
        due = s[m + 5] == 0.0 or time >= s[m + 3] + p[i + 4] - 1e-9
        if due:
            s[m + 2], s[m + 3], s[m + 5] = s[m], time, 1.0
        if due or time == s[m + 3]:  # again where an evaluation is repeated, whose goal may be another
            error, integral = goal - s[S_READING], s[m + 2]
            if abs(error) < p[i + 5]:
                error = 0.0
                integral *= max(1.0 - p[i + 4] * p[i + 2] / p[i], 0.0) if p[i] > 0.0 else 0.0
            s[m] = min(max(integral + p[i + 2] * error * p[i + 4], -p[i + 3]), p[i + 3])
            s[m + 4] = p[i] * error - p[i + 1] * s[S_SPEED] + s[m]
    return s[m + 4]


@register
@dataclass(frozen=True, kw_only=True)
class Ideal(Stage):
    """A perfect servo: torque = stiffness (goal - position) - damping speed, within a limit.

    This is what most simulations assume.
    """

    name: ClassVar[str] = "ideal"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.POSITION_GOAL,)
    gives: ClassVar[Quantity | None] = Quantity.TORQUE
    opcode: ClassVar[int] = 11

    stiffness: float = parameter(None, "N.m/rad", 0.0, 1e6, "torque per radian of position error")
    damping: float = parameter(0.0, "N.m.s/rad", 0.0, 1e5, "torque per rad/s of speed")
    torque_limit: float = parameter(1e6, "N.m", 0.0, 1e6, "largest torque")
    armature: float = parameter(0.0, "kg.m2", 0.0, 1e3, "rotor inertia at the joint")


@register
@dataclass(frozen=True, kw_only=True)
class TorqueCommand(Stage):
    """The host closes the loop itself: its command is a torque [N.m] and passes as it is.

    Behind it come the amplifier's faults (``offset`` for a bias, ``scale`` for a wrong motor constant).
    """

    name: ClassVar[str] = "torque_command"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.POSITION_GOAL,)
    gives: ClassVar[Quantity | None] = Quantity.TORQUE

    armature: float = parameter(0.0, "kg.m2", 0.0, 1e3, "rotor inertia at the joint")


@compiled()
def ideal_torque(p, i, s, goal):
    """Torque of an ideal servo."""
    s[S_GOAL] = goal
    torque = p[i] * (goal - s[S_READING]) - p[i + 1] * s[S_SPEED]
    return min(max(torque, -p[i + 2]), p[i + 2])
