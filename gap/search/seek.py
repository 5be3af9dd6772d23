"""The ways of a search of one joint, each tried where the one before leaves something open."""

from __future__ import annotations

from dataclasses import replace

from .changed import with_changed_numbers
from .forward import NUMERICAL, Searcher
from .led import search_led
from .loose import charged, search_loosely
from .result import Search
from .subsets import Subset
from .tied import leaves_tie, search_tied
from .usual import usual_causes

SEVERAL = 2  # causes, of which a search that adds one at a time may take what stands in for both


def seek(searcher: Searcher) -> Search:
    """What is found of a joint: led by its fastest run where one stands out, and beside refitted numbers.

    Of these numbers, those that the data need are causes, too.
    """
    return with_changed_numbers(searcher, search_led(searcher, _ways))


def begun(searcher: Searcher) -> Search:
    """What is found of a joint beginning with its usual causes, in the place of none of which another is sought.

    It says enough of a joint for what others share with it, and takes a part of the time. Where a log does not show
    several of them, causes are added one after the other. Then others are sought in their places, too.
    """
    usual = _usual(searcher)
    return searcher.run(usual, asked=usual is None)


def _usual(searcher: Searcher) -> Subset | None:
    """The usual causes that the log needs, where they are several."""
    try:
        usual = usual_causes(searcher)
    except NUMERICAL as error:
        searcher.progress(f"the fit of all usual causes failed numerically ({type(error).__name__}: {error})")
        return None
    return None if usual is None or len(usual.forms) < SEVERAL else usual


def _ways(searcher: Searcher) -> tuple[Search, ...]:
    """What is found within the tolerance of the numbers, and what is taken in the end; one where they are the same."""
    first, usual = from_usual(searcher)
    taken = search_tied(searcher, search_loosely(searcher, first), usual)
    return (first, taken) if taken.loose else (taken,)


def from_usual(searcher: Searcher) -> tuple[Search, Subset | None]:
    """What is found from nothing, or beginning with the usual causes that the log needs, where they are several.

    The better is taken; of two as good, the one with fewer causes. Where the usual ones leave little, only a
    single cause is sought from nothing.

    Returns:
        With the causes that it began with, if it did.
    """
    begun = searcher.begun
    usual = _usual(searcher) if begun is None else begun.usual
    if usual is None:
        return searcher.run(usual) if begun is None else begun, None
    found = searcher.run(usual, begun=begun)
    explained = bool(found.accepted) and not searcher.excess(found.fits) > searcher.settings.open_excess
    other = replace(searcher).run(single=explained)
    if not (found.accepted and other.accepted):
        return (found, usual) if found.accepted else (other, None)
    (here, used), (there, needed) = _worth(searcher, found), _worth(searcher, other)
    alike = abs(there - here) <= searcher.settings.shared_error * max(here, there, float(searcher.counts.sum()))
    if not (needed < used if alike else there < here):
        return found, usual
    return replace(searcher).run() if explained else other, None


def _worth(searcher: Searcher, found: Search) -> tuple[float, int]:
    """Charged loss of a search, and its causes; where it ended on a tie, with the best of what fits alike."""
    loss, count = charged(searcher, found), len(found.accepted)
    if not leaves_tie(searcher, found):
        return loss, count
    last = next(step.round for step in reversed(found.record.steps) if step.place is None)
    best = min(float(one.blocks.sum()) for one in last.candidates)
    return best * (1.0 + searcher.settings.parameter_charge * (count + 1)), count + 1
