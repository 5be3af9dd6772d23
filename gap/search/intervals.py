"""Intervals of fitted parameters: profile likelihood, with a block bootstrap for errors that are not independent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..checks.signal import block_weights
from ..replay.comparison import robust_weight
from ..replay.parameters import Parameter
from ..replay.problem import Problem, periods_of
from .alike import inertia_room
from .axes import UNLIKELY, along_axes
from .bounded import FLAT, nearest_within, root_of, solved
from .delays import at_samples
from .fit import Fit, errors_at
from .stamps import moved_by_late_columns, over_a_step, seconds_of
from .torque_gauge import is_torque, room


def intervals(
    problem: Problem,
    parameters: Sequence[Parameter],
    found: Fit,
    seed: int = 0,
    halves: Sequence[Fit] = (),
    draws: int = 2000,
) -> dict[str, tuple[float, float]]:
    """95 % profile-likelihood intervals, widened for autocorrelated errors by a block bootstrap.

    Nuisance parameters move within their bounds: an armature that only its tolerance holds widens the interval of a
    load's inertia, exactly so (:mod:`.alike`). What the log leaves open of all torques together
    (:mod:`.torque_gauge`) widens theirs. Three terms are added in quadrature: how far the fits of the two parts of
    the data disagree, the systematic error that all data share (calibration of the columns, discretisation error), and
    how far columns that are read a little late move a number (:mod:`.stamps`). Where what is judged goes from sample to
    sample (:func:`.delays.at_samples`), a time is not told more closely than half a sample either way.

    Args:
        halves: fits of the same parameters to two parts of the data.
    """
    if not parameters:
        return {}
    near = linearised(problem, parameters, found)
    u, low, high, curvature = near.u, near.low, near.high, near.curvature
    rises = UNLIKELY * near.inflation(seed, draws)
    lows, highs = _reach(u, near.slope, curvature, low, high, rises)
    moved = moved_by_late_columns(problem, found.values, found.simulated, near.jacobian, curvature, (low - u, high - u))
    found_intervals = {}
    smaller, larger = room(problem, parameters, found.values)
    alike = inertia_room(problem, parameters, found.values, (smaller, larger))
    period = max(periods_of(problem))
    for k, p in enumerate(parameters):
        value, least, most = (p.from_fit(x) for x in (u[k], lows[k], highs[k]))
        if is_torque(p):
            least, most = min(least, value * smaller, value * larger), max(most, value * smaller, value * larger)
        values = [fit.values[p.path] for fit in halves if p.path in fit.values]
        second = seconds_of(p, problem)
        shared = problem.clock / second if second else problem.systematic_error(p.path) * abs(value)
        late = 0.5 * abs(p.from_fit(u[k] + moved[k]) - p.from_fit(u[k] - moved[k]))
        apart = max(values) - min(values) if values else 0.0
        wide = float(np.linalg.norm([0.5 * (most - least), apart, shared, late]))
        least, most = min(least, value - wide), max(most, value + wide)
        if p.path in alike:
            least, most = min(least, alike[p.path][0]), max(most, alike[p.path][1])
        if second and at_samples(problem):
            least, most = over_a_step(value, (least, most), period, p, p.neutral(problem.models[0]), second)
        found_intervals[p.path] = (max(least, p.low), min(most, p.high))
    return found_intervals


@dataclass(frozen=True, eq=False)
class Linearised:
    """A fit's residual as a straight line in its parameters, in the coordinates of the fit.

    Attributes:
        u: where the parameters are (p,); ``low``, ``high`` are their bounds.
        jacobian: of the residual, each sample with its robust weight (n, p).
        scores: slope of the cost, block by block (b, p).
        curvature: of the cost (p, p).
    """

    u: np.ndarray
    low: np.ndarray
    high: np.ndarray
    jacobian: np.ndarray
    scores: np.ndarray
    curvature: np.ndarray

    @property
    def slope(self) -> np.ndarray:
        """Of the cost (p,)."""
        return self.scores.sum(axis=0)

    def inflation(self, seed: int, draws: int) -> np.ndarray:
        """By how much the variance of each parameter (p,) is more than that of independent errors, by a block
        bootstrap."""
        weights = block_weights(len(self.scores), draws, np.random.default_rng(seed))
        return inflation(self.curvature, (weights - 1.0) @ self.scores)

    def correlation(self) -> np.ndarray:
        """Of the parameters' errors (p, p), each of them known beforehand to lie within its bounds."""
        believed = np.diag(12.0 / np.maximum(self.high - self.low, FLAT) ** 2)  # as wide as a uniform number
        covariance = solved(self.curvature + believed, np.eye(len(self.u)))
        spread = np.sqrt(np.maximum(np.diag(covariance), FLAT))
        return np.clip(covariance / np.outer(spread, spread), -1.0, 1.0)


