"""How sure a cause is, and the thresholds that a verdict is compared with."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..replay.comparison import robust_loss
from ..replay.parameters import Parameter
from ..replay.problem import Problem
from ..search.settings import threshold
from ..search.structure import Structure
from .named import CERTAIN, LIKELY, ONE_OF_SEVERAL, POSSIBLE, NamedCause


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """What the decision compares with."""

    negligible: float = threshold(
        0.03,
        "Largest unexplained share of the gap that counts as explained although structure is noticed. Each cause must "
        "have the confidence `sure`, and the structure must stay below `as_noise`.",
    )
    as_noise: float = threshold(1.0, "Largest structure in that case, relative to the mean square of the noise.")
    at_noise: float = threshold(
        1.05,
        "Error on the test part, in noise floors, up to which no other model does clearly better.",
    )
    believed: float = threshold(
        1.2,
        "Error, in noise floors, up to which a joint of a robot has nothing to explain in spite of `slight` structure, "
        "and up to which tuned numbers leave room only for a cause that is `certain`. Robots without any effect that "
        "other programs simulated reached 1.16.",
    )
    slight: float = threshold(
        0.3,
        "Largest structure in that case, relative to the mean square of the noise: what the bodies and neighbours of a "
        "joint have wrong within their tolerance. Strangers on hidden arms left 2.9 noise floors and more.",
    )
    feeble: float = threshold(
        0.3, "Share of the tuned model's mean squared error that the causes must remove where structure is noticed."
    )
    sure: float = threshold(0.6, "Confidence from which a cause is named alone.")
    # Of the causes that the hidden benches named with as much, 218 of 219 were right; between ``sure`` and it, 24 of
    # 30; below, 17 of 54 (``python -m benchmarks.calibration``).
    certain: float = threshold(0.9, "Confidence from which a cause is certain, whatever else is open.")
    guessed: float = threshold(
        0.3, "Confidence below which a cause is a guess: where none has more, the gap is not identifiable."
    )
    form: float = threshold(
        0.01,
        "Relative error of any law of the catalogue. A cause that removes no more than that of what the others explain "
        "may mend their laws.",
    )
    neighbours: float = threshold(
        0.05,
        "Mean square, relative to that of the noise, of what a joint of a robot may have wrong since the acceleration "
        "of its neighbours is measured. A cause that removes no more may mend that.",
    )
    tuned_away: float = threshold(
        4.0,
        "Mean squared error of the nominal model, relative to that of the tuned one, from which the sentence of "
        "`nothing to explain` gives the tuned number that the fit needs most.",
    )
    at_bound: float = threshold(
        0.5, "Factor on the confidence where the value is at an end of the range tried: there it is no measurement."
    )
    contradicted: float = threshold(
        0.7, "Factor on the confidence where a feature of the cause stays as wrong as in the nominal model."
    )
    clearly: float = threshold(
        0.9,
        "Mean squared error on the test part, relative to that of the model with the causes, below which the refitted "
        "numbers are clearly better.",
    )
    certainly: float = threshold(0.975, "Share of the bootstrap draws in which the refitted numbers must be better.")
    missed: float = threshold(
        0.9,
        "Loss with a cause whose interval reaches no effect, relative to the loss without it, below which unseen data "
        "miss it and it stays; `certainly` holds for it too.",
    )
    at_rest: float = threshold(
        1e-3, "Share of the range tried: an interval that comes this close to the value without effect includes it."
    )


THRESHOLDS = Thresholds()


def as_noise_allows(
    structure: Structure, error: float, noise: float, of_robot: bool, limit: Thresholds = THRESHOLDS
) -> bool:
    """Whether nothing asks for an explanation where no cause is named.

    Args:
        structure: that is left.
        error: of the model on the test part, and ``noise``: its floor; in the same unit.
        of_robot: whether it is a joint of a robot, whose other bodies are believed too.
        limit: what it is compared with.
    """
    little = of_robot and error <= limit.believed * noise and structure.level <= limit.slight
    return little or not structure.noticed


@dataclass(frozen=True)
class Adrift:
    """What is left of a joint that nothing holds near the log (:mod:`sealegs.gap.measure.adrift`).

    Attributes:
        level: of the structure that is left once pieces begin where they fit best, over the mean square of the noise.
        error: that is left then, in the unit of the signal (rms).
        neighbours: what errors of its neighbours' accelerations leave, in the same unit (rms).
    """

    level: float
    error: float
    neighbours: float

    def at_noise(self, noise: float, limit: Thresholds = THRESHOLDS) -> bool:
        """Whether starts that were read with noise leave as much."""
        return self.error <= noise or (self.error <= limit.at_noise * noise and self.level <= limit.slight)

    def allows(self, noise: float, limit: Thresholds = THRESHOLDS) -> bool:
        """Whether what is left needs no cause: starts, or errors of the neighbours, leave as much."""
        return self.at_noise(noise, limit) or self.error <= self.neighbours


def confidence(win_rate: float, removed: float, residual: float, beyond: float = 1.0) -> float:
    """Win rate x removed / (removed + residual) x beyond refitting, ``removed`` and ``residual`` as loss per value.

    Args:
        win_rate: share of the draws in which the cause beats all others.
        removed: by it.
        residual: structure that is left, and what the laws of the other causes may have wrong. An unknown cause that
            leaves that much may also be what made this one look good.
        beyond: share of what refitted numbers leave that the causes remove. Where numbers that are not wrong fit as
            well, so may a cause that is not there.
    """
    return win_rate * removed / (removed + residual) * beyond if removed > 0.0 else 0.0


def law_error(others: float, limit: Thresholds = THRESHOLDS) -> float:
    """What the laws of other causes may have wrong, of what these explain; both in squares of the noise floor."""
    return limit.form**2 * others


def standing(
    confidence: float, rivals: Sequence[str], limit: Thresholds = THRESHOLDS, *, contradicted: bool = False
) -> str:
    """What is said of one cause, whatever is said of others; its own features may contradict it."""
    if confidence < limit.sure:
        return ONE_OF_SEVERAL if rivals else POSSIBLE
    return CERTAIN if confidence >= limit.certain and not contradicted else LIKELY


# --- what the final model owes to each of its parts: how far its replay moves where one is put back to what is
# believed.
#
# What a fit without a part leaves is no measure where several act: other numbers make up for most of it.


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
