"""A search that begins with the usual causes which the log needs, all found at once.

A search that adds one cause after the other takes what stands in for several first, and mends it with further ones: a
payload, a sag and a resistance were told as another motor, with friction. All that every machine may have, turned
together, has nothing to stand in for; what the log can do without is left out (:mod:`.subsets`).
"""

from __future__ import annotations

from dataclasses import replace

from ..causes.cause import Cause, Variant
from ..log.progress import Milestone
from . import decide
from .fit import Fit, merge
from .look import LOOKED_FOR, looked
from .record import RoundRecord, Step
from .result import Round
from .rounds import Rounds
from .sketch import PLAY
from .state import Found
from .subsets import Choice, Forms, Subset, best_subset, forms_of, neutral

USUAL = (
    *LOOKED_FOR,
    "drive.resistance",
    "drive.motor_constant",
    "friction.stribeck",
    "load.inertia",
    "sensor.offset",
)
"""Causes that every machine may have; stops count where they were read off the log. Play is fitted apart: a replay with
it takes several times as long."""


def usual_causes(searcher: Rounds) -> Subset | None:
    """The usual causes that the log needs, with play only where they leave something without it.

    Args:
        searcher: of the joint.

    Returns:
        None where the log shows no more than the noise without them.
    """
    shown = [cause for cause in searcher.shown if cause.name in USUAL and (cause.seen or not cause.at_stops)]
    if not shown or decide.finished(
        searcher.excess(searcher.fit_both(searcher.tuned, searcher.start)), searcher.settings
    ):
        return None
    searcher.progress("fitting all usual causes at once")
    choice = _choice(searcher, tuple(form for cause in shown for form in forms_of(cause)))
    best = best_subset(choice, looked(choice.problem, choice.parameters(choice.forms), shown))
    play = next((cause for cause in searcher.shown if cause.name == PLAY), None)
    if play is not None and not decide.finished(best.fit.cost - 1.0, searcher.settings):
        best = _with_play(searcher, choice, best, play)
    return best


def begin_with(searcher: Rounds, found: Found, usual: Subset) -> None:
    """Accept causes one after the other, in the order of what they do, as far as each pays.

    Args:
        searcher: of the joint.
        found: nothing yet.
        usual: the causes.
    """
    choice = _choice(searcher, usual.forms)
    kept = {cause.key: (cause, variant) for cause, variant in usual.forms}
    costs = {
        key: choice.fitted(tuple(form for other, form in kept.items() if other != key), usual.fit.values).fit.cost
        for key in kept
    }
    order = sorted(kept, key=costs.__getitem__, reverse=True)
    more = True
    while more:  # what did not pay may do beside those that came after it
        taken = {candidate.cause.key for candidate in found.accepted}
        more = sum(_accept(searcher, found, *kept[key], usual.fit) for key in order if key not in taken) > 0


def _choice(searcher: Rounds, forms: Forms) -> Choice:
    settings = searcher.settings
    return Choice(
        searcher.sketch, searcher.tuned, forms, searcher.nominal,
        charge=settings.parameter_charge, open_excess=settings.open_excess, gain=settings.least_open_gain,
    )  # fmt: skip


def _with_play(searcher: Rounds, choice: Choice, usual: Subset, play: Cause) -> Subset:
    """The best with play, of all its laws, if it is better than the best without; motor and link then turn apart."""
    apart = (cause.parted() for cause in dict.fromkeys(cause for cause, _ in choice.forms))
    at_motor = tuple(form for cause in apart for form in forms_of(cause))
    ways = [replace(choice, forms=(*at_motor, (play, variant))) for variant in play.variants]
    start = {**neutral(replace(choice, forms=at_motor)), **usual.fit.values}  # of play, where its form begins
    laws: dict[frozenset[str], tuple[Subset, Choice]] = {}  # of one law, the start from which it fits best
    for number, way in enumerate(ways, 1):
        searcher.progress(f"fitting them with play, form {number} of {len(ways)}")
        full = way.fitted(way.forms, start, searcher.settings.iterations)
        law = frozenset(p.path for p in way.forms[-1][1])
        laws[law] = min(laws.get(law, (full, way)), (full, way), key=lambda pair: pair[0].charged)
    best = usual
    for full, way in sorted(laws.values(), key=lambda pair: pair[0].fit.cost):
        needed = way.forms[-1:]
        if way.least(needed, full.fit.cost) < best.charged:
            searcher.progress("asking which of them the log can do without")
            best = best_subset(way, full.fit, needed, best)
    return best


def _accept(searcher: Rounds, found: Found, cause: Cause, variant: Variant, fitted: Fit) -> bool:
    """Accept one cause more, if it pays on data that its fit did not see; whether it does."""
    before, settings = found.current, searcher.settings
    excess = searcher.excess(before.fits)
    if decide.finished(excess, settings) or len(found.accepted) >= settings.most_causes:
        return False
    judged = searcher.judged(searcher.fit_both(merge(searcher.parameters(found.accepted), variant), fitted.values))
    candidate = searcher.candidate(cause, variant, judged)
    record = RoundRecord(
        searcher.counts, before.blocks, before.sampled, excess, excess, promise=excess,
        candidates=(replace(candidate.evidence, excess=searcher.excess(judged.fits)),), led=True,
    )  # fmt: skip
    order, stands = searcher.standings(record, [candidate])  # nothing where the log contradicts it
    if not decide.one_pays(record, order, settings, further=bool(found.accepted)):
        return False
    candidate = stands[0]
    searcher.progress(Milestone(f"found {cause.key} (removes {100 * candidate.gain:.0f} % of what was left)"))
    found.accepted.append(candidate)
    found.rounds.append(Round(record.before, (candidate,), True, excess))
    found.steps.append(Step(record, cause.key))
    found.put(judged)
    return True
