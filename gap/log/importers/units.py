"""From the unit that a foreign column is in to the unit of the log: what is said, what is shown, what must be asked."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..types import Array
from ..units import FACTOR, behind
from . import steps
from .evidence import Relation, encoder, grid, whole_numbers
from .expression import names_in, quoted
from .unit_words import measures, named_by_unit, unit_of

SURE, LIKELY, ASK = "sure", "likely", "ask"

ANGLE = behind("rad", "deg", "mrad", "turn")
"""Expression behind a column that makes it an angle in rad, by the units that numbers tell."""
WAY = behind("m", "mm", "cm")
POSITION = ("angle", "way")
"""Quantities of a position."""
TURNING, MOVING = ("rad/s", "deg/s", "rpm", "turn/s"), ("m/s", "mm/s")
"""Units that the velocity of a hinge and of a slide may be in where no name says one."""
RATE = behind(*TURNING, "mrad/s", *MOVING)
ELECTRICAL = "erpm"
"""Unit of a velocity that a pole pair and a gear belong to."""
NEAR, ROUGH = 1.05, 1.3
"""A velocity is in the unit in which it is within the first factor of what the position does; within the second, it
may be."""
BITS = range(8, 25)
"""Powers of two that the counts of a turn may be."""
EXACT = 0.01
"""Share by which a velocity in a unit that is said may miss a power of two as the counts of a turn."""
QUANTITIES = {
    "torque": ("torque", "force"),
    "torque_command": ("torque", "force"),
    "current": ("current",),
    "voltage": ("voltage",),
}
"""By signal what it may be measured as."""
TEMPERATURES = {"degC": "{}", "0.1 degC": "{}*0.1", "degF": "({} - 32)/1.8", "K": "({} - 273.15)"}
"""Expression of a temperature by its unit."""
MILLI = {"current": "mA", "torque": "mN.m", "torque_command": "mN.m"}
"""By signal the unit in which registers count."""
PLAUSIBLE = {"torque": 50.0, "torque_command": 50.0, "current": 60.0, "voltage": 60.0, "temperature": 130.0}
"""By signal the most that is taken for N.m, A, V or degC unasked: more is of a large machine, or in a smaller unit."""
FULL_SCALES = (885.0, 1000.0, 1023.0, 100.0, 255.0)
"""Counts that mean a full duty on known servos and drives."""
CLOSE = 2.5
"""Two scales within this factor are the same unit."""
FOLLOWS = 8.0
"""Times as far as its goal, or as little, that a joint in the same unit moves without a question."""
MOST_RAD = 60.0
"""An angle that goes beyond this is hardly in rad."""
STRAY = 0.02
"""Share of the samples that may lie far outside as what a recorder writes for a lost one."""
FAR = 2.2 * math.pi
"""An angle in rad without a turn to spare stays below this."""
MOST_WAY = 10.0  # [m]
"""What a slide may travel before a name that ends in m is doubted."""


@dataclass(frozen=True)
class Read:
    """How a column becomes one of the log.

    Attributes:
        text: expression.
        unit: that the column is taken to be in.
        trust: ``sure``, ``likely`` (shown, and taken unless somebody objects) or ``ask``.
        why: for people.
        ask: the question, where there is one; columns with the same are asked about together.
    """

    text: str
    unit: str
    trust: str
    why: str
    ask: str = ""


def read_position(name: str, values: Array, said: str, how: str, slide: bool = False) -> Read:
    """An angle or a way by what its name, its grid and its range say.

    Args:
        name: of the column.
        values: of it, of the recording in which it moves most.
        said: unit by its name or its format; ``?`` where the format leaves it open.
        how: who says so.
        slide: whether the joint is known to be a slide.
    """
    column = quoted(name)
    low, high = (float(f(values)) for f in (np.nanmin, np.nanmax))
    span = f"{low:.3g} to {high:.3g}"
    if way := measures(said, "way"):
        if said == "m" and how == "the name" and high - low > MOST_WAY:
            ask = "m of a slide (unit=m), or the angle of a motor that the name means (unit=deg, unit=rad)?"
            return Read(column, said, ASK, f"the name ends in m; {span}", ask)
        return Read(column + way.behind, said, SURE, f"{how} says {said}: a slide; {span}")
    found = encoder(values)
    whole = whole_numbers(values)
    if said == "tick" or (said in ("", "?") and whole and high - low > 400):
        turn = 4096 if high < 4200 else 2 ** math.ceil(math.log2(max(high - min(low, 0.0), 2.0)))
        middle = turn // 2 if low >= 0 else 0
        centred = f"({column} - {middle})" if middle else column
        known = (turn, middle) == (steps.TURN, steps.ZERO)
        ask = f"how many counts are a turn, and which one is 0 rad? {turn} and {middle} are a guess"
        return Read(
            f"{centred}*2*pi/{turn}", "tick", ASK, f"counts of an encoder, {span}", steps.ASKED if known else ask
        )
    if angle := measures(said, "angle"):
        if found and found[0] != said and said in ("rad", "deg"):
            return Read(
                column + ANGLE[found[0]], found[0], ASK,
                f"{how} says {said}, but the steps of its values are a turn in {found[0]} by {found[1]}",
            )  # fmt: skip
        if said == "rad" and max(abs(low), abs(high)) > MOST_RAD:
            return _too_far(column, values, span, how)
        return Read(column + angle.behind, said, SURE, f"{how} says {said}; {span}")
    if found:
        return Read(
            column + ANGLE[found[0]], found[0], SURE,
            f"its steps of {grid(values):.6g} are a turn in {found[0]} by {found[1]}; {span}",
        )  # fmt: skip
    if slide and not said:
        return Read(column, "m", LIKELY, f"of a slide; {span}, taken for m")
    largest = max(abs(low), abs(high))
    if said in ("?", "%"):
        si = "m" if slide else "rad"
        guess = "deg" if largest > 105.0 or said == "?" else "%"
        ask = _share(low, si)
        if said == "?":
            ask = f"degrees (unit=deg), rad (unit=rad), or {ask[0].lower()}{ask[1:]}"
        return Read(column + ANGLE["deg"], guess, ASK, span if said == "?" else f"{how} says %; {span}", ask)
    if said:
        return Read(column, said, ASK, f"{how} says {said}, which is no unit of an angle or a way; {span}")
    if low >= 0.0 and high <= 1.001 and high - low > 0.2:
        ask = "an opening from 0 to 1, rad, turns or m? The values stay within 0 and 1 and show no encoder's steps"
        return Read(column, "rad", ASK, span, ask)
    if largest <= FAR:
        return Read(column, "rad", LIKELY, f"no unit is said; {span} look like rad (of a slide they would be m)")
    unit = "deg" if largest > 12.0 else "rad"
    ask = "degrees (unit=deg), rad over several turns (unit=rad), or mm of a slide (unit=mm)? No unit is said"
    if whole and low >= 0.0:
        ask += f". Whole numbers may also be encoder steps (unit={steps.TICKS})"
    if largest <= 105.0 and (low >= 0.0 or largest > 90.0):
        ask += f". Or is it a share? {_share(low, 'rad')}"
    return Read(column + ANGLE[unit], unit, ASK, span, ask)


def _share(low: float, si: str) -> str:
    """How a share of a joint's range becomes an angle or a way."""
    if low < 0.0:
        return (
            "-100..100 of the range that was calibrated: write middle + <column>/100*(high - low)/2 with the ends and "
            f"the middle of that range in {si}"
        )
    return (
        f"0..100 of the joint's range (unit={steps.PERCENT} beside robot=<its file>: the range that its model has; "
        f"else write low + <column>/100*(high - low) with the ends of the calibrated range in {si})"
    )


