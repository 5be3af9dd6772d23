"""A second way of a search, by a cause that came close round after round and was never chosen.

One cause at a time goes astray where two belong together: alone, neither does as well as a number that stands in for
both. What stays close after that number is taken is something else than it, and is tried in its place.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..checks.bootstrap import block_weights
from .loose import flexibility
from .result import Search

if TYPE_CHECKING:
    from .forward import Searcher

ROUNDS = 2  # in which it must have come close
CLOSE = 0.05  # share of the draws in which it was the best


def search_contender(searcher: Searcher, found: Search) -> Search:
    """What is found with the contender in the place of what was chosen before it, where that is better; else what was
    found. Both are charged for each parameter of their causes.

    Args:
        searcher: that found something.
        found: by it.
    """
    sought = contender(found)
    if sought is None or searcher.excess(found.fits) <= searcher.settings.open_excess:
        return found
    keys, name = sought
    searcher.progress(f"{name} came close throughout: trying it first")
    other = replace(searcher, led=keys).run()
    if name not in [candidate.cause.key for candidate in other.accepted]:
        return found
    charge = searcher.settings.parameter_charge
    mine, its = (one.accepted[-1].blocks * (1.0 + charge * flexibility(one)) for one in (other, found))
    if not mine.sum() < its.sum():
        return found
    weights = block_weights(len(mine), searcher.settings.draws, np.random.default_rng(searcher.seed))
    sure = float((weights @ mine < weights @ its).mean())
    accepted = tuple(replace(c, best=min(c.best, sure)) if c.cause.key in keys else c for c in other.accepted)
    return replace(other, accepted=accepted)


def contender(found: Search) -> tuple[tuple[str, ...], str] | None:
    """What to begin another search with, the contender last: what was chosen before it first came close; None where no
    cause came close in rounds enough.
    """
    chosen = [candidate.cause.key for candidate in found.accepted]
    close: dict[str, list[tuple[int, float]]] = {}
    for k, each in enumerate(found.rounds):
        for candidate in each.candidates:
            if candidate.best >= CLOSE and candidate.better >= 0.5 and candidate.cause.key not in chosen:
                close.setdefault(candidate.cause.key, []).append((k, candidate.best))
    often = {key: rounds for key, rounds in close.items() if len(rounds) >= ROUNDS and rounds[0][0] < len(chosen)}
    if not often:
        return None
    key = max(often, key=lambda each: sum(best for _, best in often[each]))
    return (*chosen[: often[key][0][0]], key), key
