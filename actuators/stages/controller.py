"""Controllers: from position goal and encoder reading to a duty (servo firmware) or directly to a torque (ideal)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from ..compiled import compiled
from ..layout import S_DUTY, S_GOAL, S_READING, S_SPEED, S_TIME
from .base import ChainError, Law, Quantity, Stage, parameter, register
from .parity import EVEN

UNLIMITED = 1e6  # [N.m] a limit that is none


class PositionController(Stage):
    """What position_p, position_pd and position_pi share: one law with gains that may be zero."""

    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.POSITION_GOAL,)
    gives: ClassVar[Quantity | None] = Quantity.DUTY

    @classmethod
    def record_names(cls) -> tuple[str, ...]:
        return ("gain", "damping", "integral", "integral_limit", "period", "band")

    def law_values(self, chain: Any) -> dict[str, float]:
        del chain
        return {name: self.parameters().get(name, 0.0) for name in self.record_names()}

    def memory_size(self) -> int:
        return 6 if self.parameters().get("period") else 2


@register
@dataclass(frozen=True, kw_only=True)
class PositionP(PositionController):
    """duty = gain (goal - reading)."""

    name: ClassVar[str] = "position_p"
    after: ClassVar[str] = "dead_band"

    gain: float = parameter(None, "1/rad", 0.0, 1e4, "duty per radian of position error", parity=EVEN)


@register
@dataclass(frozen=True, kw_only=True)
class PositionPD(PositionController):
    """duty = gain (goal - reading) - damping speed."""

    name: ClassVar[str] = "position_pd"
    after: ClassVar[str] = "position_p"

    gain: float = parameter(None, "1/rad", 0.0, 1e4, "duty per radian of position error", parity=EVEN)
    damping: float = parameter(0.0, "s/rad", 0.0, 1e3, "duty per rad/s of speed", parity=EVEN)


@register
@dataclass(frozen=True, kw_only=True)
class PositionPI(PositionController):
    """duty = gain (goal - reading) + integral of it, held within a limit (anti-windup).

    With a ``period`` it is a digital controller: it computes once a period and holds its duty between (paper 001,
    equations (24) and (25)). With a ``band``, an error within it counts as none and lets the integral run out in its
    own time constant ``gain / integral``. So a joint that sticks near its goal draws no current and does not hunt.
    """

    name: ClassVar[str] = "position_pi"
    after: ClassVar[str] = "position_pd"

    gain: float = parameter(None, "1/rad", 0.0, 1e4, "duty per radian of position error", parity=EVEN)
    integral: float = parameter(None, "1/(rad.s)", 0.0, 1e6, "duty per radian second", parity=EVEN)
    integral_limit: float = parameter(1.0, "-", 0.0, 1.0, "largest duty of the integral part", parity=EVEN)
    damping: float = parameter(0.0, "s/rad", 0.0, 1e3, "duty per rad/s of speed", parity=EVEN)
    period: float = parameter(0.0, "s", 0.0, 1.0, "of a digital controller; 0: continuous", parity=EVEN)
    band: float = parameter(0.0, "rad", 0.0, 1.0, "error that counts as none, of a digital controller", parity=EVEN)

    def check(self, chain: Any) -> None:
        if self.band > 0.0 and self.period == 0.0:
            raise ChainError(
                f"{chain.label}: 'position_pi' has a band, which takes a digital controller; add its period."
            )


CONTROLLER = PositionController.offsets()


@compiled()
def advance_integral(p, i, s, m, time):
    """Add the error of the step that has passed; memory is [integral duty, error at the step's start]."""
    if p[i + CONTROLLER.period] == 0.0:
        limit = p[i + CONTROLLER.integral_limit]
        change = p[i + CONTROLLER.integral] * s[m + 1] * (time - s[S_TIME])
        s[m] = min(max(s[m] + change, -limit), limit)


@compiled()
def position_duty(p, i, s, m, goal):
    """Duty of a position controller."""
    s[S_GOAL] = goal
    return p[i + CONTROLLER.gain] * (goal - s[S_READING]) - p[i + CONTROLLER.damping] * s[S_SPEED] + s[m]


@compiled()
def sampled_duty(p, i, s, m, time, goal, first):
    """Duty of a digital controller, computed once a period and held between.

    Memory: integral duty, -, its value before the latest sample, time of that sample, duty held, 1 once it has sampled.
    """
    s[S_GOAL] = goal
    if first:
        period, limit = p[i + CONTROLLER.period], p[i + CONTROLLER.integral_limit]
        due = s[m + 5] == 0.0 or time >= s[m + 3] + period - 1e-9
        if due:
            s[m + 2], s[m + 3], s[m + 5] = s[m], time, 1.0
        if due or time == s[m + 3]:  # again where an evaluation is repeated, whose goal may be another
            gain, rate = p[i + CONTROLLER.gain], p[i + CONTROLLER.integral]
            error, integral = goal - s[S_READING], s[m + 2]
            if abs(error) < p[i + CONTROLLER.band]:
                error = 0.0
                integral *= max(1.0 - period * rate / gain, 0.0) if gain > 0.0 else 0.0
            s[m] = min(max(integral + rate * error * period, -limit), limit)
            s[m + 4] = gain * error - p[i + CONTROLLER.damping] * s[S_SPEED] + s[m]
    return s[m + 4]


@compiled()
def controlled_duty(p, i, s, m, time, value, first):
    """Duty of a position controller, continuous or digital."""
    if p[i + CONTROLLER.period] > 0.0:
        duty = sampled_duty(p, i, s, m, time, value, first)
    else:
        duty = position_duty(p, i, s, m, value)
        if first:
            s[m + 1] = value - s[S_READING]
    s[S_DUTY] = duty
    return duty


PositionController.law = Law(advance=advance_integral, act=controlled_duty)


@register
@dataclass(frozen=True, kw_only=True)
class Ideal(Stage):
    """A perfect servo: torque = stiffness (goal - position) - damping speed, within a limit.

    This is what most simulations assume. With a ``feedforward`` of 1 it is an impedance drive (MIT mode): torque =
    stiffness (goal - position) + damping (goal velocity - speed) + commanded torque, where the log has the columns
    ``goal_velocity`` and ``torque_command`` beside the goal; without them both are zero.
    """

    name: ClassVar[str] = "ideal"
    after: ClassVar[str] = "position_pi"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.POSITION_GOAL,)
    gives: ClassVar[Quantity | None] = Quantity.TORQUE

    stiffness: float = parameter(None, "N.m/rad", 0.0, 1e6, "torque per radian of position error", parity=EVEN)
    damping: float = parameter(0.0, "N.m.s/rad", 0.0, 1e5, "torque per rad/s of speed", parity=EVEN)
    torque_limit: float = parameter(UNLIMITED, "N.m", 0.0, UNLIMITED, "largest torque", parity=EVEN)
    armature: float = parameter(0.0, "kg.m2", 0.0, 1e3, "rotor inertia at the joint", parity=EVEN, in_law=False)
    strength: float = parameter(1.0, "-", 0.0, 10.0, "torque that it gives per torque that it computes", parity=EVEN)
    feedforward: float = parameter(
        0.0,
        "-",
        0.0,
        1.0,
        "share of a log's goal velocity and torque command that acts beside the goal",
        parity=EVEN,
        in_law=False,
    )

    def check(self, chain: Any) -> None:
        if self.feedforward == 0.0:
            return
        if self.stiffness == 0.0:
            raise ChainError(
                f"{chain.label}: 'ideal' has a feedforward and no stiffness, so no goal asks for its torque; compute "
                "the torque, log it as torque_command, and take a chain with torque_command."
            )
        before = [stage.name for stage in chain.stages[: chain.stages.index(self)]]
        if shaping := [name for name in before if name not in ("delay", "offset")]:
            raise ChainError(
                f"{chain.label}: '{shaping[0]}' before an 'ideal' with a feedforward would change the torque that is "
                "commanded beside the goal; remove it, or the feedforward."
            )


