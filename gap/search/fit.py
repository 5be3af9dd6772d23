"""Robust least squares on simulated residuals, within bounds, with finite differences that are simulated together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..replay.comparison import robust_loss, robust_weight
from ..replay.parameters import Parameter
from ..replay.problem import Problem
from .bounded import damped_step, may_turn
from .journal import recalled, recorded
from .several import CONVERGED, DAMPING, LEAST, MOST, STIFFER, TRIED, JointByJoint, Several

MOST_SAMPLES = 30_000


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model.

    Attributes:
        values: parameters by path.
        simulated: channels of the problem it was fitted on (n, 4).
        cost: mean loss (:mod:`sealegs.gap.replay.comparison`) of the judged samples.
        at_bound: paths that ended at a bound.
    """

    values: dict[str, float]
    simulated: np.ndarray
    cost: float
    at_bound: tuple[str, ...] = ()


def merge(*groups: Sequence[Parameter]) -> list[Parameter]:
    """Parameters by number, a later group's bounds in place of an earlier one's."""
    table: dict[str, Parameter] = {}
    for group in groups:
        for parameter in group:
            table[parameter.number] = parameter
    return list(table.values())


def middle(a: Fit, b: Fit) -> dict[str, float]:
    """Values halfway between two fits of the same parameters."""
    return {path: 0.5 * (value + b.values[path]) for path, value in a.values.items()}


def errors_at(problem: Problem, parameters: Sequence[Parameter], points: np.ndarray, every: int = 1) -> np.ndarray:
    """Weighted errors (v, m) of a problem at points (v, p) in the parameters' coordinates, of every so many samples."""
    rows = [{p.path: p.from_fit(x) for p, x in zip(parameters, point, strict=True)} for point in points]
    return problem.residual(problem.simulate(rows), every)


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
    if (known := recalled(problem, parameters, start, evaluations)) is not None:
        return Fit(known["values"], problem.simulate([known["values"]])[0], known["cost"], tuple(known["at_bound"]))
    low = np.array([p.to_fit(p.low) for p in parameters])
    high = np.array([p.to_fit(p.high) for p in parameters])
    u = np.array([p.to_fit(min(max(start.get(p.path, p.start), p.low), p.high)) for p in parameters])
    reach = np.array([p.difference for p in parameters])
    # a long log does not need each of its samples in a Jacobian
    every = max(int(problem.judged.sum()) // MOST_SAMPLES, 1)

    def values(u: np.ndarray) -> dict[str, float]:
        return {p.path: p.from_fit(x) for p, x in zip(parameters, u, strict=True)}

    if isinstance(problem, Several):
        u = JointByJoint(problem, [p.path for p in parameters], values, u, (low, high), reach, every).run(evaluations)
    else:
        u = _descended(problem, parameters, u, low=low, high=high, reach=reach, every=every, evaluations=evaluations)
    best_values = values(u)
    simulated = problem.simulate([best_values])[0]
    edge = 1e-3 * (high - low)
    at_bound = tuple(p.path for k, p in enumerate(parameters) if min(u[k] - low[k], high[k] - u[k]) < edge[k])
    found = Fit(best_values, simulated, float(robust_loss(problem.residual(simulated[None])).mean()), at_bound)
    recorded(problem, parameters, start, evaluations, vars(found))
    return found


def _descended(
    problem: Problem,
    parameters: Sequence[Parameter],
    u: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    reach: np.ndarray,
    every: int,
    evaluations: int,
) -> np.ndarray:
    """Where Levenberg-Marquardt ends (p,), from a start ``u`` within bounds (p,)."""

    def errors(rows: np.ndarray) -> np.ndarray:
        return errors_at(problem, parameters, rows, every)

    here = errors(u[None])[0]
    cost, damping = float(robust_loss(here).sum()), DAMPING
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
        improved = 0.0
        for _ in range(1 + both_sides if may_turn(u, slope, low, high) else 0):
            trials = np.stack([damped_step(u, slope, curvature, damping * more, low, high) for more in TRIED])
            # ripple in the Jacobian looks like curvature and shortens steps along a valley: also try further
            trials = np.concatenate([trials, np.clip(u + 3.0 * (trials[:1] - u), low, high)])
            tried = errors(trials)
            costs = np.array([float(robust_loss(row).sum()) for row in tried])
            best = int(costs.argmin())
            if costs[best] < cost:
                improved = (cost - costs[best]) / cost
                u, here, cost, ahead = trials[best], tried[best], float(costs[best]), None
                damping = min(max(damping * (*TRIED, TRIED[0])[best], LEAST), MOST)
                break
            damping *= STIFFER
        if improved < CONVERGED:
            if both_sides:
                break
            both_sides, damping = True, DAMPING
    return u
