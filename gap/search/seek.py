"""The ways of a search of one joint, each tried where the one before leaves something open."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from .changed import with_changed_numbers
from .led import search_led
from .loose import charged, search_loosely
from .result import Search
from .tied import leaves_tie, search_tied

if TYPE_CHECKING:
    from .forward import Searcher


def seek(searcher: Searcher) -> Search:
    """What is found of a joint: led by its fastest run where one stands out, and beside refitted numbers.

    Of these numbers, those that the data need are causes, too.
    """
    return with_changed_numbers(searcher, search_led(searcher, _ways))


def _ways(searcher: Searcher) -> tuple[Search, ...]:
    """What is found within the tolerance of the numbers, and what is taken in the end; one where they are the same."""
    first = without_the_first(searcher, searcher.run())
    taken = search_tied(searcher, search_loosely(searcher, first))
    return (first, taken) if taken.loose else (taken,)


def without_the_first(searcher: Searcher, found: Search) -> Search:
    """What is found where the cause that came first is left out, if much stays beside it and what is found then is
    better, or as good with fewer causes.

    A cause that stands in for several together comes before each of them, as a higher resistance does for a heavier
    rotor and a heavier load: in its place alone none of them does as well, and further causes mend what it is not.
    """
    if not found.accepted or not searcher.excess(found.fits) > searcher.settings.open_excess:
        return found
    first = found.accepted[0].cause.key
    searcher.progress(f"seeking without {first}")
    causes = [cause for cause in searcher.considered if cause.key != first]
    without = replace(searcher, causes=causes)
    other = replace(search_tied(without, without.run()), causes=searcher.considered)
    if not other.accepted:
        return found
    (here, used), (there, needed) = _worth(searcher, found), _worth(searcher, other)
    alike = abs(there - here) <= searcher.settings.shared_error * max(here, there, float(searcher.counts.sum()))
    return other if (needed < used if alike else there < here) else found


def _worth(searcher: Searcher, found: Search) -> tuple[float, int]:
    """Charged loss of a search, and its causes; where it ended on a tie, with the best of what fits alike."""
    loss, count = charged(searcher, found), len(found.accepted)
    if not leaves_tie(searcher, found):
        return loss, count
    last = next(step.round for step in reversed(found.record.steps) if step.place is None)
    best = min(float(one.blocks.sum()) for one in last.candidates)
    return best * (1.0 + searcher.settings.parameter_charge * (count + 1)), count + 1
