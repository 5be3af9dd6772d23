"""What the final model owes to each of its parts: leave one out, refit the rest, and see how much the error rises."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..log.parts import FIT_A, FIT_B
from ..replay.comparison import robust_loss
from ..replay.parameters import Parameter
from ..replay.problem import Problem
from ..search.fit import Fit, merge
from ..search.result import Search
from ..search.settings import SearchSettings
from ..search.sketch import fit_from_sketch


@dataclass(frozen=True)
class Owed:
    """Rise of the cross-validated loss without each part of the final model.

    Attributes:
        causes: rise without each accepted cause, in their order.
        tuned: rise without the tuned numbers, that is with these as they were believed to be.
        without: loss without each cause, which its gain is measured against.
    """

    causes: tuple[float, ...]
    tuned: float
    without: tuple[float, ...]

    def shares(self, explained: float) -> tuple[tuple[float, ...], float]:
        """The explained part of the gap, split between the causes and the tuned numbers."""
        total = sum(self.causes) + self.tuned
        if total <= 0.0:
            return tuple(explained / len(self.causes) for _ in self.causes), 0.0 if self.causes else explained
        return tuple(explained * rise / total for rise in self.causes), explained * self.tuned / total


def owed(problem: Problem, search: Search) -> Owed:
    """Leave each accepted cause out, then the tuned numbers, and refit all else on both halves of the data.

    Args:
        problem: the data as the search saw them.
        search: with at least one accepted cause.
    """
    final = search.accepted[-1]
    parts = (problem.part(FIT_A), problem.part(FIT_B))

    def loss(others: Sequence[Parameter]) -> float:
        return float(refitted(parts, others, final.fits, search.settings)[1].sum())

    def of(kept: Sequence[str], *, tuned: bool = True) -> float:
        left = [candidate.variant for candidate in search.accepted if candidate.cause.key in kept]
        return loss(merge(*((search.tuned,) if tuned else ()), *left))

    return owed_to([candidate.cause.key for candidate in search.accepted], of, float(final.blocks.sum()))


def refitted(
    parts: tuple[Problem, Problem], parameters: Sequence[Parameter], begun: tuple[Fit, Fit], settings: SearchSettings
) -> tuple[tuple[Fit, Fit], np.ndarray]:
    """Fits of some parameters to both parts of the data, and the loss of each block under the one that did not see it.

    Args:
        parts: FIT_A and FIT_B.
        parameters: to fit.
        begun: fits, of other parameters too, from whose values it starts.
        settings: of the search.
    """
    starts = [{p.path: found.values[p.path] for p in parameters if p.path in found.values} for found in begun]
    a, b = (fit_from_sketch(part, parameters, start, settings) for part, start in zip(parts, starts, strict=True))
    crossed = zip(reversed(parts), (a, b), strict=True)
    return (a, b), np.concatenate([p.block_errors(p.simulate([f.values])[0]) for p, f in crossed])


class Loss(Protocol):
    """Cross-validated loss of the final model with only some of its causes, all that is left being refitted."""

    def __call__(self, kept: Sequence[str], *, tuned: bool = True) -> float:
        """With the causes ``kept``; the tuned numbers are fitted too, or are as believed."""
        ...


def owed_to(names: Sequence[str], loss: Loss, whole: float | None = None) -> Owed:
    """Leave each cause out, then the tuned numbers.

    Args:
        names: of the causes.
        loss: of what is kept.
        whole: the loss with all of them, where it is known.
    """
    whole = loss(names) if whole is None else whole
    without = tuple(loss([other for other in names if other != name]) for name in names)
    untuned = loss(names, tuned=False)
    return Owed(tuple(max(value - whole, 0.0) for value in without), max(untuned - whole, 0.0), without)


def by_effect(problem: Problem, values: Mapping[str, float], parts: Sequence[Collection[str]]) -> np.ndarray:
    """Shares (p,) of parts of a model, by the mean square of how far its replay moves where one is put back to what is
    believed.

    What a fit without a part leaves is no measure where much is shared: other numbers make up for most of it.

    Args:
        problem: all data.
        values: of the model, by path.
        parts: paths of each; together all of them.
    """
    rows = [{path: x for path, x in values.items() if path not in part} for part in parts]
    here, *others = problem.residual(problem.simulate([values, *rows]))
    effects = np.array([np.mean((other - here) ** 2) for other in others])
    return effects / max(effects.sum(), 1e-300)


def telling(problem: Problem, values: Mapping[str, float], numbers: Sequence[Parameter]) -> dict[str, float]:
    """Values of some numbers of a model by number, those first without which alone the loss rises most.

    Args:
        problem: all data.
        values: of the model, by path.
        numbers: to put in order; those that it does not have are left out.
    """
    found = [p for p in numbers if p.path in values]
    without = [{path: value for path, value in values.items() if path != p.path} for p in found]
    losses = [float(robust_loss(problem.residual(problem.simulate([row]))).mean()) for row in without]
    return {found[k].number: values[found[k].path] for k in np.argsort(losses, kind="stable")[::-1]}
