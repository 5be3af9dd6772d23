"""What the further columns of a log are worth beside the position.

Duty, current and link position, each weighted by its own noise.

Position alone cannot tell a late command from a late reading, or a weak motor from a heavy load; the duty and the
current can. But a column may be in a wrong unit, unsigned or of another joint, and the model is never perfect. A
channel counts only if the tuned nominal model roughly predicts it, and no more than its unpredictable part and its
calibration error allow.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np

from ..causes.catalogue import adjustable
from ..checks.signal import typical_noise
from ..log.parts import FIT_A, FIT_B
from ..replay.parameters import address, numbers
from ..replay.problem import JointProblem
from .fit import fit
from .settings import DEFAULT, SearchSettings

DELAY = "delay.seconds"

Joint = TypeVar("Joint", bound=JointProblem)


def weigh_channels(problem: Joint, settings: SearchSettings = DEFAULT) -> Joint:
    """The problem with a weight for each further channel that the model understands; others stay without.

    Only the parts to fit on are looked at.
    """
    fitted = problem.part(FIT_A, FIT_B)
    logged = [
        c for c in range(1, len(problem.channels)) if np.isfinite(fitted.measured[:, c]).mean() > settings.column_logged
    ]
    if not logged:
        return problem
    tuned = fit(fitted, adjustable(problem.models[0]))
    simulated = tuned.simulated
    late = _late_or_early(problem, tuned.values, settings.column_lag)
    weight, reliability = problem.weight.copy(), problem.reliability.copy()
    for c in logged:
        if problem.channels[c] == "link_position":
            weight[c] = 1.0 / typical_noise(fitted.time, fitted.measured[:, c], fitted.starts)
            continue
        measured, predicted = fitted.means(fitted.measured[:, c]), fitted.means(simulated[:, c])
        good = np.isfinite(measured)
        if good.sum() < settings.column_groups or not _agrees(measured[good], predicted[good], settings):
            continue
        noise, timing = _noise(measured, predicted, settings)
        if not np.isfinite(noise):
            continue
        weight[c] = 1.0 / noise
        change = _change(problem.means(problem.measured[:, c]))
        doubt = np.hypot(timing * np.nan_to_num(change), problem.means(late[:, c]))
        share = noise / np.hypot(noise, doubt)
        rows = np.flatnonzero(problem.group >= 0)
        _, number = np.unique(problem.group[rows], return_inverse=True)
        reliability[rows, c] = share[number]
    return replace(problem, weight=weight, reliability=reliability)


def _late_or_early(problem: JointProblem, values: Mapping[str, float], lag: float) -> np.ndarray:
    """How much the channels (n, 4) would differ at each sample if commands took effect a little sooner or later.

    A drive reports what it set last. Where a command takes effect just as a sample is taken, that may be either.
    """
    nominal = problem.models[0]
    path = numbers(values).get(DELAY, DELAY)
    unit = nominal.value(DELAY) if address(path).factor else 1.0
    here = values[path] * unit if path in values else nominal.value(DELAY)
    around = [here + lag, max(here - lag, 0.0)]
    rows = [{**values, path: seconds / unit} for seconds in around]
    later, sooner = problem.simulate(rows)
    return (later - sooner) * lag / (around[0] - around[1])


def _agrees(measured: np.ndarray, predicted: np.ndarray, settings: SearchSettings) -> bool:
    spread = measured.std() * predicted.std()
    if spread == 0.0:
        return False
    correlation = float(np.mean((measured - measured.mean()) * (predicted - predicted.mean())) / spread)
    slope = correlation * measured.std() / predicted.std()
    alike = settings.column_least_slope < slope < settings.column_most_slope
    return correlation > settings.column_agreement and alike


def _change(means: np.ndarray) -> np.ndarray:
    """Change of a channel per group, from its neighbours (g,)."""
    step = np.abs(np.diff(means))
    return np.maximum(np.append(step, 0.0), np.append(0.0, step))


def _noise(measured: np.ndarray, predicted: np.ndarray, settings: SearchSettings) -> tuple[float, float]:
    """Noise of the means of a channel at rest, and the timing error where it changes, in groups.

    Both from second differences of the error, which a slow error of the model hardly enters. Infinite where gaps leave
    too few of them.
    """
    error = measured - predicted
    jump = np.abs(error[:-2] - 2.0 * error[1:-1] + error[2:]) / np.sqrt(6.0)
    change = _change(measured)[1:-1]
    good = np.isfinite(jump) & np.isfinite(change)
    if good.sum() < settings.column_groups:
        return np.inf, 0.0
    jump, change = jump[good], change[good]
    slow = change <= np.median(change)
    fast = change >= np.quantile(change, settings.column_fast)
    still, moving = (np.mean(_trimmed(jump[rows], settings.column_trim) ** 2) for rows in (slow, fast))
    noise = max(float(np.sqrt(still)), settings.column_calibration * float(np.nanstd(measured)), 1e-9)
    timing = float(np.sqrt(moving / max(np.mean(change[fast] ** 2), 1e-18)))
    return noise, min(timing, 1.0)


def _trimmed(values: np.ndarray, most: float) -> np.ndarray:
    return values[values <= np.quantile(values, most)]
