"""From the unit that a foreign column is in to the unit of the log: what is said, what is shown, what must be asked."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from ..types import Array
from ..units import FACTOR, behind
from .evidence import Relation, encoder, grid, whole_numbers
from .expression import names_in, quoted

SURE, LIKELY, ASK = "sure", "likely", "ask"

ANGLE = behind("rad", "deg", "mrad", "turn")
"""Expression behind a column that makes it an angle in rad."""
WAY = behind("m", "mm", "cm")
POSITION = ANGLE | WAY
RATE = behind("rad/s", "deg/s", "rpm", "turn/s", "m/s", "mm/s")
TURNING, MOVING = ("rad/s", "deg/s", "rpm", "turn/s", "mrad/s"), ("m/s", "mm/s")
"""Units that the velocity of a hinge and of a slide may be in."""
OTHERS = {
    "torque": {"N.m": "", "mN.m": "*1e-3", "N": ""},
    "torque_command": {"N.m": "", "mN.m": "*1e-3", "N": ""},
    "current": {"A": "", "mA": "*1e-3"},
    "voltage": {"V": "", "mV": "*1e-3"},
    "temperature": {"degC": ""},
    "duty": {"%": "/100", "1": ""},
    "enabled": {"": ""},
}
"""By signal: expression behind a column in a unit that its name says."""
MILLI = {"current": "mA", "torque": "mN.m", "torque_command": "mN.m"}
"""By signal the unit in which registers count."""
FULL_SCALES = (885.0, 1000.0, 1023.0, 100.0, 255.0)
"""Counts that mean a full duty on known servos and drives."""
CLOSE = 2.5
"""Two scales within this factor are the same unit."""
FAR = 2.2 * math.pi
"""An angle in rad without a turn to spare stays below this."""


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
    if said in WAY:
        return Read(column + WAY[said], said, SURE, f"{how} says {said}: a slide")
    found = encoder(values)
    if said == "tick" or (said in ("", "?") and whole_numbers(values) and high - low > 400):
        turn = 4096 if high < 4200 else 2 ** math.ceil(math.log2(max(high - min(low, 0.0), 2.0)))
        middle = turn // 2 if low >= 0 else 0
        centred = f"({column} - {middle})" if middle else column
        return Read(
            f"{centred}*2*pi/{turn}", "tick", ASK, f"counts of an encoder, {span}",
            f"how many counts are a turn, and which one is 0 rad? {turn} and {middle} are a guess",
        )  # fmt: skip
    if said in ANGLE:
        if found and found[0] != said and said in ("rad", "deg"):
            return Read(
                column + ANGLE[found[0]], found[0], ASK,
                f"{how} says {said}, but the steps of its values are a turn in {found[0]} by {found[1]}",
            )  # fmt: skip
        if said == "rad" and max(abs(low), abs(high)) > 60.0:
            return Read(column + ANGLE["deg"], "deg", ASK, f"{how} says rad, but it reaches {span}: degrees?")
        return Read(column + ANGLE[said], said, SURE, f"{how} says {said}; {span}")
    if found:
        return Read(
            column + ANGLE[found[0]], found[0], SURE,
            f"its steps of {grid(values):.6g} are a turn in {found[0]} by {found[1]}; {span}",
        )  # fmt: skip
    if slide:
        return Read(column, "m", LIKELY, f"of a slide; {span}, taken for m")
    largest = max(abs(low), abs(high))
    if said in ("?", "%"):
        reaches = "-100..100" if low < 0 else "0..100"
        guess = "deg" if largest > 105.0 or said == "?" else "%"
        text = column + ANGLE["deg"]
        ask = (
            f"degrees (unit=deg), rad (unit=rad), or {reaches} of the range that was calibrated? Of the last that "
            "range is needed: <column>/100*<half the range in rad>"
        )
        return Read(text, guess, ASK, f"{span}", ask)
    if said:
        return Read(column, said, ASK, f"{how} says {said}, which is no unit of an angle or a way; {span}")
    if low >= 0.0 and high <= 1.001 and high - low > 0.2:
        ask = "an opening from 0 to 1, rad, turns or m? The values stay within 0 and 1 and show no encoder's steps"
        return Read(column, "rad", ASK, span, ask)
    if largest <= FAR:
        return Read(column, "rad", LIKELY, f"no unit is said; {span} look like rad (of a slide they would be m)")
    unit = "deg" if largest > 12.0 else "rad"
    ask = "degrees (unit=deg), rad over several turns (unit=rad), or mm of a slide (unit=mm)? No unit is said"
    return Read(column + ANGLE[unit], unit, ASK, span, ask)


def read_alike(name: str, said: str, how: str, other: Read, goes: Relation) -> Read:
    """A goal or a second position, by its name or by how it goes with the position that is read as ``other``."""
    column = quoted(name)
    if said in POSITION:
        return Read(column + POSITION[said], said, SURE, f"{how} says {said}")
    if other.unit in POSITION and goes.fit > 0.3 and goes.scale > 0.0:
        known = WAY if other.unit in WAY else ANGLE
        unit = min(known, key=lambda unit: abs(math.log(FACTOR[unit] / goes.scale / FACTOR[other.unit])))
        if unit != other.unit and abs(math.log(goes.scale)) < math.log(CLOSE):
            unit = other.unit
        trust = other.trust if unit == other.unit or other.trust == ASK else LIKELY
        why = f"the position moves {goes.scale:.2f} times as far: {unit}"
        return Read(column + known[unit], unit, trust, why, other.ask)
    text = other.text.replace(next(iter(_columns(other.text)), ""), column) if other.trust == ASK else column
    if other.unit in POSITION:
        text = column + POSITION[other.unit]
    trust = ASK if other.trust == ASK else LIKELY
    return Read(text, other.unit, trust, f"taken to be in the unit of the position, {other.unit}", other.ask)


def _columns(text: str) -> list[str]:
    return [quoted(name) for name in names_in(text) if name != "pi"]


def read_velocity(name: str, said: str, how: str, slope: Relation, position: Read) -> Read:
    """A velocity, by its name and by how it goes with the derivative of the position [as logged]."""
    column = quoted(name)
    known = RATE
    if said in ("deg", "rad", "mm", "m"):
        said += "/s"
    shown = ""
    if slope.fit > 0.7 and slope.scale > 0.0:
        per = slope.scale / (FACTOR[position.unit] if position.unit in POSITION else 1.0)
        shown = f"it is {slope.scale:.3g} times the derivative of the position as logged"
        rates = MOVING if position.unit in WAY else TURNING
        unit = min(rates, key=lambda unit: abs(math.log(per * FACTOR[unit])))
        size = per * FACTOR[unit]
        if said in known and unit != said:
            return Read(column + known[said], said, ASK, f"{how} says {said}, but {shown}, as {unit} would be")
        if position.unit == "tick" and not said:
            turn = re.search(r"\*2\*pi/(\d+)", position.text)
            per_count = 2.0 * math.pi / float(turn[1] if turn else 4096) / slope.scale
            return Read(f"{column}*{per_count:.4g}", "counts", ASK, f"{shown}, in rad/s", position.ask)
        if position.trust == ASK and not said:
            text = column + (known.get(f"{position.unit}/s") or known.get(unit, ""))
            return Read(text, unit, ASK, "its unit hangs on that of the position", position.ask)
        if abs(math.log(size)) < math.log(1.3) and unit in known:
            return Read(column + known[unit], unit, SURE if said == unit else position.trust, f"{shown}: {unit}")
    elif slope.fit > 0.7:
        shown = "it goes against the derivative of the position"
    if said in known:
        return Read(
            column + known[said],
            said,
            SURE if not shown else LIKELY,
            f"{how} says {said}" + (f"; {shown}" * bool(shown)),
        )
    return Read(
        column, "?", ASK, f"no unit is said, and {shown or 'it does not go with the derivative of the position'}"
    )


def read_other(signal: str, name: str, values: Array, said: str, how: str) -> Read:
    """A column of the drive, by its name and its range."""
    column, known = quoted(name), OTHERS[signal]
    finite = values[np.isfinite(values)]
    largest = float(np.abs(finite).max()) if len(finite) else 0.0
    span = f"{finite.min():.3g} to {finite.max():.3g}" if len(finite) else "no values"
    if signal == "temperature" and said == "degF":
        return Read(f"({column} - 32)/1.8", said, SURE, f"{how} says {said}; {span}")
    if said in known and said:
        return Read(column + known[said], said, SURE, f"{how} says {said}; {span}")
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
    # larger ones are of a large machine, or in mN.m: a person is asked
    plausible = {"torque": 50.0, "torque_command": 50.0, "current": 60.0, "voltage": 60.0, "temperature": 130.0}
    units = {"torque": "N.m", "torque_command": "N.m", "current": "A", "voltage": "V", "temperature": "degC"}
    unit = units[signal]
    unsigned = ""
    if signal in ("torque", "current") and len(finite) and finite.min() >= 0.0 and np.ptp(finite) > 0.0:
        unsigned = "; never negative, so it may be a magnitude without sign, or a register"
        if signal == "torque" and not said:
            asked = unsigned.replace("; ", "? It is ").replace("so it", "and")
            return Read(column, unit, ASK, span, f"is it a torque at all{asked}")
    if said not in ("", "?") or largest > plausible[signal] or said == "?":
        ask = (
            f"{how} says {said}, which is no unit of a {signal}"
            if said not in ("", "?")
            else f"in which unit is this {signal}?"
        )
        milli = dict.fromkeys(MILLI, "*1e-3")
        smaller = (milli | {"voltage": "*0.1" if largest < 600 else "*1e-3"}).get(signal, "")
        return Read(column + smaller * (largest > plausible[signal]), unit, ASK, span, ask)
    if signal in MILLI and whole_numbers(finite) and np.ptp(finite) > 1.0:
        ask = f"in which unit is this {signal}? Whole numbers are counts of a register, or {MILLI[signal]} (*1e-3)"
        return Read(f"{column}*1e-3", unit, ASK, span, ask)
    return Read(column, unit, LIKELY, f"no unit is said; {span} taken for {unit}{unsigned}")
