"""Each named cause asked whether two others together do as well in its place.

One cause may stand in for two, as a higher resistance does for a weaker magnet with more viscous friction. In its place
alone neither of them does as well, so an exchange of one for one (:mod:`.exchange`) does not see them. A cause is sure
only where no pair fits as well; where one fits better, it stands in the place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from . import decide
from .exchange import likeliest
from .fit import middle
from .record import TOGETHER, Evidence, RoundRecord, Step
from .result import Candidate, Round
from .rounds import Rounds
from .state import Found

TRIED = 2  # causes that are tried with another: the best that do worse alone


@dataclass(frozen=True, eq=False)
class Pair:
    """Two causes in the place of one.

    Attributes:
        parts: the two, as they are together.
        whole: both as one candidate, charged for what they turn beyond the one that stands there.
        beside: the one that stands there beside the second of the two, and beside the first, charged for these; where
            the two do better than it alone. What one of them mends is not to the credit of the pair.
    """

    parts: tuple[Candidate, Candidate]
    whole: Candidate
    beside: tuple[Candidate, ...]


def paired(searcher: Rounds, found: Found) -> bool:
    """Ask of every cause; whether a pair stands in the place of one now, so that the search goes on."""
    return any(_asked(searcher, found, place) for place in range(len(found.accepted)))


def _asked(searcher: Rounds, found: Found, place: int) -> bool:
    """Ask of one cause; whether a pair stands in its place."""
    own, settings = found.accepted[place], searcher.settings
    at = [k for k, step in enumerate(found.rounds) if step.accepted][place]
    step = found.rounds[at]
    worse = [
        one
        for one in step.candidates[1:]
        if one.best <= settings.rival_win_rate and not one.beside and one.cause.key not in searcher.replaced
    ]
    pairs = [pair for one in worse[:TRIED] if (pair := _beside(searcher, found, place, one)) is not None]
    if not pairs:
        return False
    beside = [one.blocks for pair in pairs for one in pair.beside]
    least = min([own.blocks, *beside], key=lambda blocks: float(blocks.sum()))
    mine = replace(own, evidence=replace(own.evidence, blocks=least))
    fitted = [
        mine,
        *(one for one in step.candidates if one.cause.key != own.cause.key),
        *(pair.whole for pair in pairs),
    ]
    record = replace(_record(found, own), candidates=tuple(one.evidence for one in fitted))
    order, ranked = searcher.standings(record, fitted)
    chosen = decide.in_place(record, order, own.cause.key, settings)
    if chosen is not None:
        found.steps.append(Step(record, chosen, place))
    taken = next((pair for pair in pairs if pair.whole.cause.key == chosen), None)
    if taken is None:
        mine = next(one for one in ranked if one.cause.key == own.cause.key)
        found.accepted[place] = replace(mine, evidence=own.evidence)
        found.rounds[at] = replace(
            step, candidates=(found.accepted[place], *(one for one in ranked if one is not mine))
        )
        return False
    searcher.replaced.add(own.cause.key)
    others = [one for k, one in enumerate(found.accepted) if k != place]
    beside = taken.beside or tuple(_anew(searcher, own, part, others) for part in taken.parts[::-1])
    found.accepted[place : place + 1] = taken.parts
    places = zip(taken.parts, beside, strict=True)
    found.rounds[at : at + 1] = [Round(step.before, (one, rival), True, step.excess) for one, rival in places]
    found.rounds[:] = [one for one in found.rounds if one.accepted]
    found.put(searcher.of(taken.parts[1]))
    searcher.progress(f"beside the others, {chosen} stand in the place of {own.cause.key}")
    return True


def _record(found: Found, own: Candidate) -> RoundRecord:
    """What was decided on when a cause was last taken."""
    return next(step.round for step in reversed(found.steps) if step.winner == own.cause.key)


def _beside(searcher: Rounds, found: Found, place: int, first: Candidate) -> Pair | None:
    """A cause in the place of another with the best beside it; None where it needs none there, or no size is sure."""
    own, settings = found.accepted[place], searcher.settings
    others = [one for k, one in enumerate(found.accepted) if k != place]
    begin = searcher.excess(first.fits)
    if TOGETHER in first.cause.key or decide.finished(begin, settings):
        return None
    searcher.progress(f"asking whether {first.cause.key} with another does as well in the place of {own.cause.key}")
    model, current = [*others, first], searcher.of(first)
    tried = likeliest(searcher, searcher.open_causes([*model, own]), model, current)
    fitted = searcher.fitted(tried, model, current, begin, instead=own, most=1)
    second = min(fitted, key=lambda one: float(one.blocks.sum()), default=None)
    if second is None:
        return None
    together = searcher.of(second)
    one, two = (searcher.candidate(part.cause, part.variant, together) for part in (first, second))
    if decide.inconsistent(one.evidence, settings) or decide.inconsistent(two.evidence, settings):
        return None
    more = max(one.flexibility + two.flexibility - own.flexibility, 1)
    cause = replace(first.cause, name=f"{first.cause.key}{TOGETHER}{second.cause.key}", about="", degenerates_to=None)
    whole = Candidate(
        cause, (*one.variant, *two.variant), two.fits, _evidence(cause.key, one, two, own.evidence.parameters + more)
    )
    beside: tuple[Candidate, ...] = ()
    if whole.blocks.sum() < own.blocks.sum():
        beside = tuple(_anew(searcher, own, part, others) for part in (two, one))
    return Pair((one, two), whole, beside)


def _anew(searcher: Rounds, own: Candidate, part: Candidate, others: Sequence[Candidate]) -> Candidate:
    """A cause beside one part of a pair, charged for that."""
    start = {**middle(*part.fits), **middle(*own.fits)}
    judged = searcher.judged(searcher.fit_both(searcher.parameters([*others, own, part]), start))
    blocks = judged.blocks * (1.0 + searcher.settings.parameter_charge * part.flexibility)
    return searcher.candidate(own.cause, own.variant, replace(judged, blocks=blocks))


def _evidence(name: str, one: Candidate, two: Candidate, parameters: int) -> Evidence:
    return replace(
        two.evidence,
        name=name,
        number=True,
        parameters=parameters,
        contradicted=max(one.evidence.contradicted, two.evidence.contradicted),
        limit="",
    )
