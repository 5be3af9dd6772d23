"""Where what is left of an error is: at an angle, a goal, a direction, in a run, at rest or in motion, at a limit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..replay.problem import Problem
from .settings import DEFAULT, SearchSettings

BINS = 12  # of an angle's range
WINDOW = 0.25  # [s] errors closer than this are one event


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
    best, told = settings.place_lift, ""
    for words, rows in _places(problem, simulated, settings):
        held, time = float(size[rows & good].sum()) / total, float((rows & good).sum()) / count
        if held > settings.place_error and time > 0.0 and held / time > best:
            best, told = held / time, f"{100 * held:.0f} % of it {words}, in {100 * time:.0f} % of the time"
    return told or _events(problem, size, good, settings)


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
    unit = unit if name == "position" else "rad"
    command = unit if problem.joint is None or not problem.joint.models[0].by_torque else {"rad": "N.m", "m": "N"}[unit]
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
