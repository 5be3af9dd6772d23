"""Controllers of a speed: from a speed goal and the motor's speed to a duty (wheel mode of servos) or to a torque.

A chain with one of them is told a speed [rad/s], and its joint turns without end: a wheel, a tool, a roller.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..compiled import compiled
from ..layout import S_DUTY, S_GOAL, S_SPEED, S_TIME
from .base import Law, Quantity, Stage, parameter, register
from .controller import UNLIMITED
from .parity import EVEN


@register
@dataclass(frozen=True, kw_only=True)
class VelocityPI(Stage):
    """duty = gain (goal - speed) + integral of it, held within a limit (anti-windup).

    Feetech's servos work so in mode 1 (wheel), Dynamixels in mode 1 (velocity).
    """

    name: ClassVar[str] = "velocity_pi"
    after: ClassVar[str] = "torque_command"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.SPEED_GOAL,)
    gives: ClassVar[Quantity | None] = Quantity.DUTY
    command: ClassVar[str] = "goal_velocity"

    gain: float = parameter(None, "s/rad", 0.0, 1e4, "duty per rad/s of speed error", parity=EVEN)
    integral: float = parameter(0.0, "1/rad", 0.0, 1e6, "duty per radian that the speed error adds up to", parity=EVEN)
    integral_limit: float = parameter(1.0, "-", 0.0, 1.0, "largest duty of the integral part", parity=EVEN)

    def memory_size(self) -> int:
        return 2


VELOCITY = VelocityPI.offsets()


@compiled()
def advance_speed_integral(p, i, s, m, time):
    """Add the error of the step that has passed; memory is [integral duty, error at the step's start]."""
    limit = p[i + VELOCITY.integral_limit]
    change = p[i + VELOCITY.integral] * s[m + 1] * (time - s[S_TIME])
    s[m] = min(max(s[m] + change, -limit), limit)


@compiled()
def speed_duty(p, i, s, m, time, value, first):
    """Duty of a speed controller; within a step, the integral goes on with the error of its start."""
    s[S_GOAL] = value
    error = value - s[S_SPEED]
    if first:
        s[m + 1] = error
    limit = p[i + VELOCITY.integral_limit]
    integral = s[m] + p[i + VELOCITY.integral] * s[m + 1] * (time - s[S_TIME])
    duty = p[i + VELOCITY.gain] * error + min(max(integral, -limit), limit)
    s[S_DUTY] = duty
    return duty


VelocityPI.law = Law(advance=advance_speed_integral, act=speed_duty)


@register
@dataclass(frozen=True, kw_only=True)
class IdealVelocity(Stage):
    """A perfect speed drive: torque = damping (goal - speed), within a limit, as MuJoCo's ``velocity`` actuators."""

    name: ClassVar[str] = "ideal_velocity"
    after: ClassVar[str] = "velocity_pi"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.SPEED_GOAL,)
    gives: ClassVar[Quantity | None] = Quantity.TORQUE
    command: ClassVar[str] = "goal_velocity"

    damping: float = parameter(None, "N.m.s/rad", 0.0, 1e5, "torque per rad/s of speed error", parity=EVEN)
    torque_limit: float = parameter(UNLIMITED, "N.m", 0.0, UNLIMITED, "largest torque", parity=EVEN)
    armature: float = parameter(0.0, "kg.m2", 0.0, 1e3, "rotor inertia at the joint", parity=EVEN, in_law=False)


IDEAL_VELOCITY = IdealVelocity.offsets()


@compiled()
def ideal_speed_torque(p, i, s, value):
    """Torque of an ideal speed drive for the speed goal ``value``."""
    s[S_GOAL] = value
    torque = p[i + IDEAL_VELOCITY.damping] * (value - s[S_SPEED])
    return min(max(torque, -p[i + IDEAL_VELOCITY.torque_limit]), p[i + IDEAL_VELOCITY.torque_limit])


IdealVelocity.law = Law(act=ideal_speed_torque)
