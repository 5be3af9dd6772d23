"""Least squares on simulated residuals: bounds, batched finite differences, and intervals that know errors are not independent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from gap.parameters import Parameter
from gap.problem import Problem

DIFFERENCE = (
    0.04  # finite-difference step in units of a parameter's scale: above the ripple of ticks, below its curvature
)
MOST_SAMPLES = 30_000
ROBUST = 6.0  # errors beyond this many noise floors count linearly, so that one jam does not steer a fit


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model.

    Attributes:
        values: parameters by path.
        simulated: channels of the problem it was fitted on (n, 4).
        cost: mean squared weighted error on the fitted samples.
        at_bound: paths that ended at a bound.
    """

    values: dict[str, float]
    simulated: np.ndarray
    cost: float
    at_bound: tuple[str, ...] = ()


def merge(*groups: Sequence[Parameter]) -> list[Parameter]:
    """Parameters by path, a later group's bounds in place of an earlier one's."""
    table: dict[str, Parameter] = {}
    for group in groups:
        for parameter in group:
            table[parameter.path.rstrip("*")] = parameter
    return list(table.values())


def fit(
    problem: Problem,
    parameters: Sequence[Parameter],
    start: Mapping[str, float] | None = None,
    evaluations: int = 10,
) -> Fit:
    """Fit parameters to all judged samples of a problem.

    Args:
        problem: data.
        parameters: what may be turned; others stay nominal.
        start: values to start from, where they differ from the parameters' own.
        evaluations: of the residual, at most (each with one Jacobian).
    """
    start = dict(start or {})
    if not parameters:
        simulated = problem.simulate([{}])[0]
        return Fit({}, simulated, float(np.mean(problem.residual(simulated[None]) ** 2)))
    low = np.array([p.to_fit(p.low) for p in parameters])
    high = np.array([p.to_fit(p.high) for p in parameters])
    u0 = np.array([p.to_fit(min(max(start.get(p.path, p.start), p.low), p.high)) for p in parameters])
    u0 = np.clip(u0, low + 1e-6, high - 1e-6)
    cache: dict[bytes, np.ndarray] = {}
    every = max(int(problem.judged.sum()) // MOST_SAMPLES, 1)  # a long log does not need each of its samples in a Jacobian

    def values(u: np.ndarray) -> dict[str, float]:
        return {p.path: p.from_fit(x) for p, x in zip(parameters, u, strict=True)}

    def residual(u: np.ndarray) -> np.ndarray:
        simulated = problem.simulate([values(u)])
        cache[u.tobytes()] = simulated[0]
        return problem.residual(simulated, every)[0]

    def jacobian(u: np.ndarray) -> np.ndarray:
        here = problem.residual(cache[u.tobytes()][None], every)[0]
        steps = np.where(u + DIFFERENCE <= high, DIFFERENCE, -DIFFERENCE)
        errors = problem.residual(problem.simulate([values(row) for row in u[None] + np.diag(steps)]), every)
        for key in [key for key in cache if key != u.tobytes()]:
            del cache[key]
        return ((errors - here) / steps[:, None]).T

    result = least_squares(
        residual,
        u0,
        jac=jacobian,
        bounds=(low, high),
        loss="soft_l1",
        f_scale=ROBUST,
        max_nfev=evaluations,
        ftol=1e-3,
        xtol=1e-3,
        tr_solver="lsmr",  # a tall thin Jacobian: no need for its singular vectors at every step
    )
    best = values(result.x)
    simulated = problem.simulate([best])[0]
    edge = 1e-3 * (high - low)
    at_bound = tuple(p.path for k, p in enumerate(parameters) if min(result.x[k] - low[k], high[k] - result.x[k]) < edge[k])
    return Fit(best, simulated, float(np.mean(problem.residual(simulated[None]) ** 2)), at_bound)


def intervals(
    problem: Problem, parameters: Sequence[Parameter], found: Fit, seed: int = 0, draws: int = 400
) -> dict[str, tuple[float, float]]:
    """95 % intervals of fitted parameters by a bootstrap over blocks of data.

    Each draw re-weights the blocks and takes one Gauss-Newton step from the fit, so correlated errors widen the interval as they should.
    """
    if not parameters:
        return {}
    u = np.array([p.to_fit(found.values[p.path]) for p in parameters])
    low = np.array([p.to_fit(p.low) for p in parameters])
    high = np.array([p.to_fit(p.high) for p in parameters])
    up, down = (
        np.minimum(u[None] + DIFFERENCE * np.eye(len(u)), high),
        np.maximum(u[None] - DIFFERENCE * np.eye(len(u)), low),
    )
    rows = [{p.path: p.from_fit(x) for p, x in zip(parameters, row, strict=True)} for row in np.concatenate([up, down])]
    errors = problem.residual(problem.simulate(rows))
    spans = np.maximum(np.diag(up) - np.diag(down), 1e-9)
    jacobian = ((errors[: len(u)] - errors[len(u) :]) / spans[:, None]).T
    residual = problem.residual(found.simulated[None])[0]
    block, sizes = problem.blocks()
    count = len(sizes)
    squares = np.zeros((count, len(u), len(u)))
    slopes = np.zeros((count, len(u)))
    weight = 1.0 / np.sqrt(1.0 + (residual / ROBUST) ** 2)
    for k in range(len(u)):
        slopes[:, k] = np.bincount(block, jacobian[:, k] * residual * weight, count)
        for j in range(len(u)):
            squares[:, k, j] = np.bincount(block, jacobian[:, k] * jacobian[:, j] * weight, count)
    rng = np.random.default_rng(seed)
    weights = rng.multinomial(count, np.full(count, 1.0 / count), draws).astype(float)
    ridge = 1e-9 * np.eye(len(u)) * np.trace(squares.sum(axis=0))
    moved = np.array(
        [u - np.linalg.lstsq(np.tensordot(w, squares, 1) + ridge, w @ slopes, rcond=None)[0] for w in weights]
    )
    moved = np.clip(moved, low, high)
    lows, highs = np.percentile(moved, [2.5, 97.5], axis=0)
    found_intervals = {}
    for k, p in enumerate(parameters):
        # the step of one draw is a linear guess: never narrower than it, always around the value
        found_intervals[p.path] = (p.from_fit(min(lows[k], u[k])), p.from_fit(max(highs[k], u[k])))
    return found_intervals
