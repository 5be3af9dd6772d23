"""Each named cause asked once more, in its place among all the others: whether another does better there, or none.

A search adds one cause at a time. The first of several may have stood in for two that act together, as a centre of mass
further out does for a heavier weight and a heavier rotor; and what was its rival then may be explained by the others
now. So named causes are exchanged, as in stepwise regression, until each is the best in its place. The rounds that ask
say what each is worth, and what its rivals are.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..causes.cause import Cause, Variant
from . import decide
from .fit import merge, middle
from .record import TOGETHER, Step
from .result import Candidate, Round
from .rounds import Rounds
from .screen import screen
from .state import Found, Judged

NEVER = float("nan")  # promise of a screen that was not run


def exchanged(searcher: Rounds, found: Found) -> bool:
    """Ask of every cause that was not chosen beside all others.

    Returns:
        Whether another stands in the place of one, or none, so that the search goes on. Else the rounds of the causes
        are those that asked.
    """
    places = [k for k, candidate in enumerate(found.accepted) if candidate.cause.key != found.settled]
    start, without = middle(*found.current.fits), dict[int, Judged]()
    for place in places:
        others = [candidate for k, candidate in enumerate(found.accepted) if k != place]
        without[place] = searcher.judged(searcher.fit_both(searcher.parameters(others), start))
    left = {place: searcher.excess(model.fits) for place, model in without.items()}
    # what nothing needs goes first: what stays is then asked for once, and among fewer
    places.sort(key=lambda place: not decide.finished(left[place], searcher.settings))
    return any(_asked(searcher, found, place, without[place], left[place]) for place in places)


def _asked(searcher: Rounds, found: Found, place: int, without: Judged, begin: float) -> bool:
    """Ask of one cause; whether another stands in its place now, or none.

    Args:
        searcher: of the joint.
        found: until now.
        place: of the cause.
        without: the model with the others alone.
        begin: what that leaves beyond the noise.
    """
    own = searcher.candidate(found.accepted[place].cause, found.accepted[place].variant, found.current)
    key, others = own.cause.key, [candidate for k, candidate in enumerate(found.accepted) if k != place]
    searcher.progress(f"asking whether another cause does better in the place of {key}")
    fitted, at = [own], [k for k, step in enumerate(found.rounds) if step.accepted][place]
    if not decide.finished(begin, searcher.settings):
        shown = searcher.open_causes(found.accepted, replaced=True)  # what stood here is a rival still
        tried = likeliest(searcher, shown, others, without, found.rounds[at].candidates)
        fitted += searcher.fitted(tried, others, without, begin, instead=own)
        fitted += _known(searcher, found.rounds[at].candidates, others, fitted)
        own = fitted[0] = _from_the_best(searcher, own, others, fitted)
    record, without = searcher.recorded(others, fitted, without, begin, NEVER, instead=own)
    order, ranked = searcher.standings(record, fitted)
    chosen = decide.in_place(record, order, key, searcher.settings)
    found.steps.append(Step(record, chosen, place))
    first = next((candidate for candidate in ranked if candidate.cause.key == chosen), None)
    if first is not None:
        rivals = [candidate for candidate in ranked if candidate is not first]
        found.rounds[at] = Round(record.before, (first, *rivals), True, begin)
    if first is not None and chosen == key:
        found.accepted[place] = first
        return False
    if first is None:
        del found.rounds[at]
    _put(searcher, found, place, first, without)
    said = "nothing" if first is None else first.cause.key
    searcher.progress(f"beside the others, {said} stands in the place of {key}")
    return True


def likeliest(
    searcher: Rounds,
    shown: Sequence[Cause],
    others: Sequence[Candidate],
    without: Judged,
    rivals: Sequence[Candidate] = (),
) -> list[tuple[Cause, Variant]]:
    """What the screen puts first in a place, and what was fitted there before.

    Args:
        searcher: of the joint.
        shown: causes to choose from.
        others: causes of the model that has nothing in the place.
        without: this model.
        rivals: what was fitted in the place before.
    """
    here = middle(*without.fits)
    searcher.sketch_anew(searcher.parameters(others), here)
    screened = screen(searcher.sketch, shown, searcher.parameters(others), here, searcher.settings)
    first = list(dict.fromkeys(cause.key for cause, _ in screened.chosen))[: searcher.settings.finalists]
    before = [(c.cause, c.variant) for c in rivals if c.cause.key not in first and c.cause in shown]
    return [*(pair for pair in screened.chosen if pair[0].key in first), *before]


def _from_the_best(
    searcher: Rounds, own: Candidate, others: Sequence[Candidate], fitted: Sequence[Candidate]
) -> Candidate:
    """What stands in a place, fitted again from the optimum of what beats it there: that may lie in the others."""
    order = decide.ranked([one.evidence for one in fitted], searcher.settings)
    if not order or fitted[order[0]] is own:
        return own
    start = {**middle(*own.fits), **middle(*fitted[order[0]].fits)}
    again = searcher.judged(searcher.fit_both(searcher.parameters((*others, own)), start))
    better = again.blocks.sum() < own.blocks.sum()
    return searcher.candidate(own.cause, own.variant, again) if better else own


def _known(
    searcher: Rounds, rivals: Sequence[Candidate], others: Sequence[Candidate], fitted: Sequence[Candidate]
) -> list[Candidate]:
    """What did about as well in a place before and was passed over now, from where it was fitted then."""
    keys = {one.cause.key for one in fitted}
    near = [one for one in rivals if one.best > searcher.settings.rival_win_rate or one.cause.key in searcher.replaced]
    extended = searcher.parameters(others)
    return [
        searcher.finalist(
            extended, searcher.fit_sketch(merge(extended, one.variant), middle(*one.fits)), one.cause, one.variant
        )
        for one in near
        if one.cause.key not in keys and TOGETHER not in one.cause.key
    ]


def _put(searcher: Rounds, found: Found, place: int, first: Candidate | None, without: Judged) -> None:
    """Put another cause, or none, in the place of one that is not tried again."""
    searcher.replaced.add(found.accepted[place].cause.key)
    found.accepted[place : place + 1] = [] if first is None else [first]
    found.rounds[:] = [step for step in found.rounds if step.accepted]
    found.put(without if first is None else searcher.of(first), "" if first is None else first.cause.key)
