"""The time of a recording: which column it is and in which unit, and what is wrong with columns that look like one."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..reader import FASTEST_PERIOD, SLOWEST_PERIOD
from ..types import Array
from .expression import quoted
from .lines import ASK, LIKELY, SURE, Line
from .motion import whole_numbers
from .names import Claim, said
from .recording import MOST_OF_THEM, STRAY_SHARE, Recording
from .units import measures

FASTEST_USUAL_PERIOD = 1e-4  # [s] of the fastest logs that are usual
SECONDS_IN_UNIT = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of clocks [s]."""
SECONDS_SINCE_1970 = (9e8, 4.2e9)  # [s] of 1998 to 2103
NEVER = "it never changes"
PERIODS = frozenset(["dt", "deltat", "period", "duration"])
"""Words for the time from one sample to the next."""
RATE = re.compile(r"(.*[._])?(fs|fps|hz|f_?sampl\w*|(sampl\w*|action|control|loop)_?(rate|freq\w*|hz))(_?hz)?", re.I)
STEP = re.compile(r"(.*[._])?(ts|dt|delta_?t|t_?sampl\w*|sampl\w*(time|period|step|interval))(_[a-z]+)?", re.I)
"""Names of single numbers that are the samples a second, and the sample period."""
STAMP = re.compile(r"(?P<stem>.*?)[._/ -]?(?:(?P<whole>[sS]ecs?)|(?P<ms>(?i:milli|m)(?i:secs?|s))"
                   r"|(?P<us>(?i:micro|u)(?i:secs?|s))"
                   r"|(?P<ns>(?i:nano|n)(?i:secs?)))?")  # fmt: skip
"""A stamp in two columns: its whole seconds, and the part of a second by its unit."""
PER_SECOND = {"ms": 1e3, "us": 1e6, "ns": 1e9}


@dataclass(frozen=True)
class Clock:
    """The time of a recording: its column (``row`` for the number of the sample, empty where nothing tells the time),
    how it becomes seconds, and why other columns that look like clocks are not taken."""

    name: str
    line: Line
    unused: dict[str, str] = field(default_factory=dict)


# --- clocks as numbers -----------------------------------------------------------------------------------------------


def clock_units(time: Array) -> list[str]:
    """Units in which a column's steps are sample periods of a servo's log; empty where it is no clock."""
    known = time[np.isfinite(time)]
    steps = np.diff(known)
    if len(steps) < 2 or (steps < 0).any() or np.median(steps) <= 0.0:
        return []
    step = float(np.median(steps))
    return [unit for unit, second in SECONDS_IN_UNIT.items() if FASTEST_PERIOD <= step * second <= SLOWEST_PERIOD]


def units_of_the_day(time: Array) -> list[str]:
    """Units in which a clock is of the day; none where it may begin at any time."""
    since = {unit: SECONDS_IN_UNIT[unit] * time[0] for unit in clock_units(time)}
    return [unit for unit, seconds in since.items() if SECONDS_SINCE_1970[0] < seconds < SECONDS_SINCE_1970[1]]


def together(times: Sequence[Array]) -> bool:
    """Whether clocks of the day say that all recordings were made at one time."""
    return len(times) > 1 and all(map(units_of_the_day, times)) and overlap(times)


def overlap(times: Sequence[Array]) -> bool:
    """Whether recordings ran side by side for most of the longest."""
    begin, end = max(time[0] for time in times), min(time[-1] for time in times)
    return bool(end - begin > MOST_OF_THEM * max(time[-1] - time[0] for time in times))


def held(time: Array, values: Array, at: Array) -> Array:
    """The last value at other times, NaN before the first."""
    before = np.searchsorted(time, at, side="right") - 1
    return np.where(before >= 0, values[np.maximum(before, 0)], np.nan)


def in_force(time: Array, values: Array, at: Array) -> tuple[Array, float]:
    """The command that was in force over most of each sample, NaN before the first, and how late commands usually come.

    A command that comes shortly after the start of a sample is taken there, though it is later.

    Args:
        time, values: of the commands, (n,).
        at: times of the samples, (m,), in the same unit.

    Returns:
        Values (m,), and the median time by which they are behind the start of their sample; 0 where they are not.
    """
    period = np.diff(at, append=at[-1] + (at[-1] - at[-2] if len(at) > 1 else 0.0))
    middle = at + 0.5 * np.minimum(period, 2.0 * float(np.median(period)))
    late = held(time, time, middle) - at
    return held(time, values, middle), max(float(np.nanmedian(late)), 0.0) if np.isfinite(late).any() else 0.0


def offset_note(who: str, late: str) -> str:
    """What is said of commands that come after the samples that have them."""
    return f"commands of {who} come {late} (median) after the samples: each sample has the one in force over most of it"


# --- the clock of a recording ----------------------------------------------------------------------------------------