IDEAL = Ideal.offsets()


@compiled()
def ideal_torque(p, i, s, value):
    """Torque of an ideal servo for the goal ``value``."""
    s[S_GOAL] = value
    torque = p[i + IDEAL.stiffness] * (value - s[S_READING]) - p[i + IDEAL.damping] * s[S_SPEED]
    return p[i + IDEAL.strength] * min(max(torque, -p[i + IDEAL.torque_limit]), p[i + IDEAL.torque_limit])


Ideal.law = Law(act=ideal_torque)


@register
@dataclass(frozen=True, kw_only=True)
class TorqueCommand(Stage):
    """The host closes the loop itself: its command is a torque [N.m] and passes as it is.

    Behind it come the amplifier's faults (``offset`` for a bias, ``scale`` for a wrong motor constant).
    """

    name: ClassVar[str] = "torque_command"
    after: ClassVar[str] = "ideal"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.POSITION_GOAL,)
    gives: ClassVar[Quantity | None] = Quantity.TORQUE
    command: ClassVar[str] = "torque_command"

    armature: float = parameter(0.0, "kg.m2", 0.0, 1e3, "rotor inertia at the joint", parity=EVEN, in_law=False)


@register
@dataclass(frozen=True, kw_only=True)
class Derivative(Stage):
    """The firmware's D term: more duty the faster the error of the position grows.

    The goal is the one that the controller sees, behind a profile or a filter. Feetech's servos keep it in the register
    ``D``, 32 at the factory beside a ``P`` of 32.
    """

    name: ClassVar[str] = "derivative"
    after: ClassVar[str] = "torque_command"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.DUTY,)

    gain: float = parameter(
        None, "s/rad", 0.0, 1e3, "duty per rad/s by which the error grows", parity=EVEN, neutral=0.0
    )
    filter: float = parameter(1e-3, "s", 1e-4, 0.1, "time constant of the goal's derivative; assumed", parity=EVEN)

    def memory_size(self) -> int:
        return 2


DERIVATIVE = Derivative.offsets()


@compiled()
def advance_derivative(p, i, s, m, time):
    """Follow the goal; memory is [1 once there was one, the goal behind the filter]."""
    if s[m] > 0.0:
        left = math.exp(-max(time - s[S_TIME], 0.0) / p[i + DERIVATIVE.filter])
        s[m + 1] = s[S_GOAL] + left * (s[m + 1] - s[S_GOAL])


@compiled()
def derivative_duty(p, i, s, m, time, value, first):
    """The duty with the D term."""
    if s[m] == 0.0:
        s[m], s[m + 1] = 1.0, s[S_GOAL]
    left = math.exp(-max(time - s[S_TIME], 0.0) / p[i + DERIVATIVE.filter])
    growth = left * (s[S_GOAL] - s[m + 1]) / p[i + DERIVATIVE.filter] - s[S_SPEED]
    duty = value + p[i + DERIVATIVE.gain] * growth
    s[S_DUTY] = duty
    return duty


Derivative.law = Law(advance=advance_derivative, act=derivative_duty)
