"""What the models do on data that nothing was fitted to, and what each named cause is worth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..log.parts import FIT_A, FIT_B, TEST
from ..replay.parameters import Parameter
from ..replay.problem import Nominal, Problem
from ..replay.robust import robust_loss
from ..search.fit import Fit, fit, middle
from ..search.intervals import intervals
from ..search.result import Search
from ..search.structure import Structure, structure
from .decide import confidence
from .shares import owed
from .verdict import Error, NamedCause, Value

EVALUATIONS = 25  # iterations of each final fit


@dataclass(frozen=True, eq=False)
class Measured:
    """Errors, causes and what is left of a search's models.

    Attributes:
        gap: error of each model on the test part, as :attr:`JointDiagnosis.gap`.
        tuned: error there of the nominal model, tuned within its tolerance.
        values: parameters of the extended model.
        simulated: channels of each model over the whole problem (n, 4).
        left: share of the nominal mean squared error beyond the noise that stays on the test part.
        unexplained: the same, at least what the structure is of it.
        structure: what is left of the error that is not noise.
        causes: largest share first.
        tuned_share: share that the extended model owes to its tuned numbers.
    """

    gap: dict[str, Error]
    tuned: Error
    values: dict[str, float]
    simulated: dict[str, np.ndarray]
    left: float
    unexplained: float
    structure: Structure
    causes: tuple[NamedCause, ...]
    tuned_share: float


def measure(
    problem: Problem, fitting: Problem, search: Search, joint: str, wide: Sequence[Parameter], seed: int
) -> Measured:
    """Fit the models once more to all that may be fitted, and judge them on the test part.

    Args:
        problem: all data.
        fitting: the same as the search saw them.
        search: what was found.
        joint: its name.
        wide: what refitting alone may turn, and how far.
        seed: of all resampling.
    """
    fitted, test = fitting.part(FIT_A, FIT_B), problem.part(TEST)
    refitted = fit(fitted, wide, evaluations=EVALUATIONS)
    last = search.accepted[-1].fits if search.accepted else search.base
    extended = fit(fitted, search.parameters(), middle(*last), evaluations=EVALUATIONS)
    tuned = extended
    if search.accepted:
        tuned = fit(fitted, search.tuned, middle(*search.base), evaluations=EVALUATIONS)
    models = {"nominal": {}, "refitted": refitted.values, "extended": extended.values}
    gap = {name: _error(test, values) for name, values in models.items()}
    gap["noise_floor"] = Error(problem.noise, problem.noise * float(np.sqrt(2.0 / np.pi)))

    simulated = {name: problem.simulate([values])[0] for name, values in models.items()}
    rest = structure(problem, simulated["extended"], seed)
    everywhere = float(np.mean(problem.position_error(simulated["extended"]) ** 2))
    # the noise as it is, where the floor was estimated with a margin
    white = min(everywhere - rest.rms**2, problem.noise**2)
    excess = max(gap["nominal"].rmse ** 2 - white, 1e-12)
    left = float(np.clip((gap["extended"].rmse ** 2 - white) / excess, 0.0, 1.0))
    unexplained = left
    if rest.noticed:  # structure that the test part shows less of than the rest is not explained for that
        before = float(np.mean(problem.position_error(simulated["nominal"]) ** 2)) - white
        unexplained = max(left, min(rest.rms**2 / max(before, 1e-12), 1.0))
    causes, tuned_share = _name_causes(fitting, search, extended, joint, 1.0 - unexplained, rest, seed)
    return Measured(
        gap, _error(test, tuned.values), extended.values, simulated, left, unexplained, rest, causes, tuned_share
    )


def whole_runs(problem: Problem) -> bool:
    """Whether the runs of the test part are in no other part."""
    runs = [{unit.run for unit in problem.units if (unit.part == TEST) is test} for test in (True, False)]
    return not runs[0] & runs[1]


def _error(test: Problem, values: Mapping[str, float]) -> Error:
    error = test.position_error(test.simulate([values])[0])
    return Error(float(np.sqrt(np.mean(error**2))), float(np.mean(np.abs(error))))


def _name_causes(
    fitting: Problem, search: Search, extended: Fit, joint: str, explained: float, rest: Structure, seed: int
) -> tuple[tuple[NamedCause, ...], float]:
    """Causes with shares, confidence, near misses and intervals, and the share of the tuned numbers."""
    if not search.accepted:
        return (), explained
    debts = owed(fitting.coarsened(search.settings.coarse_step), search)
    shares, tuned_share = debts.shares(explained)
    final = search.accepted[-1]
    bounds = intervals(fitting.part(FIT_A, FIT_B), search.parameters(), extended, seed, final.fits)
    rounds = [r for r in search.rounds if r.accepted]
    residual = float(robust_loss(np.sqrt(rest.level))) if rest.noticed else 0.0
    named = []
    for candidate, share, without, chosen in zip(search.accepted, shares, debts.without, rounds, strict=True):
        removed = float((chosen.before.sum() - candidate.blocks.sum()) / search.counts.sum())
        named.append(
            NamedCause(
                name=candidate.cause.name,
                sentence=candidate.cause.sentence,
                joint=joint,
                share=share,
                confidence=confidence(candidate.best, removed, residual),
                parameters={
                    p.number: _value(p, extended, bounds, fitting.models[0])
                    for p in candidate.variant
                    if p.path in extended.values
                },
                gain=1.0 - float(np.sqrt(final.blocks.sum() / without)),
                kind="number" if candidate.cause.error else "effect",
                picture=candidate.cause.picture,
                rivals=tuple(c.cause.name for c in chosen.candidates[1:] if c.best > search.settings.rival_win_rate),
            )
        )
    return tuple(sorted(named, key=lambda cause: -cause.share)), tuned_share


def _value(parameter: Parameter, extended: Fit, bounds: Mapping[str, tuple[float, float]], nominal: Nominal) -> Value:
    found = (extended.values[parameter.path], *bounds[parameter.path])
    value, low, high = (float(parameter.physical(number, nominal)) for number in found)
    unit = nominal.unit(parameter.number) if parameter.factor else parameter.unit
    return Value(value, low, high, unit, float(nominal.value(parameter.number)))
