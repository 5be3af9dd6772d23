"""Least squares on simulated residuals.

Bounds, batched finite differences, and intervals that know errors are not independent.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from ..replay.parameters import Parameter
from ..replay.problem import Problem
from ..replay.robust import robust_loss, robust_weight

MOST_SAMPLES = 30_000
CONVERGED = 5e-4  # relative improvement of the cost below which a fit ends
TRIED = (0.1, 1.0, 20.0)  # dampings that each iteration tries, relative to the last one
UNLIKELY = 3.84  # rise of the cost, in squared noise floors, that a true value exceeds in 5 % of cases
CLOCK = 0.03  # of a sample period: what all time stamps are late or early by
LONGEST = 10.0  # step of a parameter in one iteration, in units of its scale


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model.

    Attributes:
        values: parameters by path.
        simulated: channels of the problem it was fitted on (n, 4).
        cost: mean loss (:mod:`sealegs.gap.replay.robust`) of the judged samples.
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


def middle(a: Fit, b: Fit) -> dict[str, float]:
    """Values halfway between two fits of the same parameters."""
    return {path: 0.5 * (value + b.values[path]) for path, value in a.values.items()}


def fit(
    problem: Problem,
    parameters: Sequence[Parameter],
    start: Mapping[str, float] | None = None,
    evaluations: int = 12,
) -> Fit:
    """Fit parameters to all judged samples of a problem: Levenberg-Marquardt within bounds, on a robust cost.

    Jacobians are finite differences that are simulated together, and so are the steps of several lengths that each
    iteration tries.

    Args:
        problem: data.
        parameters: what may be turned; others stay nominal.
        start: values to start from, where they differ from the parameters' own.
        evaluations: iterations at most.
    """
    start = dict(start or {})
    if not parameters:
        simulated = problem.simulate([{}])[0]
        return Fit({}, simulated, float(robust_loss(problem.residual(simulated[None])).mean()))
    low = np.array([p.to_fit(p.low) for p in parameters])
    high = np.array([p.to_fit(p.high) for p in parameters])
    u = np.array([p.to_fit(min(max(start.get(p.path, p.start), p.low), p.high)) for p in parameters])
    reach = np.array([p.difference for p in parameters])
    # a long log does not need each of its samples in a Jacobian
    every = max(int(problem.judged.sum()) // MOST_SAMPLES, 1)

    def values(u: np.ndarray) -> dict[str, float]:
        return {p.path: p.from_fit(x) for p, x in zip(parameters, u, strict=True)}

    def errors(rows: np.ndarray) -> np.ndarray:
        return problem.residual(problem.simulate([values(row) for row in rows]), every)

    here = errors(u[None])[0]
    cost, damping = float(robust_loss(here).sum()), 1e-3
    both_sides = False  # differences to one side are cheaper and carry a fit most of its way
    ahead: np.ndarray | None = None
    for _ in range(evaluations if cost > 0.0 else 0):
        up = np.where(u + reach <= high, reach, -reach)
        if ahead is None:
            ahead = errors(u[None] + np.diag(up))
        if both_sides:
            back = np.where((u - up >= low) & (u - up <= high), up, 0.0)
            jacobian = (ahead - errors(u[None] - np.diag(back))) / (up + back)[:, None]
        else:
            jacobian = (ahead - here) / up[:, None]
        weighted = jacobian * robust_weight(here)
        slope, curvature = weighted @ here, weighted @ jacobian.T
        free = ~(((u <= low + 1e-9) & (slope > 0.0)) | ((u >= high - 1e-9) & (slope < 0.0)))
        improved = 0.0
        for _ in range(1 + both_sides if free.any() else 0):
            trials = np.stack([_step(u, slope, curvature, free, damping * more, low, high) for more in TRIED])
            # ripple in the Jacobian looks like curvature and shortens steps along a valley: also try further
            trials = np.concatenate([trials, np.clip(u + 3.0 * (trials[:1] - u), low, high)])
            tried = errors(trials)
            costs = np.array([float(robust_loss(row).sum()) for row in tried])
            best = int(costs.argmin())
            if costs[best] < cost:
                improved = (cost - costs[best]) / cost
                u, here, cost, ahead = trials[best], tried[best], float(costs[best]), None
                damping = min(max(damping * (*TRIED, 0.1)[best], 1e-7), 1e6)
                break
            damping *= 400.0
        if improved < CONVERGED:
            if both_sides:
                break
            both_sides, damping = True, 1e-3
    best_values = values(u)
    simulated = problem.simulate([best_values])[0]
    edge = 1e-3 * (high - low)
    at_bound = tuple(p.path for k, p in enumerate(parameters) if min(u[k] - low[k], high[k] - u[k]) < edge[k])
    return Fit(best_values, simulated, float(robust_loss(problem.residual(simulated[None])).mean()), at_bound)


def _step(
    u: np.ndarray,
    slope: np.ndarray,
    curvature: np.ndarray,
    free: np.ndarray,
    damping: float,
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:
    """Where a damped Gauss-Newton step from ``u`` ends.

    Parameters that it would push over a bound stop there and the rest is solved again.
    """
    free, end = free.copy(), u.copy()
    for _ in range(3):
        index = np.flatnonzero(free)
        if len(index) == 0:
            break
        matrix = curvature[np.ix_(index, index)].copy()
        diagonal = np.diag(matrix).copy()
        matrix[np.diag_indices(len(index))] += damping * diagonal + 1e-9 * diagonal.max() + 1e-12
        fixed = np.flatnonzero(~free)
        right = slope[index] + curvature[np.ix_(index, fixed)] @ (end[fixed] - u[fixed])
        step = np.clip(-np.linalg.solve(matrix, right), -LONGEST, LONGEST)
        end[index] = np.clip(u[index] + step, low[index], high[index])
        over = (u[index] + step < low[index]) | (u[index] + step > high[index])
        if not over.any():
            break
        free[index[over]] = False
    return end


def intervals(
    problem: Problem,
    parameters: Sequence[Parameter],
    found: Fit,
    seed: int = 0,
    halves: Sequence[Fit] = (),
    draws: int = 2000,
) -> dict[str, tuple[float, float]]:
    """95 % intervals of fitted parameters.

    How far each parameter can go while the others make up for it within their bounds, how far parts of the data
    disagree, and a systematic part.

    A number that only a tolerance holds, such as an armature beside a load's inertia, so widens the interval of what
    it can stand in for. Errors are not independent: by how much they scatter the cost more than independent ones
    would is taken from a bootstrap over blocks of data. And no resampling shows what all data share: calibration of
    the columns, the clock of the log, steps of the simulation.

    Args:
        halves: fits of the same parameters to two parts of the data.
    """
    if not parameters:
        return {}
    u = np.array([p.to_fit(found.values[p.path]) for p in parameters])
    low = np.array([p.to_fit(p.low) for p in parameters])
    high = np.array([p.to_fit(p.high) for p in parameters])
    reach = np.diag([p.difference for p in parameters])
    up, down = (
        np.minimum(u[None] + reach, high),
        np.maximum(u[None] - reach, low),
    )
    rows = [{p.path: p.from_fit(x) for p, x in zip(parameters, row, strict=True)} for row in np.concatenate([up, down])]
    errors = problem.residual(problem.simulate(rows))
    spans = np.maximum(np.diag(up) - np.diag(down), 1e-9)
    jacobian = ((errors[: len(u)] - errors[len(u) :]) / spans[:, None]).T
    residual = problem.residual(found.simulated[None])[0]
    block, sizes = problem.blocks()
    count = len(sizes)
    weight = robust_weight(residual)
    scores = np.stack([np.bincount(block, jacobian[:, k] * residual * weight, count) for k in range(len(u))], axis=1)
    curvature = (jacobian * weight[:, None]).T @ jacobian
    weights = np.random.default_rng(seed).multinomial(count, np.full(count, 1.0 / count), draws).astype(float)
    # how far resampling the blocks scatters the cost, in parts of what independent errors would do
    ridge = 1e-9 * np.trace(curvature) * np.eye(len(u))
    moves = (weights - 1.0) @ scores
    dependent = max(
        float(np.mean(np.einsum("dk,kj,dj->d", moves, np.linalg.inv(curvature + ridge), moves))) / len(u), 1.0
    )
    lows, highs = _reach(u, scores.sum(axis=0), curvature + ridge, low, high, UNLIKELY * dependent)
    found_intervals = {}
    period = float(np.median(np.diff(problem.time[: problem.starts[1]])))
    for k, p in enumerate(parameters):
        value, least, most = (p.from_fit(x) for x in (u[k], lows[k], highs[k]))
        values = [fit.values[p.path] for fit in halves if p.path in fit.values]
        shared = CLOCK * period if p.unit == "s" else problem.doubt(p.path) * abs(value)
        wide = float(np.linalg.norm([0.5 * (most - least), max(values) - min(values) if values else 0.0, shared]))
        found_intervals[p.path] = (max(min(least, value - wide), p.low), min(max(most, value + wide), p.high))
    return found_intervals


def _reach(
    u: np.ndarray, slope: np.ndarray, curvature: np.ndarray, low: np.ndarray, high: np.ndarray, rise: float
) -> tuple[np.ndarray, np.ndarray]:
    """Ends of each parameter (p,), (p,) up to which the cost, quadratic about ``u``, can stay within ``rise`` of it.

    The others move freely within their bounds.
    """
    root = np.linalg.cholesky(curvature).T
    target = -np.linalg.solve(root.T, slope)

    def cost(k: int, move: float) -> float:
        """Least rise of the cost with parameter ``k`` moved."""
        rest = np.arange(len(u)) != k
        wanted = target - root[:, k] * move
        if not rest.any():
            return float(wanted @ wanted - target @ target)
        bounds = (np.minimum(low[rest] - u[rest], -1e-9), np.maximum(high[rest] - u[rest], 1e-9))
        best = lsq_linear(root[:, rest], wanted, bounds, method="bvls").x
        error = root[:, rest] @ best - wanted
        return float(error @ error - target @ target)

    ends = np.empty((2, len(u)))
    for k in range(len(u)):
        for side, bound in enumerate((low[k], high[k])):
            inside, outside = 0.0, bound - u[k]
            if abs(outside) > 1e-9 and cost(k, outside) > rise:
                for _ in range(30):
                    middle_way = 0.5 * (inside + outside)
                    inside, outside = (inside, middle_way) if cost(k, middle_way) > rise else (middle_way, outside)
                outside = inside
            ends[side, k] = u[k] + outside
    return ends[0], ends[1]
