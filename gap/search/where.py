"""Where what is left of an error is: at an angle, a goal, a direction, in a run, at rest or in motion, at a limit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..replay.problem import Problem
from .settings import DEFAULT, SearchSettings

BINS = 12  # of an angle's range
WINDOW = 0.25  # [s] errors closer than this are one event
LASTS = 1.0  # [s] on either side of a shift
RIGHT = 0.3  # of a shift, by which the position may be off on its other side
KEEPS = 0.3  # of the samples of a shift in which the joint moves, where it was without it: a pose that it holds is none


def where(problem: Problem, simulated: np.ndarray, error: np.ndarray, settings: SearchSettings = DEFAULT) -> str:
    """Where most of a squared error (n,) is, for people; whether it comes as events where no place holds most of it.

    Of the places that hold most of it the one is told in which it is densest.

    Args:
        problem: what was replayed.
        simulated: its channels in the model (n, 4).
        error: NaN where it is not judged (n,).
        settings: of the search.
    """
    good = np.isfinite(error)
    size = np.where(good, np.nan_to_num(error) ** 2, 0.0)
    total, count = float(size.sum()), int(good.sum())
    if total <= 0.0 or count == 0:
        return ""
    if shift := _shift(problem, simulated, error, settings):
        return shift
    best, told = settings.place_lift, ""
    for words, rows in _places(problem, simulated, settings):
        held, time = float(size[rows & good].sum()) / total, float((rows & good).sum()) / count
        if held > settings.place_error and time > 0.0 and held / time > best:
            best, told = held / time, f"{100 * held:.0f} % of it {words}, in {100 * time:.0f} % of the time"
    return told or _events(problem, size, good, settings)


def _shift(problem: Problem, simulated: np.ndarray, error: np.ndarray, settings: SearchSettings) -> str:
    """Whether most of an error (n,), in noise floors, is that one run is off by a constant from a moment on, or until
    one, while it goes on moving where it was before.

    Not where nothing holds the replay near the log: any small error adds up to such a shift there, and the next piece,
    which begins where the log is, knows of no slip.
    """
    speed = problem.covariates(simulated).get("speed")
    if speed is None or problem.open_loop or problem.signal[0] != "position":
        return ""
    runs = np.repeat([unit.run for unit in problem.units], np.diff(problem.starts))
    total = float(np.nansum(error**2))
    moving = np.abs(speed) > settings.at_rest_speed * float(np.nanquantile(np.abs(speed), 0.99))
    for run in np.unique(runs):
        rows = np.flatnonzero((runs == run) & np.isfinite(error))
        rows = rows[np.argsort(problem.time[rows], kind="stable")]
        time, values = problem.time[rows], error[rows]
        splits = np.searchsorted(time, np.arange(time[0] + LASTS, time[-1] - LASTS, WINDOW)) if len(rows) else []
        if len(splits) == 0:
            continue
        k = max(map(int, splits), key=lambda k: _between(values, k))
        late = abs(values[k:].mean()) > abs(values[:k].mean())
        one, rest = (slice(k, None), slice(k)) if late else (slice(k), slice(k, None))
        off = float(values[one].mean())
        share = len(values[one]) * off**2 / total
        parted = _between(values, k) / max(float(np.var(values)) * len(values), 1e-300)
        if min(share, parted) <= settings.place_error or abs(values[rest].mean()) > RIGHT * abs(off):
            continue
        position, away = problem.measured[rows, 0], abs(off) * problem.noise
        low, high = np.quantile(position[rest], [0.02, 0.98])
        there = (position[one] > low - away) & (position[one] < high + away)
        if (there & moving[rows[one]]).mean() > KEEPS:
            when = f"from {time[k]:.3g} s on" if late else f"until {time[k]:.3g} s"
            return (
                f"{100 * share:.0f} % of it is a shift in run {run + 1}: {when} the position is off by "
                f"{-1e3 * off * problem.noise:.3g} m{problem.signal[1]}, as by a slip, lost steps or a new zero"
            )
    return ""


def _between(values: np.ndarray, k: int) -> float:
    """What two means instead of one take of the squares of values (n,) that are parted at ``k``."""
    return k * (len(values) - k) / len(values) * float(values[:k].mean() - values[k:].mean()) ** 2


def _events(problem: Problem, size: np.ndarray, good: np.ndarray, settings: SearchSettings) -> str:
    """Whether few moments hold most of it."""
    window = np.floor(problem.time / WINDOW).astype(int)
    unit = np.repeat(np.arange(len(problem.units)), np.diff(problem.starts))
    _, number = np.unique(unit * (int(window.max()) + 1) + window, return_inverse=True)
    held = np.bincount(number[good], size[good])[np.bincount(number[good]) > 0]
    held = np.sort(held)[::-1]
    few = max(int(settings.few_moments * len(held)), 1)
    if held[:few].sum() > settings.place_error * held.sum():
        return "it comes in few moments and follows none of the logged signals, as events at random times would"
    return "it is spread over the whole log"


def _places(problem: Problem, simulated: np.ndarray, settings: SearchSettings) -> Iterator[tuple[str, np.ndarray]]:
    """Words, and the samples that they mean (n,)."""
    signals = problem.covariates(simulated)
    if not signals:
        return
    runs = np.repeat([unit.run for unit in problem.units], np.diff(problem.starts))
    for run in np.unique(runs) if len(np.unique(runs)) > 2 else ():
        yield f"in run {run + 1}", runs == run
    name, unit = problem.signal
    position = problem.measured[:, 0] if name == "position" else signals["position"]
    if name != "position":
        unit = "rad" if problem.joint is None else problem.joint.models[0].axis.unit("rad")
    told = "goal" if problem.joint is None else problem.joint.models[0].command
    command = {"goal": unit, "goal_velocity": f"{unit}/s"}.get(told, {"rad": "N.m", "m": "N"}[unit])
    places = (("at angles" if unit == "rad" else "at places", unit, position), ("at goals", command, signals["goal"]))
    for name, unit, values in places:
        finite = values[np.isfinite(values)]
        if len(finite) == 0 or np.ptp(finite) == 0.0:
            continue
        edges = np.linspace(finite.min(), finite.max(), BINS + 1)
        for k in range(BINS - 1):  # two bins at a time: a place may lie on an edge
            low, high = edges[k], edges[k + 2]
            yield f"{name} from {low:.3g} to {high:.3g} {unit}", (values >= low) & (values <= high)
    speed = signals["speed"]
    slow = settings.at_rest_speed * float(np.nanquantile(np.abs(speed), 0.99))
    yield "at rest", np.abs(speed) <= slow
    yield "in motion", np.abs(speed) > slow
    yield "while moving up", speed > slow
    yield "while moving down", speed < -slow
    duty = np.abs(signals["duty"])
    if np.isfinite(duty).any() and np.nanmax(duty) > 0.0:
        yield "with the duty at its limit", duty >= settings.at_duty_limit * np.nanmax(duty)
