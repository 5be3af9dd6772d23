"""Numbers that were refitted beyond their tolerance are causes themselves, if the data need that of them.

Beside refitted numbers (:mod:`.loose`) every number of the model may go up to fivefold, and what is wrong with one of
them is not named. Here each number goes back into its tolerance, those first that were turned least, unless data that
no fit saw ask for it clearly. What still stands out, and has an entry in the catalogue, is named with its size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..causes.cause import Cause
from ..checks.signal import block_weights
from ..replay.parameters import Parameter, about, absolute
from .fit import merge, middle
from .result import Candidate, Round, Search
from .state import Judged

if TYPE_CHECKING:
    from .forward import Searcher


@dataclass(frozen=True, eq=False)
class Needed:
    """A number that data ask for beyond its tolerance.

    Attributes:
        parameter: as it was refitted.
        without: the model with the number within its tolerance, all else refitted.
        sure: share of the bootstrap draws in which that is worse.
    """

    parameter: Parameter
    without: Judged
    sure: float


def with_changed_numbers(searcher: Searcher, found: Search) -> Search:
    """What was found beside refitted numbers, with those that the data need as causes of their own.

    Args:
        searcher: that sought, with numbers within their tolerance.
        found: by it; as it is where nothing was refitted beside causes, or no number needs it.
    """
    if not found.loose:
        return found
    searcher.progress("asking which of the refitted numbers the data need")
    tight = {p.number: p for p in searcher.tuned}
    kept, final, needed = _needed(searcher, found, tight)
    of = _causes_of(searcher.considered)
    named = [(of[one.parameter.number], one) for one in needed if one.parameter.number in of]
    named = [(cause, one) for cause, one in named if cause.key not in {c.cause.key for c in found.accepted}]
    if not named:
        return found
    own = {one.parameter.number for _, one in named}
    tuned = tuple(p for p in kept if p.number not in own)
    named.sort(key=lambda pair: -float(pair[1].without.blocks.sum()))
    causes, rounds = [], []
    for cause, one in named:
        candidate = searcher.candidate(cause, cause.variants[0], _as_told(searcher, final, cause))
        before = float(one.without.blocks.sum())
        gain = 1.0 - float(final.blocks.sum()) / before if before > 0.0 else 0.0
        candidate = replace(candidate, better=one.sure, best=one.sure, gain=max(gain, 0.0))
        causes.append(candidate)
        rounds.append(Round(one.without.blocks, (candidate,), True, searcher.excess(one.without.fits)))
    effects = list(found.accepted)
    told = _as_told(searcher, final, *(cause for cause, _ in named))
    effects[-1:] = [_anew(effect, told) for effect in effects[-1:]]
    if not effects:
        causes[-1] = _anew(causes[-1], told)
    wider = any(p != tight[p.number] for p in tuned if p.number in tight)
    return replace(
        found,
        tuned=tuned,
        accepted=(*causes, *effects),
        rounds=(*rounds, *found.rounds),
        base=searcher.judged(searcher.fit_both(tuned, None)).fits,
        loose=wider,
    )


def _needed(
    searcher: Searcher, found: Search, tight: dict[str, Parameter]
) -> tuple[list[Parameter], Judged, list[Needed]]:
    """Numbers with the bounds that each needs, the model with them, and those that need more than their tolerance."""
    variants = [candidate.variant for candidate in found.accepted]
    final = searcher.judged(found.fits)
    values = middle(*found.fits)
    numbers = list(found.tuned)
    free = [p for p in numbers if p.number in tight and p != tight[p.number]]
    bounds = {number: (p.low, p.high) for number, p in tight.items()}
    inside = {p.number for p in free if about(values.get(p.path, 1.0), *bounds[p.number])}
    if inside:
        numbers = [tight[p.number] if p.number in inside else p for p in numbers]
        final = searcher.judged(searcher.fit_both(merge(numbers, *variants), values))
    needed = []
    outside = [p for p in free if p.number not in inside]
    for parameter in sorted(outside, key=lambda p: abs(math.log(max(values.get(p.path, 1.0), 1e-9)))):
        trial = [tight[p.number] if p.number == parameter.number else p for p in numbers]
        judged = searcher.judged(searcher.fit_both(merge(trial, *variants), middle(*final.fits)))
        sure = _better(searcher, final, judged)
        if sure > searcher.settings.least_certainty and _clearly(searcher, final, judged):
            needed.append(Needed(parameter, judged, sure))
        else:
            numbers, final = trial, judged
    strict = [_beside_others(searcher, found, tight, final, one) for one in needed]
    return numbers, final, [one for one in strict if one.sure > 0.0]


def _beside_others(
    searcher: Searcher, found: Search, tight: dict[str, Parameter], final: Judged, one: Needed
) -> Needed:
    """A number as the data need it where all others may go as far as refitting: none of these stands in for it."""
    trial = [tight[p.number] if p.number == one.parameter.number else p for p in found.tuned]
    variants = [candidate.variant for candidate in found.accepted]
    without = searcher.judged(searcher.fit_both(merge(trial, *variants), middle(*final.fits)))
    sure = _better(searcher, final, without) if _clearly(searcher, final, without) else 0.0
    return replace(one, sure=min(one.sure, sure) if sure > searcher.settings.least_certainty else 0.0)


def _clearly(searcher: Searcher, one: Judged, other: Judged) -> bool:
    """Whether a model's loss is below that of another by what a parameter is charged, at least."""
    return one.blocks.sum() * (1.0 + searcher.settings.parameter_charge) < other.blocks.sum()


def _better(searcher: Searcher, one: Judged, other: Judged) -> float:
    """Share of the bootstrap draws in which a model's loss is below that of another."""
    weights = block_weights(len(one.blocks), searcher.settings.draws, np.random.default_rng(searcher.seed))
    return float((weights @ one.blocks < weights @ other.blocks).mean())


def _causes_of(causes: Sequence[Cause]) -> dict[str, Cause]:
    """The cause of the catalogue that is nothing but a wrong number, by the number."""
    return {
        cause.variants[0][0].number: cause
        for cause in causes
        if cause.error and cause.variants and len(cause.variants[0]) == 1
    }


def _as_told(searcher: Searcher, model: Judged, *causes: Cause) -> Judged:
    """The model with the numbers of causes under the paths of the causes' own parameters."""
    own = {cause.variants[0][0].number: cause.variants[0][0] for cause in causes}
    fits = []
    for one in model.fits:
        values = {}
        for path, value in one.values.items():
            ((number, size),) = absolute({path: value}, searcher.nominal).items()
            if (told := own.get(number)) is None:
                values[path] = value
            else:
                values[told.path] = size / searcher.nominal.value(number) if told.factor else size
        fits.append(replace(one, values=values))
    return replace(model, fits=(fits[0], fits[1]))


def _anew(candidate: Candidate, model: Judged) -> Candidate:
    """A candidate as the last of a model."""
    values = (model.fits[0].values, model.fits[1].values)
    return replace(candidate, fits=model.fits, evidence=replace(candidate.evidence, blocks=model.blocks, values=values))
