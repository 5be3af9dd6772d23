"""The clock of a foreign recording: which column it is, in which unit, or what is wrong with the one that says so."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..types import Array
from .clock_units import rivals, told
from .evidence import CLOCKS, FASTEST, SLOWEST, clock_units, whole_numbers
from .expression import ROW, quoted, without_overflows
from .names import said
from .recording import Recording
from .unit_words import measures, unit_of
from .units import ASK, LIKELY, SURE, Read

NEVER = "it never changes"
PERIODS = frozenset(["dt", "deltat", "period"])
"""Words for the time from one sample to the next."""
RATE = re.compile(r"(.*[._])?(fs|fps|f_?sampl\w*|sampl\w*(rate|freq\w*|hz))(_?hz)?", re.IGNORECASE)
"""Names of a single number that is the samples a second."""
STEP = re.compile(r"(.*[._])?(ts|dt|delta_?t|t_?sampl\w*|sampl\w*(time|period|step|interval))(_[a-z]+)?", re.IGNORECASE)
"""Names of a single number that is the sample period."""
FACTORS = {unit: known.behind for unit in CLOCKS if (known := measures(unit, "time"))}
"""Expression behind a column that makes it seconds, by the units that steps tell."""
DISORDER = 0.01
"""Share of the rows that go back in time from which a file is in no order, and not of several recordings."""
SKIPPED = 10.0  # usual steps of a counter over which it may have gone where it starts again
INDEXED = re.compile(r".*\[\d+\]")
"""A column of a matrix, which is no clock where a vector is."""
LAST_WORDS = re.compile(r"(.*?)([A-Z]?[a-z]+[A-Z][a-z]+)\Z")
LAST_WORD = re.compile(r"(.*?)([A-Z]?[a-z]+|[A-Z]+)\Z")
PARTS = {"ms": 1e3, "us": 1e6, "ns": 1e9}
"""Parts of a second that a stamp in two columns has beside its whole seconds, and how many are a second."""


@dataclass(frozen=True)
class Clock:
    """The time of a recording.

    Attributes:
        name: of the column, or the number of the sample; empty where nothing tells the time.
        read: how it becomes seconds.
        unused: why other columns that look like clocks are not taken.
    """

    name: str
    read: Read
    unused: dict[str, str] = field(default_factory=dict)


def find_clock(recording: Recording) -> Clock:
    """The clock: by its name, else the one column that runs on."""
    columns = recording.columns
    by_format = [name for name, role in recording.roles.items() if role == "time" and name in columns]
    spoken = sorted(
        (name for name in columns if said(name).signal == "time"),
        key=lambda name: (said(name).joint != "", "duration" in name.lower(), len(name)),
    )
    spoken = [name for name in spoken if not INDEXED.fullmatch(name)] or spoken
    two = _in_two_columns(recording)
    halves = two[:2] if two else ()
    named = [name for name in spoken if name not in halves and _units(columns[name], _spoken(recording, name))]
    running = [name for name in columns if clock_units(columns[name]) and len(np.unique(columns[name])) > 10]
    candidates = by_format or named or running
    faults = {name: clock_fault(columns[name]) for name in spoken if name not in (*named, *by_format, *halves)}
    if two and not (by_format or named):
        return Clock(two[0], _summed_stamp(recording, *two), faults)
    faults |= dict.fromkeys(halves, "a stamp in two columns, another clock")
    moving = {name: fault for name, fault in faults.items() if fault != NEVER}
    for name in [] if by_format or named else moving:
        whole = without_overflows(columns[name])
        if (np.diff(columns[name]) < 0.0).any() and _runs_on(columns[name], whole) and clock_units(whole):
            read = _read(replace(recording, columns={**columns, name: whole}), name, False, True)
            text = read.text.replace(quoted(name), f"counter({quoted(name)})", 1)
            return Clock(name, replace(read, text=text, why=f"{read.why}; it overflows, which counter() mends"), {})
    if not candidates or (moving and not named and not by_format):
        return _no_clock(recording, faults)
    name = candidates[0]
    unused = faults | dict.fromkeys(candidates[1:], f"another clock; {name} is taken")
    sure_of_it = bool(by_format or named) or len(running) == 1
    return Clock(name, _read(recording, name, bool(by_format), sure_of_it), unused)


def _in_two_columns(recording: Recording) -> tuple[str, str, str] | None:
    """A stamp in two columns, as ROS has it: whole seconds, the part of a second, and the unit of the part."""
    stems = {name: _stem(name) for name in recording.columns}
    for whole, (stem, unit) in stems.items():
        if unit != "s" and (unit or said(whole).signal != "time"):
            continue
        for part, (other, fine) in stems.items():
            halves = recording.columns[whole], recording.columns[part]
            if part != whole and other == stem and fine in PARTS and _is_stamp(*halves, PARTS[fine]):
                return whole, part, fine
    return None


def _stem(name: str) -> tuple[str, str]:
    """A name without the unit of a time at its end, and that unit; empty where it has none."""
    for pattern in (LAST_WORDS, LAST_WORD):  # NanoSec before Sec
        match = pattern.fullmatch(name)
        word = match[2].lower() if match else ""
        unit = next((unit for one in (word, word.removesuffix("s")) if (unit := unit_of(one)) in ("s", *PARTS)), "")
        if match and unit:
            return match[1].rstrip("._/-: ").lower(), unit
    return name.rstrip("._/-: ").lower(), ""


def _is_stamp(whole: Array, part: Array, count: float) -> bool:
    """Whether two columns are one stamp: the part begins again where the seconds step, but for recordings that end."""
    known = np.isfinite(whole) & np.isfinite(part)
    seconds, parts = whole[known], part[known]
    if len(seconds) < 3 or not whole_numbers(seconds) or parts.min() < 0.0 or parts.max() >= count:
        return False
    steps = np.diff(seconds - seconds[0] + parts / count)
    usual, over = float(np.median(steps)), np.diff(seconds) > 0.0
    return (
        FASTEST <= usual <= SLOWEST
        and bool((steps < 0.0).sum() <= DISORDER * len(steps))
        and (not over.any() or float(np.median(steps[over])) <= SKIPPED * usual)
    )


def _summed_stamp(recording: Recording, whole: str, part: str, unit: str) -> Read:
    """The time as the sum of two columns, from the first second on: a float has no digits for seconds since 1970."""
    seconds, parts = recording.columns[whole], recording.columns[part]
    first = int(seconds[np.isfinite(seconds)][0])
    since = f" - {first}" if first > 0 else f" + {-first}" if first else ""
    text = f"{quoted(whole)}{since} + {quoted(part)}{FACTORS[unit]}"
    time = seconds - first + parts / PARTS[unit]
    if (np.diff(time[np.isfinite(time)]) < 0.0).any():
        fault = clock_fault(time)
        return Read(text, "s", ASK, fault, f"{quoted(whole)} and {quoted(part)} are the time, but {fault}")
    step = float(np.nanmedian(np.diff(time)))
    return Read(text, "s", SURE, f"whole seconds and {unit} of one stamp, from the first second on, each {step:.4g} s")


def _runs_on(counts: Array, whole: Array) -> bool:
    """Whether a counter goes on over its overflows as it does elsewhere: two recordings in one file do not."""
    steps, over = np.diff(whole), np.diff(counts) < 0.0
    return bool((counts == np.floor(counts)).all()) and float(steps[over].max()) <= SKIPPED * float(np.median(steps))


def _no_clock(recording: Recording, faults: dict[str, str]) -> Clock:
    columns = recording.columns
    period = next((name for name in columns if PERIODS & set(re.findall("[a-z]+", name.lower()))), None)
    period = period or next((name for name in faults if _is_period(name, columns[name])), None)
    if faults.keys() - {period}:
        name, fault = next(iter(faults.items()))
        ask = f"{quoted(name)} says that it is the time, but {fault}; or write another expression, in seconds"
        others = {other: why for other, why in faults.items() if other != name}
        return Clock("", Read(quoted(name), "?", ASK, fault, ask), others)
    if period:
        return Clock(period, _summed(period, columns[period]))
    if read := _counted(recording.facts):
        return Clock(ROW, read)
    ask = (
        "which column is the time? None runs on in steps of a sample period. Write its expression, in seconds; "
        f"where the file has none, {ROW}/<samples a second>"
    )
    return Clock("", Read(f"{ROW}/100", "?", ASK, "100 Hz is a guess", ask))


def _is_period(name: str, values: Array) -> bool:
    """Whether a duration is that of one cycle, as control loops are given it."""
    known = values[np.isfinite(values)]
    usual = float(np.median(known)) if len(known) else 0.0
    units = [unit for unit in ("s", "ms", "us") if FASTEST <= usual * CLOCKS[unit] <= SLOWEST]
    return "duration" in name.lower() and bool(units) and bool((known >= 0.0).all() and known.max() < 100.0 * usual)


def _counted(facts: Mapping[str, float | str]) -> Read | None:
    """The time by the number of the sample, where a single number of the file is its period or rate."""
    for name, value in facts.items():
        rate = bool(RATE.fullmatch(name))
        if isinstance(value, str) or not value > 0.0 or not (rate or STEP.fullmatch(name)):
            continue
        known = measures(said(name).unit, "time")
        period = 1.0 / value if rate else value * (known.factor if known else 1.0)
        if FASTEST <= period <= SLOWEST:
            text = f"{ROW}/{quoted(name)}" if rate else f"{ROW}*{quoted(name)}{known.behind if known else ''}"
            return Read(text, "s", LIKELY, f"there is no clock, and {name} is {value:g}: {1.0 / period:.4g} Hz")
    return None


def _summed(name: str, periods: Array) -> Read:
    """The time as the sum of the sample periods in a column."""
    period, spoken = float(np.nanmedian(periods)), said(name).unit
    units = [unit for unit in ("s", "ms", "us") if FASTEST <= period * CLOCKS[unit] <= SLOWEST]
    known = measures(spoken, "time")
    unit = spoken if known and FASTEST <= period * known.factor <= SLOWEST else next(iter(units), "s")
    text = f"cumsum({quoted(name)}){known.behind if known and unit == spoken else FACTORS[unit]}"
    ask = f"is {quoted(name)} the time from one sample to the next, in {unit}?"
    return Read(text, unit, SURE if spoken == unit else ASK, f"sum of the sample periods, {period:.4g} {unit}", ask)


def _spoken(recording: Recording, name: str) -> str:
    return recording.units.get(name) or said(name).unit


def _units(values: Array, spoken: str) -> list[str]:
    """Units in which a column is a clock, with the one that its name says."""
    units = clock_units(values)
    known = measures(spoken, "time")
    if known and spoken not in units and "s" in clock_units(values * known.factor):
        units.append(spoken)
    return units


def _read(recording: Recording, name: str, by_format: bool, sure_of_it: bool) -> Read:
    values, column = recording.columns[name], quoted(name)
    spoken = _spoken(recording, name)
    known, possible = measures(spoken, "time"), _units(values, spoken)
    step = float(f"{np.nanmedian(np.diff(values)):.4g}")
    if known and (spoken in possible or by_format):
        return Read(column + known.behind, spoken, SURE, f"in {spoken}, a sample each {step:g}")
    if known or not possible:
        return Read(column, "?", ASK, f"steps of {step:g} are no sample period in {spoken or 'any unit'}")
    if spoken:
        ask = f"the name says {spoken}, which is no unit of a time: write an expression in seconds"
        return Read(column, "?", ASK, f"{ask.partition(':')[0]}; a sample each {step:g}", ask)
    unit, shown = possible[0], ""
    several = [] if by_format else rivals(step, possible)
    if len(several) > 1:
        found, shown = told(recording, name, several)
        if not found:
            return _several(column, step, several)
        unit = found
    whole = step == 1.0 and unit != "s" and len(np.unique(np.diff(values))) == 1
    why = f"a sample each {step:g} is one of {1.0 / (step * CLOCKS[unit]):.4g} Hz in {unit}"
    if unit == "d":
        why = f"days, as of a spreadsheet, at {1.0 / (step * CLOCKS[unit]):.4g} Hz"
    why += f": {shown}" if shown else ""
    if not whole and sure_of_it:
        return Read(column + FACTORS[unit], unit, LIKELY, why)
    counts = f"; or does it count samples? Then the time is {column}/<samples a second>" if whole else ""
    return Read(
        column + FACTORS[unit], unit, ASK, why, f"is {column} the time, in {unit}? {why[0].upper()}{why[1:]}{counts}"
    )


def _several(column: str, step: float, units: Sequence[str]) -> Read:
    """A clock whose steps are sample periods in more than one unit."""
    rates = " or ".join(f"{1.0 / (step * CLOCKS[unit]):.5g} Hz in {unit}" for unit in units)
    others = ", ".join(f"{column}{FACTORS[unit]} in {unit}" for unit in units[1:])
    ask = (
        f"in which unit is {column}? No name says it, and a sample each {step:g} is one of {rates}: the line is right "
        f"in {units[0]}, else write {others}"
    )
    return Read(column + FACTORS[units[0]], units[0], ASK, f"a sample each {step:g} is one of {rates}", ask)


def clock_fault(values: Array) -> str:
    """Why a column that should be a clock is none, and what to do."""
    known = values[np.isfinite(values)]
    steps = np.diff(known)
    if not len(steps) or not steps.any():
        return NEVER
    if (steps <= 0.0).all():
        return f"it runs backwards, from {known[0]:g} to {known[-1]:g}: turn the order of the rows round"
    if (steps < 0.0).any():
        return _jumps(known, np.flatnonzero(np.isfinite(values))[np.flatnonzero(steps < 0.0) + 1], steps)
    if np.median(steps) == 0.0:
        each = len(known) / len(np.unique(known))
        if (known == np.round(known)).all():
            return f"it repeats, {each:.3g} rows have the same stamp: export it with fractions of a second"
        return (
            f"it repeats, {each:.3g} rows have the same stamp: of a row for each joint make a column for each "
            "joint, one row a sample"
        )
    return f"its steps of {np.median(steps):.4g} are no sample period in s, ms, us or ns"


def _jumps(known: Array, rows: np.ndarray, steps: Array) -> str:
    """What to do with a clock that jumps back: several recordings in one file, or rows in no order.

    Args:
        known: stamps that there are.
        rows: first one behind each jump, counted from 0.
        steps: between the stamps.
    """
    at = int(np.argmax(steps < 0.0))
    where = f"it jumps back in row {rows[0] + 1}, from {known[at]:g} to {known[at + 1]:g}"
    if len(rows) > DISORDER * len(known):
        return f"{where}, and in {len(rows)} rows in all: put the rows into their order, or record again"
    if len(rows) > 1:
        further = ", ".join(str(row + 1) for row in rows[1:4])
        return f"{where}, and again in row {further}: there recordings end and begin, so part the file at these rows"
    return (
        f"{where}: there one recording ends and the next begins, so part the file, or import it twice, with the line "
        f"`where: {rows[0]} - {ROW}` in one mapping and `where: {ROW} - {rows[0] - 1}` in the other"
    )
