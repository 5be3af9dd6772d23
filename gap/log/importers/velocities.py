"""From the unit that a foreign velocity is in to rad/s or m/s, by its name and by the derivative of its position."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..types import Array
from ..units import FACTOR, behind
from . import steps
from .evidence import Relation, as_derivative
from .expression import quoted, signed_reading
from .unit_words import Measure, measures, unit_of
from .units import ANGLE, ASK, CLOSE, LIKELY, POSITION, SURE, WAY, Read

TURNING, MOVING = ("rad/s", "deg/s", "rpm", "turn/s"), ("m/s", "mm/s")
"""Units that the velocity of a hinge and of a slide may be in where no name says one."""
RATE = behind(*TURNING, "mrad/s", *MOVING)
UNTIMED = (
    "in which unit is this velocity? No name says it, and while the time is in question no derivative tells it. The "
    "unit in the line is a guess: see it again once the time is known"
)
"""The question for a velocity without a unit beside no time."""
ELECTRICAL = "erpm"
"""Unit of a velocity that a pole pair and a gear belong to."""
FITS = 0.7
"""Share of a velocity that the derivative of a position explains, from which their sizes tell units."""
NEAR, ROUGH = 1.05, 1.3
"""A velocity is in the unit in which it is within the first factor of what the position does; within the second, it
may be."""
BITS = range(8, 25)
"""Powers of two that the counts of a turn may be."""
EXACT = 0.01
"""Share by which a velocity in a unit that is said may miss a power of two as the counts of a turn."""


def slope_beside(time: Array | None, position: Array, velocity: Array | None) -> Relation | None:
    """How a velocity, where there is one, goes with the derivative of a position; None where no time is known."""
    if time is None:
        return None
    return Relation(0.0, 0.0) if velocity is None else as_derivative(time, position, velocity)


def counted_by_velocity(read: Read, name: str, values: Array, said: str, slope: Relation | None) -> Read:
    """A position of which a velocity in a unit that is said tells the unit, or how many counts are a turn.

    Args:
        read: of the position.
        name: of its column.
        values: of it.
        said: unit of the velocity.
        slope: of the velocity against the derivative of the position; None where no time is known.
    """
    if slope is None:
        return read
    rate = measures(f"{said}/s" if measures(said, *POSITION) else said, "rate", "speed")
    if read.by_range and rate is not None and slope.fit > FITS and slope.scale > 0.0:
        return _told(read, name, said, rate, slope)
    if read.trust != ASK or read.unit != "tick" or rate is None or slope.fit <= FITS or slope.scale <= 0.0:
        return read
    if rate.quantity == "speed":
        return read
    exact = 2.0 * math.pi / (rate.factor * slope.scale)
    power = 2 ** round(math.log2(exact))
    if power.bit_length() - 1 not in BITS:
        return read
    known = abs(exact / power - 1.0) < EXACT
    turn = power if known else int(float(f"{exact:.3g}"))
    shown = f"by the velocity in {said} a turn is {exact:.0f} of them"
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if known and turn == steps.TURN and read.text == steps.steps_text(name):  # asked about with its answer, unit=ticks
        return replace(read, why=f"{read.why}; {shown}")
    middle = turn // 2 if low >= 0.0 and high < turn else 0
    text = f"({quoted(name)} - {middle})*2*pi/{turn}" if middle else f"{quoted(name)}*2*pi/{turn}"
    why = f"counts of an encoder, {low:.3g} to {high:.3g}; {shown}"
    if known and low < 0.0:  # which a drive counts from its own zero
        return Read(text, "tick", LIKELY, f"{why}: {turn}")
    turns = f"A turn is {turn}, {shown}" if known else f"{shown[0].upper()}{shown[1:]}"
    asked = "which count is 0 rad?" if known else "how many counts are a turn, and which one is 0 rad?"
    return Read(text, "tick", ASK, why, f"{asked} {turns}; {middle} is a guess")


def _told(read: Read, name: str, said: str, rate: Measure, slope: Relation) -> Read:
    """A position of which no unit is said, in that in which a velocity in a unit that is said is its derivative."""
    units = WAY if rate.quantity == "speed" else ANGLE
    factor = rate.factor * slope.scale
    unit = min(units, key=lambda unit: abs(math.log(factor / FACTOR[unit])))
    off = abs(math.log(factor / FACTOR[unit]))
    if off > math.log(ROUGH):
        return read
    why = f"the velocity in {said} is its derivative in {unit}"
    return Read(quoted(name) + units[unit], unit, SURE if off < math.log(NEAR) else LIKELY, why)


def with_sign(read: Read, name: str, values: Array) -> Read:
    """The question of a velocity, with how its register keeps its sign where the counts tell."""
    if read.trust != ASK or not (signed := signed_reading(name, values)):
        return read
    ask = f"{read.ask or read.why}. With its sign it is {signed}: write that, and the unit of a count behind it"
    return replace(read, ask=ask)


def _electrical(column: str, slope: Relation, position: Read, shown: str) -> Read:
    """A velocity in electrical rounds a minute, which only the pole pairs and the gear make one of the joint."""
    known = measures(position.unit, "angle")
    ask = "how many pole pairs times gear ratio make these electrical rpm those of the joint?"
    if known is None or position.trust == ASK or not shown:
        text = f"{column}*2*pi/60"
        return Read(text, ELECTRICAL, ASK, "electrical rpm", f"{ask} Divide by that number: {text}/<number>")
    number = slope.scale / known.factor * FACTOR["rpm"]
    whole = round(number)
    told = f"{whole if abs(number - whole) < EXACT * number else number:.4g}"
    return Read(f"{column}*2*pi/60/{told}", ELECTRICAL, ASK, f"electrical rpm; {shown}", f"{ask} The data say {told}")


def read_velocity(name: str, said: str, how: str, slope: Relation | None, position: Read) -> Read:
    """A velocity, by its name and by how it goes with the derivative of the position [as logged].

    Args:
        name: of the column.
        said: unit by its name or its format.
        how: who says so.
        slope: of the column against that derivative; None where no time is known.
        position: how its position is read.
    """
    column = quoted(name)
    if position.unit == steps.PERCENT and not said:
        ask = (
            f"in which unit is {column}? Its position is in percent: write it in rad/s (slide: m/s), or remove the line"
        )
        return Read(column, "?", ASK, "no unit is said, and the position is in percent", ask)
    if not said and (measures(whole := unit_of(name), "rate", "speed") or whole == ELECTRICAL):
        said, how = whole, "the name"
    if measures(said, *POSITION):
        said += "/s"
    rate = measures(said, "rate", "speed")
    if slope is None:
        unit = _own_rate(position)
        if not said:
            return Read(column + RATE[unit], unit, ASK, f"no unit is said; taken for {unit}", UNTIMED)
        slope = Relation(0.0, 0.0)
    shown = ""
    if slope.fit > FITS and slope.scale > 0.0 and position.unit != steps.PERCENT:
        base = measures(position.unit, *POSITION)
        step = steps.step_size(position.text) if position.unit == "tick" else 1.0
        per = slope.scale / (base.factor if base else step)
        shown = f"it is {slope.scale:.3g} times the derivative of the position as logged"
        rates = _rates(position)
        unit = min(rates, key=lambda unit: abs(math.log(per * FACTOR[unit])))
        if said == ELECTRICAL:
            return _electrical(column, slope, position, shown)
        if rate and abs(math.log(per * rate.factor)) > min(math.log(CLOSE), abs(math.log(per * FACTOR[unit])) + 0.01):
            return Read(column + rate.behind, said, ASK, f"{how} says {said}, but {shown}, as {unit} would be")
        if position.unit == "tick" and not said:
            if position.trust == SURE and abs(math.log(slope.scale)) < math.log(NEAR):
                behind_steps = f"*2*pi/{2.0 * math.pi / step:.0f}"
                return Read(column + behind_steps, "tick/s", LIKELY, f"{shown}: steps a second")
            ask = position.ask or f"how many rad/s is a count of {column}? {shown}"
            return Read(f"{column}*{step / slope.scale:.4g}", "counts", ASK, f"{shown}, in rad/s", ask)
        if position.trust == ASK and not said:
            own = measures(f"{position.unit}/s", "rate", "speed")
            return Read(
                column + (own.behind if own else RATE[unit]), unit, ASK, "its unit hangs on that of the position",
                position.ask,
            )  # fmt: skip
        if rate and abs(math.log(per * rate.factor)) < math.log(ROUGH):
            return Read(column + rate.behind, said, SURE, f"{how} says {said}; {shown}")
        ratio = per * FACTOR[unit]
        if not rate and abs(math.log(ratio)) < math.log(NEAR):
            return Read(column + RATE[unit], unit, position.trust, f"{shown}: {unit}")
        if not said and abs(math.log(ratio)) < math.log(ROUGH):
            ask = (
                f"is {column} in {unit}? No unit is said, and in {unit} it is {ratio:.3g} times what the position does"
            )
            return Read(column + RATE[unit], unit, ASK, shown, ask)
    elif slope.fit > FITS:
        shown = "it goes against the derivative of the position"
    if said == ELECTRICAL:
        return _electrical(column, slope, position, "")
    if rate:
        trust, shown = (LIKELY, f"; {shown}") if shown else (SURE, "")
        return Read(column + rate.behind, said, trust, f"{how} says {said}{shown}")
    no_unit = f"{how} says {said}, which is no unit of a velocity" if said else "no unit is said"
    return Read(column, "?", ASK, f"{no_unit}, and {shown or 'it does not go with the derivative of the position'}")


def _rates(position: Read) -> tuple[str, ...]:
    """Units that the velocity beside a position may be in: the usual ones, and that of the position a second."""
    own = f"{position.unit}/s"
    return tuple(dict.fromkeys([*(MOVING if measures(position.unit, "way") else TURNING), *[own] * (own in RATE)]))


def _own_rate(position: Read) -> str:
    """The unit of a velocity that a position in its unit would have."""
    rates = _rates(position)
    return next((rate for rate in rates if rate == f"{position.unit}/s"), rates[0])


def read_goal_velocity(name: str, said: str, how: str, slope: Relation | None, goal: Read) -> Read:
    """A velocity that is commanded beside a goal; it need not be the goal's derivative."""
    read = read_velocity(name, said, how, slope, goal)
    if read.trust == ASK and not said and measures(goal.unit, *POSITION):
        unit = _own_rate(goal)
        return Read(quoted(name) + RATE[unit], unit, LIKELY, f"no unit is said; taken for {unit}, as its goal")
    return replace(read, why=read.why.replace("of the position", "of the goal"))
