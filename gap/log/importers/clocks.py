"""The time of a recording: which column it is and in which unit, and what is wrong with columns that look like one."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..reader import FASTEST_PERIOD, SLOWEST_PERIOD
from ..types import Array
from .expression import measures, quoted
from .lines import ASK, LIKELY, SURE, Line
from .names import Claim, said
from .recording import MOST_OF_THEM, Recording

FASTEST_USUAL_PERIOD = 1e-4  # [s] of the fastest logs that are usual
SECONDS_IN_UNIT = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of clocks [s]."""
SECONDS_SINCE_1970 = (9e8, 4.2e9)  # [s] of 1998 to 2103
DAYS = tuple(86400.0 / second for second in (1.0, 1e-3, 1e-6, 1e-9))
"""A day in the units of clocks."""
OF_A_DAY = 0.01  # share of a day by which a jump back may be shorter: a recording has no rows for a while; assumed
LATE_ROWS = 100.0  # steps back at most from which rows are late, and no new recording or overflow; assumed
NEVER = "it never changes"
RATE = re.compile(r"(.*[._])?(fs|fps|hz|f_?sampl\w*|(sampl\w*|action|control|loop)_?(rate|freq\w*|hz))(_?hz)?", re.I)
STEP = re.compile(r"(.*[._])?(ts|dt|delta_?t|t_?sampl\w*|sampl\w*(time|period|step|interval))(_[a-z]+)?", re.I)
"""Names of single numbers that are the samples a second, and the sample period."""


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


def together(times: Sequence[Array]) -> bool:
    """Whether clocks of the day say that all recordings were made at one time."""
    seconds = [[SECONDS_IN_UNIT[unit] * time[0] for unit in clock_units(time)] for time in times]
    of_the_day = all(any(SECONDS_SINCE_1970[0] < one < SECONDS_SINCE_1970[1] for one in own) for own in seconds)
    return len(times) > 1 and of_the_day and overlap(times)


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
    named = [name for name in spoken if _units(columns[name], claims[name].unit)]
    running = [name for name in columns if clock_units(columns[name]) and len(np.unique(columns[name])) > 10]
    faults = {name: clock_fault(columns[name]) for name in spoken if name not in (*named, *sure)}
    candidates = sure or named or running
    if not candidates or (not (sure or named) and any(fault != NEVER for fault in faults.values())):
        return _no_clock(recording, faults)
    name = candidates[0]
    unused = faults | dict.fromkeys(candidates[1:], f"another clock; {name} is taken")
    told = bool(named) or len(running) == 1
    return Clock(name, _line(name, columns[name], claims[name].unit, bool(sure), told), unused)


def _no_clock(recording: Recording, faults: dict[str, str]) -> Clock:
    """The time by a rate that the file says, or a question."""
    if faults:
        name, fault = next(iter(faults.items()))
        ask = f"{quoted(name)} says that it is the time, but {fault}; or write another expression, in seconds"
        others = {one: why for one, why in faults.items() if one != name}
        return Clock("", Line(quoted(name), "?", ASK, fault, ask), others)
    for name, value in recording.facts.items():
        known, rate = measures(said(name).unit, "time"), bool(RATE.fullmatch(name))
        if isinstance(value, str) or not value > 0.0 or not (rate or STEP.fullmatch(name)):
            continue
        step = 1.0 / value if rate else value * (known.factor if known else 1.0)
        if FASTEST_PERIOD <= step <= SLOWEST_PERIOD:
            text = f"row/{quoted(name)}" if rate else f"row*{quoted(name)}{known.behind if known else ''}"
            why = f"there is no clock, and {name} is {value:g}: {1.0 / step:.4g} Hz"
            return Clock("row", Line(text, "s", LIKELY, why))
    ask = (
        "which column is the time? None runs on in steps of a sample period. Write its expression, in seconds; "
        "cumsum(<column>) of sample periods, or row/<samples a second> where the file has none"
    )
    return Clock("", Line("row/100", "?", ASK, "100 Hz is a guess", ask))


def _units(values: Array, spoken: str) -> list[str]:
    """Units in which a column is a clock, with the one that its name says."""
    units, known = clock_units(values), measures(spoken, "time")
    return [*units, spoken] if known and spoken not in units and "s" in clock_units(values * known.factor) else units


def _line(name: str, values: Array, spoken: str, by_format: bool, told: bool) -> Line:
    """How a clock becomes seconds: in the unit that is said, else in the only one in which its steps are usual."""
    column, known, possible = quoted(name), measures(spoken, "time"), _units(values, spoken)
    step = float(f"{np.nanmedian(np.diff(values)):.4g}")
    if known and (spoken in possible or by_format):
        return Line(column + known.behind, spoken, SURE, f"in {spoken}, a sample each {step:g}")
    if spoken or not possible:
        why = f"steps of {step:g} are no sample period in {spoken or 'any unit'}: write seconds"
        return Line(column, "?", ASK, why)
    usual = [unit for unit in possible if step * SECONDS_IN_UNIT[unit] > 0.99 * FASTEST_USUAL_PERIOD]
    unit = possible[0]
    rates = [(one, f"{1.0 / (step * SECONDS_IN_UNIT[one]):.5g} Hz in {one}")
             for one in (usual if len(usual) > 1 else [unit])]  # fmt: skip
    why = f"a sample each {step:g} is one of {' or '.join(rate for _, rate in rates)}"
    counts = step == 1.0 and unit != "s" and len(np.unique(np.diff(values))) == 1
    text = column + _behind(unit)
    if by_format or (told and not counts and len(rates) == 1):
        return Line(text, unit, LIKELY, why)
    others = "".join(f"; in {one} it is {column}{_behind(one)}" for one, _ in rates if one != unit)
    ask = f"is {column} the time, in {unit}? {why[0].upper()}{why[1:]}{others}"
    return Line(text, unit, ASK, why, f"{ask}; where it counts samples, it is {column}/<samples a second>")


def _behind(unit: str) -> str:
    known = measures(unit, "time")
    return known.behind if known else ""


def clock_fault(values: Array) -> str:
    """Why a column that should be a clock is none, and what to do."""
    finite = np.flatnonzero(np.isfinite(values))
    steps = np.diff(values[finite])
    if not len(steps) or not steps.any():
        return NEVER
    if (steps <= 0.0).all():
        return "it runs backwards: turn the order of the rows round"
    if (steps < 0.0).any():
        at = int(np.flatnonzero(steps < 0.0)[0])
        row, back = int(finite[at]) + 1, -float(steps[at])
        said = f"it jumps back in row {int(finite[at + 1]) + 1}"
        if day := next((day for day in DAYS if abs(back / day - 1.0) < OF_A_DAY), 0.0):
            return f"{said}, as the time of day does at midnight: write wrapped(<column>, {day:g}), in seconds"
        if back < LATE_ROWS * np.nanmedian(np.abs(steps)):
            return (
                f"{said} by a few rows: leave out rows that come too late by `where: later(<column>)`, or part "
                "the file where a recording ends"
            )
        return (
            f"{said}: part the file where a recording ends, keep the first by `where: {row} - row`, or write "
            "counter(<column>), in seconds, of a counter that overflows"
        )
    if np.median(steps) == 0.0:
        return (
            "it repeats: export a row a sample with a column for each joint, and fractions of a second; of a stamp in "
            "two columns write <seconds> - <the first of them> + <nanoseconds>*1e-9"
        )
    return f"its steps of {np.median(steps):.4g} are no sample period in s, ms, us or ns"