def linearised(problem: Problem, parameters: Sequence[Parameter], found: Fit) -> Linearised:
    """How the residual of a fit changes with its parameters, by finite differences along the axes of its curvature."""
    u = np.array([p.to_fit(found.values[p.path]) for p in parameters])
    low = np.array([p.to_fit(p.low) for p in parameters])
    high = np.array([p.to_fit(p.high) for p in parameters])
    reach = np.diag([p.difference for p in parameters])
    up, down = (
        np.minimum(u[None] + reach, high),
        np.maximum(u[None] - reach, low),
    )
    errors = partial(errors_at, problem, parameters)
    sides = errors(np.concatenate([up, down]))
    spans = np.maximum(np.diag(up) - np.diag(down), 1e-9)
    residual = problem.residual(found.simulated[None])[0]
    block, sizes = problem.blocks()
    weight = robust_weight(residual)
    by_one = (sides[: len(u)] - sides[len(u) :]) / spans[:, None]
    jacobian = along_axes(errors, u, (low, high), by_one, weight).T
    scores = np.stack([np.bincount(block, slope, len(sizes)) for slope in (jacobian.T * residual * weight)], axis=1)
    weighted = jacobian * weight[:, None]
    curvature = weighted.T @ jacobian
    ridge = max(1e-9 * float(np.trace(curvature)), FLAT) * np.eye(len(u))
    return Linearised(u, low, high, weighted, scores, curvature + ridge)


def inflation(curvature: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """By how much the variance of each parameter (p,) is more than that of independent errors, at least 1.

    Args:
        curvature: of the cost (p, p).
        moves: of its slope, from draw to draw of the resampled blocks (draws, p).
    """
    spread = solved(curvature, moves.T)
    independent = np.diag(solved(curvature, np.eye(len(curvature))))
    return np.maximum(np.mean(spread**2, axis=1) / np.maximum(independent, FLAT), 1.0)


def _reach(
    u: np.ndarray, slope: np.ndarray, curvature: np.ndarray, low: np.ndarray, high: np.ndarray, rises: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the profile of each parameter (p,), (p,): up to where the cost, quadratic about ``u``, rises by its own
    of ``rises`` (p,).

    The nuisance parameters are at their optimum within their bounds.
    """
    root = root_of(curvature)
    target = -solved(root.T, slope)

    def cost(k: int, move: float) -> float:
        """Least rise of the cost with parameter ``k`` moved."""
        rest = np.arange(len(u)) != k
        wanted = target - root[:, k] * move
        if not rest.any():
            return float(wanted @ wanted - target @ target)
        best = nearest_within(root[:, rest], wanted, low[rest] - u[rest], high[rest] - u[rest])
        error = root[:, rest] @ best - wanted
        return float(error @ error - target @ target)

    ends = np.empty((2, len(u)))
    for k in range(len(u)):
        for side, bound in enumerate((low[k], high[k])):
            inside, outside = 0.0, bound - u[k]
            if abs(outside) > 1e-9 and cost(k, outside) > rises[k]:
                for _ in range(30):
                    middle_way = 0.5 * (inside + outside)
                    inside, outside = (inside, middle_way) if cost(k, middle_way) > rises[k] else (middle_way, outside)
                outside = inside
            ends[side, k] = u[k] + outside
    return ends[0], ends[1]
