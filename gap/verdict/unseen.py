"""Which of the fitted models may be handed over: what holds on data that nothing was fitted to.

Three rules, in this order. A cause whose interval reaches the value at which it does nothing is no finding. Causes
that leave the error on unseen data no smaller than it was are withdrawn, all of them. Where turning the nominal
numbers alone does clearly better there, that is the finding, and the model that is handed over.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..checks.bootstrap import block_weights
from ..log.parts import FIT_A, FIT_B
from ..replay.parameters import Parameter
from ..replay.problem import Nominal, Problem
from ..search.fit import Fit, fit, middle
from ..search.intervals import intervals
from ..search.result import Candidate, Search
from .evidence import THRESHOLDS
from .verdict import NEAR_MISS, WITHDRAWN, OpenCause

EVALUATIONS = 25  # iterations of each final fit
DRAWS = 1000


@dataclass(frozen=True, eq=False)
class Model:
    """The extended model with those causes that have an effect.

    Attributes:
        search: less the causes that have none.
        fitted: all its parameters, to all that may be fitted.
        bounds: 95 % intervals by path.
        withdrawn: causes that were taken out.
    """

    search: Search
    fitted: Fit
    bounds: Mapping[str, tuple[float, float]]
    withdrawn: tuple[OpenCause, ...] = ()

    def with_fit(self, fitted: Fit) -> Model:
        """The model with other values; its intervals reach them."""
        bounds = {
            path: (min(low, fitted.values.get(path, low)), max(high, fitted.values.get(path, high)))
            for path, (low, high) in self.bounds.items()
        }
        return replace(self, fitted=fitted, bounds=bounds)


def effective(fitting: Problem, search: Search, seed: int) -> Model:
    """Fit the extended model to all that may be fitted; take out the causes that may as well do nothing."""
    fitted = fitting.part(FIT_A, FIT_B)
    withdrawn: list[OpenCause] = []
    while True:
        last = search.fits
        found = fit(fitted, search.parameters(), middle(*last), evaluations=EVALUATIONS)
        if not search.accepted:
            return Model(search, found, {}, tuple(withdrawn))
        bounds = intervals(fitted, search.parameters(), found, seed, last)
        idle = [c for c in search.accepted if _idle(c, bounds, fitting.models[0])]
        if not idle:
            return Model(search, found, bounds, tuple(withdrawn))
        withdrawn += [
            OpenCause(c.cause.name, WITHDRAWN, f"its size cannot be told from none ({_interval(c, bounds)})")
            for c in idle
        ]
        search = search.less([c.cause.key for c in idle])


def _idle(candidate: Candidate, bounds: Mapping[str, tuple[float, float]], nominal: Nominal) -> bool:
    """Whether every size of the variant may be what it is where the cause does nothing."""
    return all(does_nothing(p, bounds[p.path], nominal) for p in candidate.variant if p.is_size and p.path in bounds)


def does_nothing(parameter: Parameter, bounds: tuple[float, float], nominal: Nominal) -> bool:
    """Whether an interval reaches the value at which the parameter changes nothing, or that end of what was tried."""
    low, high = (parameter.to_fit(end) for end in (parameter.low, parameter.high))
    neutral = parameter.neutral(nominal)
    least = parameter.low if not parameter.logarithmic else max(parameter.low, 1e-12)
    none = parameter.to_fit(min(max(neutral, least), parameter.high))
    margin = THRESHOLDS.at_rest * (high - low)
    return parameter.to_fit(bounds[0]) <= none + margin and parameter.to_fit(bounds[1]) >= none - margin


def _interval(candidate: Candidate, bounds: Mapping[str, tuple[float, float]]) -> str:
    first = candidate.variant[0]
    low, high = bounds[first.path]
    return f"{first.number} {low:.3g} to {high:.3g}{'' if first.unit == '1' else ' ' + first.unit}"


def holds(test: Problem, model: np.ndarray, other: np.ndarray) -> bool:
    """Whether a model's squared error on the test part is below another's; both as simulated channels (n, 4)."""
    return _squares(test, model).mean() < _squares(test, other).mean()


def clearly_better(test: Problem, model: np.ndarray, other: np.ndarray, seed: int) -> bool:
    """The same, by more than chance and rounding, and in most draws of a bootstrap over stretches of the test part."""
    a, b = (_squares(test, simulated) for simulated in (model, other))
    if not a.mean() < THRESHOLDS.clearly * b.mean():
        return False
    count = max(min(len(a) // 50, 40), 2)
    blocks = np.array_split(np.stack([a, b], axis=1), count)
    sums = np.stack([block.sum(axis=0) for block in blocks])
    drawn = block_weights(count, DRAWS, np.random.default_rng(seed)) @ sums
    return bool((drawn[:, 0] < drawn[:, 1]).mean() > THRESHOLDS.certainly)


def _squares(test: Problem, simulated: np.ndarray) -> np.ndarray:
    return test.position_error(simulated) ** 2


def outdone(search: Search, why: str) -> tuple[Search, tuple[OpenCause, ...]]:
    """The search without any cause, and the causes that it named as withdrawn."""
    names = dict.fromkeys(c.cause.name for c in search.accepted)
    return search.less([c.cause.key for c in search.accepted]), tuple(OpenCause(n, WITHDRAWN, why) for n in names)


def near_misses(search: Search, most: int = 3) -> tuple[OpenCause, ...]:
    """Candidates of the last round that nearly were named, with what they lack and the sizes that both parts found."""
    from ..search import decide

    steps = [step for step in search.record.steps if step.round.candidates]
    if not steps or steps[-1].winner is not None or len(search.record.steps) > len(search.rounds):
        return ()
    found = []
    record = steps[-1].round
    for standing in decide.standings(record, search.settings, search.record.seed):
        lacks = decide.shortfalls(record, standing, search.settings, further=bool(search.accepted))
        if not decide.is_near(lacks, standing, search.settings):
            continue
        evidence = record.candidates[standing.index]
        cause = next((c for c in search.causes if c.key == evidence.name), None)
        first = None if cause is None else cause.variants[0][0]
        sizes = [v[first.path] for v in evidence.values if first is not None and first.path in v]
        told = f"{first.number} {sizes[0]:.3g} and {sizes[1]:.3g} in the two parts" if first and len(sizes) == 2 else ""
        sentence = f"{' and '.join(lack.sentence for lack in lacks)}{'; ' * bool(told)}{told}"
        found.append(OpenCause(evidence.name if cause is None else cause.name, NEAR_MISS, sentence))
    return tuple(found[:most])


def refitted_numbers(wide: Sequence[Parameter], values: Mapping[str, float], most: int = 3) -> str:
    """The numbers that refitting turned furthest, for people."""
    turned = [(p.number, values[p.path]) for p in wide if p.factor and p.path in values]
    turned.sort(key=lambda row: -abs(np.log(max(row[1], 1e-9))))
    return ", ".join(f"{number} x {factor:.3g}" for number, factor in turned[:most])