def _too_far(column: str, values: Array, span: str, how: str) -> Read:
    """An angle that goes too far for rad: in degrees, or with stray values for lost samples."""
    stray = np.isfinite(values) & (np.abs(values) > MOST_RAD)
    if stray.sum() <= STRAY * len(values):
        first = int(np.argmax(stray))
        ask = (
            f"{column} is {values[first]:.4g} in row {first + 1}, {int(stray.sum())} such in all, which is no angle in "
            f"rad: leave these samples out by the line `where: {MOST_RAD:g} - abs({column})` in the mapping"
        )
        return Read(column, "rad", ASK, f"{how} says rad, but it reaches {span}", ask)
    return Read(column + ANGLE["deg"], "deg", ASK, f"{how} says rad, but it reaches {span}: degrees?")


def read_alike(name: str, said: str, how: str, other: Read, goes: Relation) -> Read:
    """A goal or a second position, by its name or by how it goes with the position that is read as ``other``."""
    column = quoted(name)
    if own := measures(said, *POSITION):
        return Read(column + own.behind, said, SURE, f"{how} says {said}")
    if said and said != other.unit:
        return Read(column, said, ASK, f"{how} says {said}, which is no unit of an angle or a way", other.ask)
    base = measures(other.unit, *POSITION)
    if base and goes.fit > 0.3 and goes.scale > 0.0:
        known = dict(WAY if base.quantity == "way" else ANGLE) | {other.unit: base.behind}
        sizes = {unit: FACTOR.get(unit, base.factor) for unit in known}
        unit = min(known, key=lambda unit: abs(math.log(sizes[unit] / goes.scale / base.factor)))
        off = abs(math.log(sizes[unit] / goes.scale / base.factor))
        if unit != other.unit and (abs(math.log(goes.scale)) < math.log(CLOSE) or off > math.log(1.5)):
            unit = other.unit
        if off > math.log(1.5) and abs(math.log(goes.scale)) > math.log(FOLLOWS):
            ask = (
                f"in which unit is {column}? The position moves {goes.scale:.2g} times as far, as in no unit; keep "
                f"{other.unit} if the joint hardly follows it, or is held and moved by its load"
            )
            return Read(column + known[other.unit], other.unit, ASK, ask.partition("? ")[2], other.ask or ask)
        trust = other.trust if unit == other.unit or other.trust == ASK else LIKELY
        why = f"the position moves {goes.scale:.2f} times as far: {unit}"
        return Read(column + known[unit], unit, trust, why, other.ask)
    text = column + base.behind if base else other.text.replace(next(iter(_columns(other.text)), ""), column)
    trust = ASK if other.trust == ASK else LIKELY
    return Read(text, other.unit, trust, f"taken to be in the unit of the position, {other.unit}", other.ask)


