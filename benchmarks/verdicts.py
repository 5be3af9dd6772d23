"""Whether policies do better than another, and how sure that is: of few policies and few starts, by Student's t."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

LEAST_POLICIES = 3  # from which they stand for others of their training; assumed, as two tell little of a spread
LEAST_STARTS = 6  # the same of starts; assumed, as 5 differences have one sign by chance in 2 of 32, over 5 %
SURE = 0.95  # of an interval, and of a verdict
BETTER, WORSE, ALIKE, UNJUDGED = "better", "**worse**", "alike", "not judged"
RULE = (
    f"Intervals of {100 * SURE:g} % and verdicts are by Student's t of the means of policies and of starts: over "
    f"policies where there are {LEAST_POLICIES} or more, else of these policies alone, each with its own value; over "
    f"starts where there are {LEAST_STARTS} or more, else from these starts alone. Below both nothing is judged."
)


@dataclass(frozen=True)
class Estimate:
    """A mean, and its interval of :data:`SURE`; NaN: of too few."""

    mean: float
    low: float = math.nan
    high: float = math.nan

    def __str__(self) -> str:
        """As a page has it."""
        return short(self) + ("" if math.isnan(self.low) else f" ({self.low:.3g} to {self.high:.3g})")


def short(*estimates: Estimate) -> str:
    """Means alone."""
    return ", ".join(f"{item.mean:.3g}" for item in estimates)


def estimate(values: np.ndarray) -> Estimate:
    """Of values (policies, starts), as :data:`RULE` says.

    Both spreads count where both are of enough. What is of one policy at one start is then in both, which errs on the
    side of a wide interval.
    """
    mean, parts = float(values.mean()), []
    for axis, least in ((1, LEAST_POLICIES), (0, LEAST_STARTS)):
        means = values.mean(axis=axis)
        if len(means) >= least:
            parts.append((float(means.var(ddof=1)) / len(means), len(means) - 1))
    if not parts:
        return Estimate(mean)
    variance = sum(part for part, _ in parts)
    within = sum(part**2 / freedom for part, freedom in parts)
    freedom = variance**2 / within if within else 1.0  # Welch and Satterthwaite
    half = float(student.ppf(0.5 + 0.5 * SURE, freedom)) * math.sqrt(variance)
    return Estimate(mean, mean - half, mean + half)


def beside(own: np.ndarray, other: np.ndarray | None, more: bool) -> str:
    """Whether policies (p, n) surely do better or worse than another (n,) from the same starts."""
    if other is None:
        return ""
    gain = estimate((own - other) * (1.0 if more else -1.0))
    if math.isnan(gain.low):
        return UNJUDGED
    return BETTER if gain.low > 0.0 else WORSE if gain.high < 0.0 else ALIKE


def over(policies: int, starts: int) -> str:
    """What intervals and verdicts of a task are over."""
    many = policies >= LEAST_POLICIES, starts >= LEAST_STARTS
    return {
        (True, True): "over policies and starts",
        (True, False): "over policies, from these starts alone",
        (False, True): "over starts, of these policies alone",
        (False, False): "none, of too few policies and starts",
    }[many]
