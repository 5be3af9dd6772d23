"""Where the fit of a delay starts and ends, where the response has steps of its own.

Along a measured motion a drive is judged at the samples, so that a command which is late by less than a sample changes
nothing: between these steps a fit has no slope to follow. The goal of a sample acts a delay after the sample's time,
so all delays beyond ``k`` periods, up to ``k + 1``, are first seen ``k + 1`` samples later and are one to the data.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..causes.cause import Cause
from ..log.parts import FIT_A, FIT_B
from ..replay.driven import DrivenProblem
from ..replay.parameters import Parameter
from ..replay.problem import Problem, periods_of
from .fit import Fit
from .settings import DEFAULT, SearchSettings
from .sketch import sketch

DELAY = "drive.delay"
MOST = 0.1  # [s] beyond what is believed: no servo on a bus is later
POINTS = 40
SAME = 0.01  # in squared noise floors: losses that differ by less are one
HALVINGS = 12  # of the way to where the loss is another
MOST_STEPS = 40  # of a sample each, from where a fit ended


def at_samples(problem: Problem) -> bool:
    """Whether what is judged follows commands at the samples only: a motor that moves as its link was measured to."""
    return isinstance(problem, DrivenProblem) and not any(model.chain.gives() for model in problem.models)


def with_centred_times(problem: Problem, parameters: Sequence[Parameter], found: Fit) -> Fit:
    """A fit whose delays and periods are in the middle of the range over which the data cannot tell one from another.

    Where the response goes from sample to sample, a fit ends anywhere in that range. A range that holds what is
    believed has nothing to be told.

    Args:
        problem: that was fitted.
        parameters: of the fit.
        found: the fit.
    """
    times = [p for p in parameters if p.unit == "s" and p.path in found.values]
    if not times or not at_samples(problem):
        return found
    periods = periods_of(problem)
    values, cost = dict(found.values), found.cost
    for p in times:

        def losses(tried: Sequence[float], path: str = p.path) -> np.ndarray:
            simulated = problem.simulate([{**values, path: seconds} for seconds in tried])
            return np.array([problem.block_errors(one).sum() for one in simulated])

        at, loss = _descended(losses, values[p.path], (p.low, p.high), min(periods))
        cost = loss / problem.blocks()[1].sum()
        low, high = _alike(losses, at, loss, (max(at - max(periods), p.low), min(at + max(periods), p.high)))
        values[p.path] = at if low <= p.neutral(problem.models[0]) <= high else 0.5 * (low + high)
    if values == found.values:
        return found
    return replace(found, values=values, cost=cost, simulated=problem.simulate([values])[0])


def _descended(
    losses: Callable[[Sequence[float]], np.ndarray], at: float, bounds: tuple[float, float], period: float
) -> tuple[float, float]:
    """Where no sample earlier or later is better, and the loss there; a fit may end a step of the response away."""
    least = float(losses([at])[0])
    for _ in range(MOST_STEPS):
        tried = [min(max(at + step * period, bounds[0]), bounds[1]) for step in (-1.0, 1.0)]
        found = losses(tried)
        best = int(found.argmin())
        if found[best] > least - SAME:
            break
        at, least = tried[best], float(found[best])
    return at, least


def _alike(
    losses: Callable[[Sequence[float]], np.ndarray], at: float, loss: float, reach: tuple[float, float]
) -> tuple[float, float]:
    """Ends of the range about a value, within a reach, over which the loss is the same."""
    inside, outside = [at, at], list(reach)
    for k, other in enumerate(losses(outside)):
        if abs(other - loss) < SAME:
            inside[k] = outside[k]
    for _ in range(HALVINGS):
        halfway = [0.5 * (a + b) for a, b in zip(inside, outside, strict=True)]
        for k, other in enumerate(losses(halfway)):
            (inside if abs(other - loss) < SAME else outside)[k] = halfway[k]
    return inside[0], inside[1]


def with_started_delays(problem: Problem, causes: Sequence[Cause], settings: SearchSettings = DEFAULT) -> list[Cause]:
    """Causes of which a delay starts where one of a grid fits best; it is tried first.

    A duty or current that is read once a sample jumps a sample later, so that between two of them a fit finds a minimum
    of its own: 25 ms were told as 12, and what else delays a motion was named.

    Args:
        problem: the joint's.
        causes: to be sought.
        settings: of the search.
    """
    found = list(causes)
    at = next((k for k, cause in enumerate(found) if cause.name == DELAY), None)
    if at is None:
        return found
    ((first, *_), *_) = found[at].variants
    fitted = sketch(problem.part(FIT_A, FIT_B), settings.sketched)
    believed = problem.models[0].value(first.number)
    period = float(np.median(np.diff(fitted.time)))
    step = max(0.5 * period, MOST / POINTS)
    tried = [believed + k * step for k in range(int(MOST / step) + 1)]
    errors = [
        float(fitted.block_errors(simulated).sum())
        for simulated in fitted.simulate([{first.path: seconds} for seconds in tried])
    ]
    start = max(tried[int(np.argmin(errors))], believed + 0.25 * step)
    # a slope, and with it an interval, is over more than one step of the response
    wider = max(first.difference, 1.5 * period / first.scale) if at_samples(problem) else first.difference
    variants = [(replace(p, difference=wider), *rest) for p, *rest in found[at].variants]
    started = (replace(first, start=start, difference=wider),)
    found[at] = replace(found[at], variants=(started, *variants) if at_samples(problem) else (*variants, started))
    return found