def find_clock(recording: Recording, claims: Mapping[str, Claim] | None = None) -> Clock:
    """The clock: by a claim, else the one column that runs on.

    Args:
        recording: one run.
        claims: on its columns; None: what their names say.
    """
    columns = recording.columns
    claims = {name: said(name) for name in columns} if claims is None else claims
    times = [name for name in columns if claims[name].signal == "time"]
    sure = [name for name in times if recording.roles.get(name) == "time"]
    sure = sure or [name for name in times if claims[name].by not in ("the name", "the file")]
    spoken = sorted(times, key=lambda name: (claims[name].joint != "", "duration" in name.lower(), len(name)))
    spoken = [name for name in spoken if "[" not in name[-4:-1]] or spoken  # no column of a matrix where a vector is
    two = _in_two_columns(recording)
    halves = two[:2] if two else ()
    named = [name for name in spoken if name not in halves and _units(columns[name], claims[name].unit)]
    running = [name for name in columns if clock_units(columns[name]) and len(np.unique(columns[name])) > 10]
    faults = {name: clock_fault(columns[name]) for name in spoken if name not in (*named, *sure, *halves)}
    if two and not (sure or named):
        return Clock(two[0], two[2], faults)
    faults |= dict.fromkeys(halves, "a stamp in two columns, another clock")
    candidates = sure or named or running
    if not candidates or (not (sure or named) and any(fault != NEVER for fault in faults.values())):
        return _no_clock(recording, faults)
    name = candidates[0]
    unused = faults | dict.fromkeys(candidates[1:], f"another clock; {name} is taken")
    return Clock(
        name, _line(name, columns[name], claims[name].unit, bool(sure), bool(named) or len(running) == 1), unused
    )


def _in_two_columns(recording: Recording) -> tuple[str, str, Line] | None:
    """A stamp in two columns, as ROS has it: whole seconds, the part of a second, and their sum as the time."""
    found = {name: match for name in recording.columns if (match := STAMP.fullmatch(name))}
    for whole, match in found.items():
        if not match["whole"] and said(whole).signal != "time":
            continue
        for part, other in found.items():
            unit = next((unit for unit in PER_SECOND if other[unit]), "")
            if unit and part != whole and other["stem"].lower() == match["stem"].lower():
                line = _summed_stamp(whole, recording.columns[whole], part, recording.columns[part], unit)
                if line:
                    return whole, part, line
    return None


def _summed_stamp(whole: str, seconds: Array, part: str, parts: Array, unit: str) -> Line | None:
    """The time as the sum of two columns, from the first second on: a float has no digits for seconds since 1970.

    None where they are no stamp: its part begins again at each second, and it is in order but for recordings that end.
    """
    known = np.isfinite(seconds) & np.isfinite(parts)
    inside = (parts[known] >= 0.0) & (parts[known] < PER_SECOND[unit])
    if known.sum() < 3 or not whole_numbers(seconds) or not inside.all():
        return None
    first = int(seconds[known][0])
    time = (seconds - first + parts / PER_SECOND[unit])[known]
    steps = np.diff(time)
    step = float(np.median(steps))
    if not FASTEST_PERIOD <= step <= SLOWEST_PERIOD or (steps < 0.0).mean() > STRAY_SHARE:
        return None
    text = f"{quoted(whole)} - {first} + {quoted(part)}{_behind(unit)}".replace("- -", "+ ").replace(" - 0 ", " ")
    if (steps < 0.0).any():
        fault = clock_fault(time)
        return Line(text, "s", ASK, fault, f"{quoted(whole)} and {quoted(part)} are the time, but {fault}")
    return Line(text, "s", SURE, f"whole seconds and {unit} of one stamp, from the first second on, each {step:.4g} s")


def _behind(unit: str) -> str:
    known = measures(unit, "time")
    return known.behind if known else ""


def _no_clock(recording: Recording, faults: dict[str, str]) -> Clock:
    """The time as the sum of sample periods, by a rate that the file says, or a question."""
    columns = recording.columns
    period = next((name for name in columns if PERIODS & set(re.findall("[a-z]+", name.lower()))
                   and (np.nan_to_num(columns[name]) >= 0.0).all()
                   and not (np.diff(columns[name]) == 1.0).all()), None)  # fmt: skip
    if faults.keys() - {period}:
        name, fault = next(iter(faults.items()))
        ask = f"{quoted(name)} says that it is the time, but {fault}; or write another expression, in seconds"
        return Clock(
            "", Line(quoted(name), "?", ASK, fault, ask), {one: why for one, why in faults.items() if one != name}
        )
    if period:
        return Clock(period, _summed(period, columns[period]))
    for name, value in recording.facts.items():
        known, rate = measures(said(name).unit, "time"), bool(RATE.fullmatch(name))
        if isinstance(value, str) or not value > 0.0 or not (rate or STEP.fullmatch(name)):
            continue
        step = 1.0 / value if rate else value * (known.factor if known else 1.0)
        if FASTEST_PERIOD <= step <= SLOWEST_PERIOD:
            text = f"row/{quoted(name)}" if rate else f"row*{quoted(name)}{known.behind if known else ''}"
            return Clock(
                "row", Line(text, "s", LIKELY, f"there is no clock, and {name} is {value:g}: {1.0 / step:.4g} Hz")
            )
    ask = (
        "which column is the time? None runs on in steps of a sample period. Write its expression, in seconds; "
        "where the file has none, row/<samples a second>"
    )
    return Clock("", Line("row/100", "?", ASK, "100 Hz is a guess", ask))


