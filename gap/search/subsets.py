"""The best of all subsets of causes, from one fit of all of them.

About the fit the cost is a quadratic of its parameters, so what each subset of the causes would leave is known without
a replay: the others are put back to where they do nothing, and what stays follows. Far from the fit that is rough. So
the best of each size are fitted, and the quadratic is taken anew about the best of these, until that stays the best.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..causes.cause import Cause, Variant
from ..replay.comparison import robust_loss, robust_weight
from ..replay.parameters import HasNumbers, Parameter
from ..replay.problem import Problem
from .fit import Fit, errors_at, fit, merge

Forms = tuple[tuple[Cause, Variant], ...]

OF_EACH_SIZE = 2  # subsets that are fitted
ITERATIONS = 6  # of a fit that begins near where it ends
ROUNDS = 3
RIDGE = 1e-4  # of the charge of a parameter, for numbers that the data do not show
HOLD = 1e9  # of the same, for numbers that a bound keeps where they are


@dataclass(frozen=True, eq=False)
class Subset:
    """Causes, and the fit with them.

    Attributes:
        forms: the causes, each in the form in which it acts.
        fit: of their parameters and the tuned numbers.
        charged: its cost, with a charge for each parameter.
    """

    forms: Forms
    fit: Fit
    charged: float

    @property
    def keys(self) -> frozenset[str]:
        """Of the causes."""
        return frozenset(cause.key for cause, _ in self.forms)


@dataclass(frozen=True, eq=False)
class Choice:
    """Causes to choose from, over one problem.

    Attributes:
        problem: that is fitted.
        tuned: numbers that are turned whatever is chosen.
        forms: the causes; of the forms of one cause, at most one acts.
        nominal: the model in which none of them acts.
        charge: of each parameter, as a share of the cost.
        open_excess: what may be left beyond the noise, of a cost of 1, before each further cause is a guess.
        gain: share of what is left beyond that which a further cause must remove.
    """

    problem: Problem
    tuned: Sequence[Parameter]
    forms: Forms
    nominal: HasNumbers
    charge: float
    open_excess: float = np.inf
    gain: float = 0.0

    def parameters(self, forms: Forms) -> list[Parameter]:
        """What a fit with these causes turns."""
        return merge(self.tuned, *(variant for _, variant in forms))

    def subset(self, forms: Forms, fitted: Fit) -> Subset:
        """Causes with their fit and what that costs with them."""
        flexible = np.array([sum(flexibility(*form) for form in forms)])
        cost = self.charged(np.array([fitted.cost]), flexible, np.array([len(forms)]), max(fitted.cost, 1.0))
        return Subset(forms, fitted, float(cost[0]))

    def least(self, forms: Forms, cost: float) -> float:
        """What causes cost with their charge where they fit so well."""
        return self.subset(forms, Fit({}, np.empty(0), cost)).charged

    def charged(self, costs: np.ndarray, flexible: np.ndarray, counts: np.ndarray, level: float) -> np.ndarray:
        """Costs (s,) with a charge for each parameter, and for each further cause that leaves much.

        Args:
            costs: of fits (s,).
            flexible: parameters that they are charged for (s,).
            counts: of their causes (s,).
            level: cost that the charge of a parameter is a share of, at least that of the noise.
        """
        left = np.maximum(costs - 1.0 - self.open_excess, 0.0)
        guessed = left * ((1.0 - self.gain) ** -np.maximum(counts - 1.0, 0.0) - 1.0)
        return costs + self.charge * level * flexible + guessed

    def fitted(self, forms: Forms, values: dict[str, float], iterations: int = ITERATIONS) -> Subset:
        """Causes fitted from some values, of which those that are not turned are left out."""
        parameters = self.parameters(forms)
        start = {p.path: values[p.path] for p in parameters if p.path in values}
        return self.subset(forms, fit(self.problem, parameters, start, iterations))


def forms_of(cause: Cause) -> Forms:
    """What a cause may be among others: the first form of each of the numbers that may be wrong, or of an effect."""
    return tuple((cause, variant) for variant in (cause.forms if cause.error else cause.variants[:1]))


def flexibility(cause: Cause, variant: Variant) -> int:
    """Parameters that a cause is charged for: a missing effect, or another form than the usual, counts as one more."""
    return len(variant) + (not cause.error) + (not cause.is_usual(variant))


def best_subset(choice: Choice, full: Fit, needed: Forms = (), other: Subset | None = None) -> Subset:
    """The subset of the causes whose charged cost is least.

    None with two causes more than the best is fitted that could not be it if it fitted as well as any does.

    Args:
        choice: the causes.
        full: the fit with all of them.
        needed: causes that each subset has.
        other: what it must be better than, and else is what is returned; None: nothing, and nothing is needed.
    """
    known: dict[Forms, Subset] = {}
    choice, least = _acting(choice, full), full.cost
    if not set(needed) <= set(choice.forms):
        assert other is not None  # nothing that is needed does anything
        return other
    last, here = None, replace(full, values={**neutral(choice), **full.values})
    for _ in range(ROUNDS):
        for forms, promise in _foreseen(choice, here, needed):
            if forms in known and promise >= known[forms].charged:
                continue
            least = min([least, *(one.fit.cost for one in known.values())])
            best = _least_charged(known, other)
            # one cause more may leave a local minimum in which the others are
            large = best is not None and len(forms) > len(best.forms) + 1
            if best is not None and large and choice.least(forms, least) >= best.charged:
                continue
            one = choice.fitted(forms, here.values)
            known[forms] = min(known.get(forms, one), one, key=lambda each: each.charged)
        if (best := _least_charged(known)) is None or best.forms == last:
            break
        last, here = best.forms, replace(best.fit, values={**neutral(choice), **best.fit.values})
    found = _least_charged(known, other)
    assert found is not None  # no causes at all are a subset
    return found


def _least_charged(known: Mapping[Forms, Subset], other: Subset | None = None) -> Subset | None:
    """Of fitted subsets the one whose charged cost is least; None: there is none."""
    every = [*known.values(), *([] if other is None else [other])]
    return min(every, key=lambda one: one.charged, default=None)


def _acting(choice: Choice, full: Fit) -> Choice:
    """The causes without which a replay is another: a stop that is nowhere met has no slope, or a false one."""
    still = neutral(choice)
    back = [{**full.values, **{p.path: still[p.path] for p in variant}} for _, variant in choice.forms]
    same = (
        [np.array_equal(row, full.simulated, equal_nan=True) for row in choice.problem.simulate(back)] if back else []
    )
    return replace(choice, forms=tuple(form for form, idle in zip(choice.forms, same, strict=True) if not idle))


def neutral(choice: Choice) -> dict[str, float]:
    """Values at which no cause does anything, as near as the bounds let them."""
    return {p.path: p.from_fit(p.nothing(choice.nominal)) for p in choice.parameters(choice.forms)}


def _foreseen(choice: Choice, here: Fit, needed: Forms = ()) -> list[tuple[Forms, float]]:
    """Subsets that are worth a fit, by the quadratic about one: the best of each size, up to one more than the best.

    Returns:
        Each with its charged cost by the quadratic, the smallest first.
    """
    parameters = choice.parameters(choice.forms)
    optimum, covariance, least = _quadratic(choice, parameters, here)
    place = {p.path: k for k, p in enumerate(parameters)}
    acts = np.zeros((len(choice.forms), len(parameters)), dtype=bool)
    for row, (_, variant) in zip(acts, choice.forms, strict=True):
        row[[place[p.path] for p in variant]] = True
    acts &= np.array([p.is_size for p in parameters])  # without a size, its shape changes nothing
    own = acts.any(axis=0)
    back = (np.array([p.nothing(choice.nominal) for p in parameters]) - optimum)[own]
    covariance, acts = covariance[np.ix_(own, own)], acts[:, own]
    known = {p.number: p for p in choice.tuned}
    slack = np.array([_slack(p, known.get(p.number)) for p in parameters])[own]
    slack /= choice.charge * max(here.cost, 1.0)
    chosen = _subsets(choice.forms)
    chosen = chosen[chosen[:, [form in needed for form in choice.forms]].all(axis=1)]
    costs = (
        np.concatenate([_without(covariance, slack, back, some @ acts) for some in np.array_split(chosen, 64)]) + least
    )
    flexible = chosen @ np.array([flexibility(*form) for form in choice.forms], dtype=float)
    sizes = chosen.sum(axis=1)
    charged = choice.charged(costs, flexible, sizes, max(here.cost, 1.0))
    order = np.argsort(charged, kind="stable")
    picked: list[tuple[Forms, float]] = []
    for size in range(int(sizes[order[0]]) + 2):
        picked += [
            (tuple(itertools.compress(choice.forms, chosen[k])), float(charged[k]))
            for k in order[sizes[order] == size][:OF_EACH_SIZE]
        ]
    return picked


def _subsets(forms: Forms) -> np.ndarray:
    """Which forms each subset has (s, f): at most one of each cause."""
    where: dict[str, list[int]] = {}
    for k, (cause, _) in enumerate(forms):
        where.setdefault(cause.key, [-1]).append(k)
    chosen = np.array(list(itertools.product(*where.values())), dtype=int)
    return (chosen[:, :, None] == np.arange(len(forms))).any(axis=1)


def _slack(p: Parameter, tuned: Parameter | None) -> float:
    """Squared half tolerance of a number that is also tuned, in the coordinate of a cause's; 0 if it is not."""
    if tuned is None or p.path != tuned.path:
        return 0.0
    return (0.5 * (p.to_fit(tuned.high) - p.to_fit(tuned.low))) ** 2