def _columns(text: str) -> list[str]:
    return [quoted(name) for name in names_in(text) if name != "pi"]


def counted_by_velocity(read: Read, name: str, values: Array, said: str, slope: Relation) -> Read:
    """A position in counts, of which a velocity in a unit that is said tells how many are a turn.

    Args:
        read: of the position.
        name: of its column.
        values: of it.
        said: unit of the velocity.
        slope: of the velocity against the derivative of the position.
    """
    rate = measures(f"{said}/s" if measures(said, *POSITION) else said, "rate")
    if read.trust != ASK or read.unit != "tick" or rate is None or slope.fit <= 0.7 or slope.scale <= 0.0:
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


def read_velocity(name: str, said: str, how: str, slope: Relation, position: Read) -> Read:
    """A velocity, by its name and by how it goes with the derivative of the position [as logged]."""
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
    shown = ""
    if slope.fit > 0.7 and slope.scale > 0.0 and position.unit != steps.PERCENT:
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
    elif slope.fit > 0.7:
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


def read_goal_velocity(name: str, said: str, how: str, slope: Relation, goal: Read) -> Read:
    """A velocity that is commanded beside a goal; it need not be the goal's derivative."""
    read = read_velocity(name, said, how, slope, goal)
    if read.trust == ASK and not said and measures(goal.unit, *POSITION):
        rates = _rates(goal)
        unit = next((rate for rate in rates if rate == f"{goal.unit}/s"), rates[0])
        return Read(quoted(name) + RATE[unit], unit, LIKELY, f"no unit is said; taken for {unit}, as its goal")
    return replace(read, why=read.why.replace("of the position", "of the goal"))


