"""Which of the tuned numbers the fit needs: the one that is turned furthest may matter least."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..replay.comparison import robust_loss
from ..replay.parameters import Parameter
from ..replay.problem import Problem


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