def _without(covariance: np.ndarray, slack: np.ndarray, back: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """By how much costs rise (s,) where the numbers that are not kept (s, q) are put back and all others follow.

    Args:
        covariance: inverse of the curvature (q, q).
        slack: inverse of the curvature of what holds a number that is put back, 0 where nothing moves it (q,).
        back: from the optimum to where the numbers do nothing (q,).
        kept: numbers that stay free (s, q).
    """
    out = ~kept
    systems = np.where(out[:, :, None] & out[:, None, :], covariance + np.diag(slack), np.eye(len(back)))
    moves = np.where(out, back, 0.0)
    return (moves * np.linalg.solve(systems, moves[:, :, None])[:, :, 0]).sum(axis=1)


def _quadratic(choice: Choice, parameters: Sequence[Parameter], here: Fit) -> tuple[np.ndarray, np.ndarray, float]:
    """Optimum (p,) of the quadratic about a fit, the inverse of its curvature (p, p), and its least cost.

    A tuned number at an end of its tolerance costs as much as a parameter does: its bounds as a prior.
    """
    problem, charge = choice.problem, choice.charge * max(here.cost, 1.0)
    u = np.array([p.to_fit(here.values[p.path]) for p in parameters])
    low, high = (np.array([p.to_fit(end(p)) for p in parameters]) for end in (lambda p: p.low, lambda p: p.high))
    reach = np.array([p.difference for p in parameters])
    up, down = np.minimum(reach, high - u), np.minimum(reach, u - low)
    sides = errors_at(problem, parameters, np.concatenate([u[None], u + np.diag(up), u - np.diag(down)]))
    count, error = len(parameters), sides[0]
    jacobian = (sides[1 : 1 + count] - sides[1 + count :]) / (up + down)[:, None]
    weighted = jacobian * robust_weight(error) / error.size
    slope, curvature = weighted @ error, weighted @ jacobian.T
    acting = {p.path for _, variant in choice.forms for p in variant}
    held = np.array([p.path not in acting for p in parameters])
    middle, width = 0.5 * (low + high), 0.5 * (high - low)
    prior = np.where(held, charge / width**2, 0.0)
    beyond = ~held & (((up == 0.0) & (slope < 0.0)) | ((down == 0.0) & (slope > 0.0)))  # its bound keeps it there
    slope = np.where(beyond, 0.0, slope + prior * (u - middle))
    curvature += np.diag(prior + RIDGE * charge + np.where(beyond, HOLD * charge, 0.0))
    covariance = np.linalg.inv(curvature)
    move = -covariance @ slope
    cost = robust_loss(error).mean() + (prior * (u - middle) ** 2).sum()
    return u + move, covariance, float(cost + slope @ move)
