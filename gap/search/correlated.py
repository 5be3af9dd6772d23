"""What the errors of a model have in common with their neighbours, which noise of a reading has not.

The noise floor of a log is an estimate with a margin, so the size of an error does not tell whether anything but noise
is left of it. That errors close to each other are alike does.
"""

from __future__ import annotations

import itertools

import numpy as np

from ..checks.signal import quantisation_step
from ..replay.comparison import robust_loss
from ..replay.problem import Problem, periods_of

MEMORY = 0.025  # [s] errors up to this far apart share what the model gets wrong


def excess(problem: Problem, simulated: np.ndarray, seed: int = 0) -> float:
    """Loss per judged value (:mod:`sealegs.gap.replay.comparison`) of a model (n, 4) beyond what noise has of it.

    Of what is judged sample by sample, and of the means of groups of samples.
    """
    if (known := problem.excess_loss(simulated)) is not None:
        return known
    total, count = 0.0, 0
    for c in problem.sampled:
        if problem.weight[c] > 0.0:
            error = np.where(problem.judged, (simulated[:, c] - problem.measured[:, c]) * problem.weight[c], np.nan)
            level = shared(problem, _loss_root(error)) - shared(
                problem, reading_error(problem, simulated, error, seed, c)
            )
            judged = int(problem.judged.sum())
            total, count = total + judged * max(level, 0.0), count + judged
    errors = problem.residual(simulated[None])[0][count:]
    for group in np.split(errors, max(len(errors) // max(problem.groups, 1), 1)) if len(errors) else []:
        root = _loss_root(group)
        total, count = total + max(float(root[1:] @ root[:-1]), 0.0), count + len(group)
    return total / max(count, 1)


def _loss_root(error: np.ndarray) -> np.ndarray:
    """Errors as their loss counts them: its root, with their sign."""
    return np.sign(error) * np.sqrt(robust_loss(error))


def shared(problem: Problem, error: np.ndarray) -> float:
    """What errors of one piece up to :data:`MEMORY` apart have in common: their mean product."""
    total, count = 0.0, 0
    for (a, b), period in zip(itertools.pairwise(problem.starts), periods_of(problem), strict=True):
        for lag in range(1, max(round(MEMORY / period), 1) + 1):
            product = error[a + lag : b] * error[a : b - lag]
            good = np.isfinite(product)
            total, count = total + float(product[good].sum()), count + int(good.sum())
    return total / count if count else 0.0


def reading_error(problem: Problem, simulated: np.ndarray, error: np.ndarray, seed: int, c: int = 0) -> np.ndarray:
    """Errors of channel ``c`` that a right model would leave (n,): a coarse encoder errs alike while little moves."""
    values = problem.measured[:, c][problem.judged]
    step = quantisation_step(values[np.isfinite(values)]) * problem.weight[c]
    if step <= 0.0:
        return np.zeros(len(error))
    spread = np.nanmean(error**2) - shared(problem, error) - step**2 / 12.0
    noise = np.sqrt(max(float(spread), 0.0)) * np.random.default_rng(seed).standard_normal(len(error))
    value = simulated[:, c] * problem.weight[c]
    return np.where(np.isfinite(error), np.round((value + noise) / step) * step - value, np.nan)
