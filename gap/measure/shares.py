"""What the final model owes to each of its parts: how far its replay moves where one is put back to what is believed.

What a fit without a part leaves is no measure where several act: other numbers make up for most of it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..replay.comparison import robust_loss
from ..replay.parameters import Parameter
from ..replay.problem import Problem
from .named import NamedCause


def by_effect(problem: Problem, values: Mapping[str, float], parts: Sequence[Collection[str]]) -> np.ndarray:
    """Shares (p,) of parts of a model, by the mean square of how far the judged signal of its replay moves where one is
    put back to what is believed.

    Args:
        problem: all data.
        values: of the model, by path.
        parts: paths of each; together all of them.
    """
    effects = moved(problem, values, parts)
    return effects / max(effects.sum(), 1e-300)


def moved(problem: Problem, values: Mapping[str, float], parts: Sequence[Collection[str]]) -> np.ndarray:
    """Mean square (p,) of how far that signal moves, in its unit squared; arguments as of :func:`by_effect`."""
    rows = [{path: x for path, x in values.items() if path not in part} for part in parts]
    here, *others = (problem.position_error(channels) for channels in problem.simulate([values, *rows]))
    return np.array([np.mean((other - here) ** 2) for other in others])


def with_shares(causes: Sequence[NamedCause], shares: Sequence[float]) -> tuple[NamedCause, ...]:
    """Causes with these shares, the largest first."""
    found = [replace(cause, share=share) for cause, share in zip(causes, shares, strict=True)]
    return tuple(sorted(found, key=lambda cause: -cause.share))


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