def read_other(signal: str, name: str, values: Array, said: str, how: str, rest: str = "") -> Read:
    """A column of the drive, by its name and its range.

    Args:
        signal: of the log.
        name: of the column.
        values: of it, of the recording in which it moves most.
        said: unit by its name or its format; ``?`` where the format leaves it open.
        how: who says so.
        rest: word of its name that names nothing that is known, and may be a unit.
    """
    column = quoted(name)
    finite = values[np.isfinite(values)]
    largest = float(np.abs(finite).max()) if len(finite) else 0.0
    span = f"{finite.min():.3g} to {finite.max():.3g}" if len(finite) else "no values"
    whole = whole_numbers(finite)
    most = PLAUSIBLE.get(signal, math.inf)
    by_name = said if how == "the name" and said in ("A", "V") and named_by_unit(name) else ""
    by_name = by_name if whole or largest > most else ""  # registers count whole numbers
    if by_name:  # 50 may be 5.0 V
        said, most = "", 0.5 * most if whole else most
    if signal == "temperature" and said in TEMPERATURES:
        return Read(TEMPERATURES[said].format(column), said, SURE, f"{how} says {said}; {span}")
    if signal == "duty" and said == "%":
        return Read(f"{column}/100", said, SURE, f"{how} says {said}; {span}")
    if known := measures(said, *QUANTITIES.get(signal, ())):
        return Read(column + known.behind, said, SURE, f"{how} says {said}; {span}")
    if signal == "enabled":
        good = set(np.unique(finite)) <= {0.0, 1.0}
        return Read(column, "", SURE if good else ASK, "0 and 1" if good else f"{span}: which of these mean on?")
    if signal == "duty":
        if largest <= 1.001:
            return Read(column, "1", LIKELY, f"{span}: a share, 1 is full")
        full = next((scale for scale in FULL_SCALES if abs(largest - scale) < 0.5), None)
        guess = full or min(scale for scale in (*FULL_SCALES, 1e9) if scale >= largest)
        ask = f"how many counts mean a full duty? {guess:g} is a guess"
        return Read(f"{column}/{guess:g}", "counts", ASK, f"counts, {span}", ask)
    units = {"torque": "N.m", "torque_command": "N.m", "current": "A", "voltage": "V", "temperature": "degC"}
    unit = units[signal]
    unsigned = ""
    if signal in ("torque", "current") and len(finite) and finite.min() >= 0.0 and np.ptp(finite) > 0.0:
        unsigned = "; never negative, so it may be a magnitude without sign, or a register"
        if signal == "torque" and not said:
            asked = unsigned.replace("; ", "? It is ").replace("so it", "and")
            return Read(column, unit, ASK, span, f"is it a torque at all{asked}")
    if said not in ("", "?") or largest > most or said == "?":
        ask = (
            f"{how} says {said}, which is no unit of a {signal}"
            if said not in ("", "?")
            else f"in which unit is this {signal}?"
        )
        ask += f" Its name says {by_name}, but {largest:.5g} may be tenths or thousandths of it" if by_name else ""
        milli = dict.fromkeys(MILLI, "*1e-3")
        smaller = (milli | {"voltage": "*0.1" if largest < 600 else "*1e-3"}).get(signal, "")
        return Read(column + smaller * (largest > most), unit, ASK, span, ask)
    if rest and signal in MILLI:
        ask = f"is {rest!r} in the name of {column} its unit? It is none that is known: write what makes it {unit}"
        return Read(column, unit, ASK, span, ask)
    if signal in MILLI and whole and np.ptp(finite) > 1.0:
        ask = f"in which unit is this {signal}? Whole numbers are counts of a register, or {MILLI[signal]} (*1e-3)"
        return Read(f"{column}*1e-3", unit, ASK, span, ask)
    why = f"its name says {by_name}" if by_name else "no unit is said"
    return Read(column, unit, LIKELY, f"{why}; {span} taken for {unit}{unsigned}")
