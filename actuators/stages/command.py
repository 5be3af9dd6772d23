"""Stages on the way of a command to the controller: delay, gain, offset, filter, rate limit, dead band."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from ..compiled import compiled
from ..layout import DELAY_EVENTS, S_READING, S_TIME
from .base import ChainError, Law, Quantity, Stage, parameter, register
from .parity import ANGLE, EVEN, ODD

EVENT = 3  # doubles of a remembered command: when it came, its value, changes since the event before it
GOALS = (Quantity.POSITION_GOAL, Quantity.SPEED_GOAL)
SIGNALS = (*GOALS, Quantity.DUTY, Quantity.TORQUE)


@register
@dataclass(frozen=True, kw_only=True)
class Delay(Stage):
    """The command reaches the controller late, by any time, not only whole simulation steps."""

    name: ClassVar[str] = "delay"
    after: ClassVar[str] = ""
    derived: ClassVar[tuple[str, ...]] = ("spacing",)  # of remembered commands [s]
    takes: ClassVar[tuple[Quantity, ...]] = GOALS

    seconds: float = parameter(
        None, "s", 0.0, 10.0, "time from sending a command to its effect", parity=EVEN, neutral=0.0
    )

    def law_values(self, chain: Any) -> dict[str, float]:
        return {**super().law_values(chain), "spacing": 2.0 * self.seconds / (DELAY_EVENTS - 4)}

    def memory_size(self) -> int:
        return 2 + EVENT * DELAY_EVENTS


DELAY = Delay.offsets()


@compiled()
def start_delay(s, m, goal):
    """Forget the past: the delay holds ``goal`` as if it had always been commanded."""
    s[m] = 1.0  # events stored
    s[m + 1] = 0.0  # slot of the newest
    s[m + 2] = -1e30
    s[m + 3] = goal
    s[m + 4] = 1.0
    return goal


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


@compiled()
def late_command(p, i, s, m, time, value, first):
    """The command of one delay ago."""
    if first:
        record_delay(s, m, time, value, p[i + DELAY.spacing])
    return delayed(s, m, time - p[i + DELAY.seconds])


Delay.law = Law(start=start_delay, act=late_command)


@register
@dataclass(frozen=True, kw_only=True)
class GoalFilter(Stage):
    """Firmware or host smooths the goal with a low-pass filter of first order.

    A host that computes it once per period and holds the result is, on average, half a period ahead of the filter that
    a servo computes all the time.
    """

    name: ClassVar[str] = "goal_filter"
    after: ClassVar[str] = "offset"
    switches: ClassVar[bool] = True  # a jump that it smooths drives the duty into its limit in the midst of a step
    derived: ClassVar[tuple[str, ...]] = ("kept",)  # of a jump of the goal, before the filter decays
    takes: ClassVar[tuple[Quantity, ...]] = GOALS

    time_constant: float = parameter(
        None, "s", 0.0, 10.0, "time in which it covers 63 % of a step", parity=EVEN, neutral=0.0
    )
    period: float = parameter(0.0, "s", 0.0, 1.0, "of the loop that computes it; 0: all the time", parity=EVEN)

    def law_values(self, chain: Any) -> dict[str, float]:
        ahead = 0.5 * self.period / max(self.time_constant, 1e-9)
        return {**super().law_values(chain), "kept": math.exp(-ahead)}

    def memory_size(self) -> int:
        return 2


GOAL_FILTER = GoalFilter.offsets()


@compiled()
def start_goal_filter(s, m, goal):
    """Forget the past: the filter has settled at ``goal``; memory is [goal of the step, what is still to go of it]."""
    s[m] = goal
    s[m + 1] = 0.0
    return goal


@compiled()
def smoothed(p, i, s, m, time, goal):
    """Output of the filter at ``time``."""
    if p[i + GOAL_FILTER.time_constant] <= 0.0:
        return goal
    left = math.exp(-max(time - s[S_TIME], 0.0) / p[i + GOAL_FILTER.time_constant])
    return goal - left * s[m + 1] - p[i + GOAL_FILTER.kept] * (goal - s[m])  # a goal that came since: just now


@compiled()
def advance_goal_filter(p, i, s, m, time):
    """Carry the filter to the end of the step that has passed."""
    if p[i + GOAL_FILTER.time_constant] > 0.0:
        s[m + 1] *= math.exp(-max(time - s[S_TIME], 0.0) / p[i + GOAL_FILTER.time_constant])


@compiled()
def filtered_goal(p, i, s, m, time, value, first):
    """The goal as the filter lets it through."""
    if first:
        s[m + 1] += p[i + GOAL_FILTER.kept] * (value - s[m])
        s[m] = value
    return smoothed(p, i, s, m, time, value)


GoalFilter.law = Law(start=start_goal_filter, advance=advance_goal_filter, act=filtered_goal)


BOUNDLESS = 1e6  # [rad/s2] an acceleration that limits nothing


@register
@dataclass(frozen=True, kw_only=True)
class RateLimit(Stage):
    """The firmware moves its goal at a limited speed and acceleration (goal profile), so that it comes to rest there.

    Feetech's servos keep the acceleration in the register ``acceleration``, in 100 steps/s2: 254, which LeRobot sets,
    is 39 rad/s2.
    """

    name: ClassVar[str] = "rate_limit"
    after: ClassVar[str] = "goal_filter"
    switches: ClassVar[bool] = True
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.POSITION_GOAL,)

    speed: float = parameter(100.0, "rad/s", 1e-3, 1e4, "largest speed of the goal", parity=EVEN)
    acceleration: float = parameter(
        BOUNDLESS, "rad/s2", 1e-3, BOUNDLESS, "largest acceleration of the goal", parity=EVEN
    )

    def memory_size(self) -> int:
        return 3


RATE_LIMIT = RateLimit.offsets()


@compiled()
def start_profile(s, m, goal):
    """Forget the past: the profile stands at ``goal``."""
    s[m] = goal
    s[m + 1] = goal
    s[m + 2] = 0.0
    return goal


@compiled()
def profile_move(way, speed, fastest, acceleration, dt):
    """Way and speed of a profile after ``dt``, in the shortest time to rest at a goal ``way`` off: push, cruise, brake.

    Exact for any length of the step, so that what a fit sees does not change with it.
    """
    side = 1.0 if way - 0.5 * speed * abs(speed) / acceleration >= 0.0 else -1.0
    way, speed = side * way, side * speed  # now the push is upwards
    peak = max(min(math.sqrt(max(acceleration * way + 0.5 * speed * speed, 0.0)), fastest), speed)
    push = (peak - speed) / acceleration
    if dt < push:
        return side * (speed + 0.5 * acceleration * dt) * dt, side * (speed + acceleration * dt)
    moved, brake = 0.5 * (speed + peak) * push, peak / acceleration
    cruise = max(way - moved - 0.5 * peak * brake, 0.0) / peak if peak > 0.0 else 0.0
    if dt < push + cruise:
        return side * (moved + peak * (dt - push)), side * peak
    braked = dt - push - cruise
    if braked < brake:
        moved += peak * cruise + (peak - 0.5 * acceleration * braked) * braked
        return side * moved, side * (peak - acceleration * braked)
    return side * way, 0.0


@compiled()
def profile(p, i, s, m, time, goal):
    """Goal after the profile at ``time``; memory is [profile at the start of the step, its target, its speed]."""
    dt, way = max(time - s[S_TIME], 0.0), goal - s[m]
    if p[i + RATE_LIMIT.acceleration] >= BOUNDLESS:
        reach = p[i + RATE_LIMIT.speed] * dt
        return s[m] + min(max(way, -reach), reach)
    return s[m] + profile_move(way, s[m + 2], p[i + RATE_LIMIT.speed], p[i + RATE_LIMIT.acceleration], dt)[0]


@compiled()
def advance_profile(p, i, s, m, time):
    """Carry the profile to the end of the step that has passed."""
    if p[i + RATE_LIMIT.acceleration] >= BOUNDLESS:
        s[m] = profile(p, i, s, m, time, s[m + 1])
        return
    dt = max(time - s[S_TIME], 0.0)
    moved, s[m + 2] = profile_move(
        s[m + 1] - s[m], s[m + 2], p[i + RATE_LIMIT.speed], p[i + RATE_LIMIT.acceleration], dt
    )
    s[m] += moved


@compiled()
def rate_limited(p, i, s, m, time, value, first):
    """The goal as the profile lets it through."""
    if first:
        s[m + 1] = value
    return profile(p, i, s, m, time, value)


RateLimit.law = Law(start=start_profile, advance=advance_profile, act=rate_limited)


@register
@dataclass(frozen=True, kw_only=True)
class DeadBand(Stage):
    """Errors (before the controller) or duties and torques (after it) smaller than this have no effect."""

    name: ClassVar[str] = "dead_band"
    after: ClassVar[str] = "rate_limit"
    repeats: ClassVar[bool] = True
    switches: ClassVar[bool] = True
    derived: ClassVar[tuple[str, ...]] = ("of_goal",)  # 1: of the error of a goal, 0: of what passes
    takes: ClassVar[tuple[Quantity, ...]] = SIGNALS

    width: float = parameter(
        None,
        "rad, rad/s, duty or N.m",
        0.0,
        10.0,
        "largest size ignored; larger ones pass whole",
        parity=EVEN,
        neutral=0.0,
    )

    def law_values(self, chain: Any) -> dict[str, float]:
        of_goal = chain.quantity_before(self) == Quantity.POSITION_GOAL
        return {**super().law_values(chain), "of_goal": 1.0 if of_goal else 0.0}


DEAD_BAND = DeadBand.offsets()


@compiled()
def dead_banded(p, i, s, value):
    """``value`` unless it is within the dead band (of the encoder reading for goals, of zero otherwise)."""
    centre = s[S_READING] if p[i + DEAD_BAND.of_goal] > 0.5 else 0.0
    return centre if abs(value - centre) < p[i + DEAD_BAND.width] else value


DeadBand.law = Law(act=dead_banded)


@register
@dataclass(frozen=True, kw_only=True)
class Offset(Stage):
    """A constant added to what passes: a mounting error of the goal, a bias of an amplifier."""

    name: ClassVar[str] = "offset"
    after: ClassVar[str] = "scale"
    repeats: ClassVar[bool] = True
    takes: ClassVar[tuple[Quantity, ...]] = SIGNALS

    value: float = parameter(None, "rad, rad/s, duty or N.m", -1e4, 1e4, "added to the signal", parity=ODD, neutral=0.0)


OFFSET = Offset.offsets()


@compiled()
def shifted_goal(p, i, goal):
    """A goal with the offset."""
    return goal + p[i + OFFSET.value]


@compiled()
def shifted(p, i, value):
    """``value`` with the offset."""
    return value + p[i + OFFSET.value]


Offset.law = Law(start=shifted_goal, act=shifted)


@register
@dataclass(frozen=True, kw_only=True)
class Scale(Stage):
    """A factor on what passes, such as a degree taken for a radian."""

    name: ClassVar[str] = "scale"
    after: ClassVar[str] = "delay"
    repeats: ClassVar[bool] = True
    takes: ClassVar[tuple[Quantity, ...]] = SIGNALS

    factor: float = parameter(None, "-", -1e4, 1e4, "multiplies the signal", parity=EVEN, neutral=1.0)
    centre: float = parameter(0.0, "rad", -1e4, 1e4, "goal that it leaves as it is", parity=ANGLE)

    def check(self, chain: Any) -> None:
        if self.centre != 0.0 and chain.quantity_before(self) != Quantity.POSITION_GOAL:
            raise ChainError(f"{chain.label}: a 'scale' with a centre is one of goals; put it before the controller.")


SCALE = Scale.offsets()


@compiled()
def scaled(p, i, value):
    """``value`` times the factor, from the centre."""
    return p[i + SCALE.centre] + p[i + SCALE.factor] * (value - p[i + SCALE.centre])


@compiled()
def scaled_goal(p, i, goal):
    """A goal times the factor, from the centre."""
    return scaled(p, i, goal)


Scale.law = Law(start=scaled_goal, act=scaled)
