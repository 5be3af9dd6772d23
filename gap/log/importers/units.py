"""From the unit that a foreign column is in to the unit of the log: what is said, what is shown, what must be asked."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..types import Array
from ..units import FACTOR, behind
from . import steps
from .evidence import Relation, encoder, grid, whole_numbers
from .expression import names_in, quoted
from .unit_words import UNIT_OR_NAME, measures, named_by_unit

SURE, LIKELY, ASK = "sure", "likely", "ask"

ANGLE = behind("rad", "deg", "mrad", "turn")
"""Expression behind a column that makes it an angle in rad, by the units that numbers tell."""
WAY = behind("m", "mm", "cm")
POSITION = ("angle", "way")
"""Quantities of a position."""
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
TELLS = 0.3
"""Share of a motion that its goal explains, from which their sizes tell the unit."""
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
MOST_COUNTS = 2.0**53
"""Beyond it a float counts no whole numbers."""
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
        by_range: whether the range alone tells the unit.
    """

    text: str
    unit: str
    trust: str
    why: str
    ask: str = ""
    by_range: bool = False


def read_position(name: str, values: Array, said: str, how: str, slide: bool = False, rest: str = "") -> Read:
    """An angle or a way by what its name, its grid and its range say.

    Args:
        name: of the column.
        values: of it, of the recording in which it moves most.
        said: unit by its name or its format; ``?`` where the format leaves it open.
        how: who says so.
        slide: whether the joint is known to be a slide.
        rest: word of its name that may be a unit or name the joint.
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
    counts = high - min(low, 0.0) < MOST_COUNTS
    if counts and (said == "tick" or (said in ("", "?") and whole and high - low > 400)):
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
    if rest and not said:
        return _unit_or_name(column, rest, span)
    if slide and not said:
        return Read(column, "m", LIKELY, f"of a slide; {span}, taken for m", by_range=True)
    largest = max(abs(low), abs(high))
    if said in ("?", "%"):
        si = "m" if slide else "rad"
        guess = "deg" if largest > 105.0 or said == "?" else "%"
        ask = _share(low, si)
        if said == "?":
            ask = f"degrees (unit=deg), rad (unit=rad), or {ask[0].lower()}{ask[1:]}"
        why = span if said == "?" else f"{how} says %; {span}"
        return Read(column + ANGLE["deg"], guess, ASK, why, ask, said == "?")
    if said:
        asked = f"{how} says {said}, which is no unit of an angle or a way"
        return Read(column, said, ASK, f"{asked}; {span}", f"{asked}: write what makes it rad (slide: m)")
    if is_opening(values):
        ask = "an opening from 0 to 1, rad, turns or m? The values stay within 0 and 1 and show no encoder's steps"
        return Read(column, "rad", ASK, span, ask, True)
    if largest <= FAR:
        why = f"no unit is said; {span} look like rad (of a slide they would be m)"
        return Read(column, "rad", LIKELY, why, by_range=True)
    unit = "deg" if largest > 12.0 else "rad"
    ask = "degrees (unit=deg), rad over several turns (unit=rad), or mm of a slide (unit=mm)? No unit is said"
    if whole and low >= 0.0:
        ask += f". Whole numbers may also be encoder steps (unit={steps.TICKS})"
    if largest <= 105.0 and (low >= 0.0 or largest > 90.0):
        ask += f". Or is it a share? {_share(low, 'rad')}"
    return Read(column + ANGLE[unit], unit, ASK, span, ask, True)


def is_opening(values: Array) -> bool:
    """Whether a column (n,) stays within 0 and 1, as the opening of a gripper does."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    return low >= 0.0 and high <= 1.001 and high - low > 0.2


def _unit_or_name(column: str, word: str, span: str) -> Read:
    """An angle or a way whose name has a word that may be its unit or name its joint."""
    if unit := UNIT_OR_NAME.get(word):
        ask = f"turns (unit={unit}), as {word!r} in the names may say, or does it name the joint (unit=rad, unit=deg)?"
        return Read(column + ANGLE[unit], unit, ASK, f"{word!r} may be its unit; {span}", ask)
    ask = (
        f"is {word!r} in the names the unit? It is none that is known: write what makes it rad (slide: m), or give the "
        "unit, as unit=deg, if the word names something else"
    )
    return Read(column, word, ASK, f"{word!r} may be its unit; {span}", ask)


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
        base = measures(other.unit, *POSITION)
        size = abs(goes.scale)
        if other.by_range and base and goes.fit > TELLS and said != other.unit and 1.0 / CLOSE < size < CLOSE:
            position = next(iter(_columns(other.text)), "the position")
            ask = (
                f"is {position} in {said}, too (unit={said})? No unit of it is said, and it moves {size:.2f} times as "
                f"far as {column} in the numbers of the file"
            )
            return Read(column + own.behind, said, ASK, f"{how} says {said}, and not of the position", ask)
        return Read(column + own.behind, said, SURE, f"{how} says {said}")
    if said and said != other.unit:
        return Read(column, said, ASK, f"{how} says {said}, which is no unit of an angle or a way", other.ask)
    base = measures(other.unit, *POSITION)
    size = abs(goes.scale)  # one that goes the other way is in a unit, too
    if base and goes.fit > TELLS and size > 0.0:
        known = dict(WAY if base.quantity == "way" else ANGLE) | {other.unit: base.behind}
        sizes = {unit: FACTOR.get(unit, base.factor) for unit in known}
        unit = min(known, key=lambda unit: abs(math.log(sizes[unit] / size / base.factor)))
        off = abs(math.log(sizes[unit] / size / base.factor))
        if unit != other.unit and (abs(math.log(size)) < math.log(CLOSE) or off > math.log(1.5)):
            unit = other.unit
        if off > math.log(1.5) and abs(math.log(size)) > math.log(FOLLOWS):
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
            f"{how} says {said}, which is no unit of a {signal}: write what makes it {unit}"
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