def _summed(name: str, periods: Array) -> Line:
    """The time as the sum of the sample periods in a column."""
    period, spoken = float(np.nanmedian(periods)), said(name).unit
    units = [unit for unit in ("s", "ms", "us") if FASTEST_PERIOD <= period * SECONDS_IN_UNIT[unit] <= SLOWEST_PERIOD]
    unit = spoken if spoken in units else next(iter(units), "s")
    ask = f"is {quoted(name)} the time from one sample to the next, in {unit}?"
    why = f"sum of the sample periods, {period:.4g} {unit}"
    return Line(f"cumsum({quoted(name)}){_behind(unit)}", unit, SURE if spoken == unit else ASK, why, ask)


def _units(values: Array, spoken: str) -> list[str]:
    """Units in which a column is a clock, with the one that its name says."""
    units, known = clock_units(values), measures(spoken, "time")
    return [*units, spoken] if known and spoken not in units and "s" in clock_units(values * known.factor) else units


def _line(name: str, values: Array, spoken: str, by_format: bool, told: bool) -> Line:
    """How a clock becomes seconds: in the unit that is said, else in the one in which its steps are usual."""
    column, known, possible = quoted(name), measures(spoken, "time"), _units(values, spoken)
    step = float(f"{np.nanmedian(np.diff(values)):.4g}")
    if known and (spoken in possible or by_format):
        return Line(column + known.behind, spoken, SURE, f"in {spoken}, a sample each {step:g}")
    if spoken or not possible:
        return Line(
            column, "?", ASK, f"steps of {step:g} are no sample period in {spoken or 'any unit'}: write seconds"
        )
    usual = [unit for unit in possible if step * SECONDS_IN_UNIT[unit] > 0.99 * FASTEST_USUAL_PERIOD]
    since = units_of_the_day(values)
    unit = since[0] if len(since) == 1 and len(usual) > 1 else possible[0]
    rates = [
        f"{1.0 / (step * SECONDS_IN_UNIT[one]):.5g} Hz in {one}"
        for one in (usual if len(usual) > 1 and unit not in since else [unit])
    ]
    why = f"a sample each {step:g} is one of {' or '.join(rates)}{': since 1970' * (unit in since)}"
    text = column + _behind(unit)
    whole = step == 1.0 and unit != "s" and len(np.unique(np.diff(values))) == 1
    if by_format or (told and not whole and len(rates) == 1):
        return Line(text, unit, LIKELY, why)
    ask = f"is {column} the time, in {unit}? {why[0].upper()}{why[1:]}"
    ask += "".join(f"; in {one} it is {column}{_behind(one)}" for one in usual[1:] if len(rates) > 1)
    ask += f"; or does it count samples? Then the time is {column}/<samples a second>" if whole else ""
    return Line(text, unit, ASK, why, ask)


def clock_fault(values: Array) -> str:
    """Why a column that should be a clock is none, and what to do."""
    known = values[np.isfinite(values)]
    steps = np.diff(known)
    if not len(steps) or not steps.any():
        return NEVER
    if (steps <= 0.0).all():
        return f"it runs backwards, from {known[0]:g} to {known[-1]:g}: turn the order of the rows round"
    if (steps < 0.0).any():
        rows = np.flatnonzero(np.isfinite(values))[np.flatnonzero(steps < 0.0) + 1]  # behind each jump
        at = int(np.argmax(steps < 0.0))
        where = f"it jumps back in row {rows[0] + 1}, from {known[at]:g} to {known[at + 1]:g}"
        if any(0.95 * 2.0**bits < known[at] < 2.0**bits for bits in (16, 24, 32)):
            where += ", as a counter that overflows: write counter(<column>), in seconds. Else"
        if len(rows) > 1:
            more = f"{where}, and in {len(rows)} rows in all"
            return f"{more}: there recordings end and begin, or rows are out of their order; part the file, or order it"
        return (
            f"{where}: there one recording ends and the next begins, so part the file, or import it twice, with the "
            f"line `where: {rows[0]} - row` in one mapping and `where: row - {rows[0] - 1}` in the other"
        )
    if np.median(steps) == 0.0:
        each = f"it repeats, {len(known) / len(np.unique(known)):.3g} rows have the same stamp"
        if whole_numbers(known):
            return f"{each}: export it with fractions of a second"
        return f"{each}: of a row for each joint make a column for each joint, one row a sample"
    return f"its steps of {np.median(steps):.4g} are no sample period in s, ms, us or ns"
