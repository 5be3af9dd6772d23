"""The ways of a search of one joint, each tried where the one before leaves something open."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from .changed import with_changed_numbers
from .decide import finished
from .led import search_led
from .loose import charged, search_loosely
from .result import Search
from .tied import ended_tied, naming_ties, search_tied

if TYPE_CHECKING:
    from .forward import Searcher

SEVERAL = 3  # causes, of which the first may be two of another kind that the second and third only mend


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
    """What is found where the cause that came first is left out, if something stayed beside it and less does then.

    A cause that stands in for several together comes before each of them, as a higher resistance does for a heavier
    rotor and a heavier load, and in its place alone none of them does as well. Where causes that fit alike explain what
    stayed, the first one is right.
    """
    tied = ended_tied(found.record, naming_ties(searcher.settings))
    if not found.accepted or tied or not _leaves(searcher, found):
        return found
    first = found.accepted[0].cause.key
    searcher.progress(f"something stays beside {first}: seeking without it")
    causes = [cause for cause in searcher.considered if cause.key != first]
    without = replace(searcher, causes=causes)
    other = replace(search_tied(without, without.run()), causes=searcher.considered)
    return other if other.accepted and charged(searcher, other) < charged(searcher, found) else found


def _leaves(searcher: Searcher, found: Search) -> bool:
    """Whether a search left much, or anything at all beside several causes that may each mend what another is not."""
    left = searcher.excess(found.fits)
    several = len(found.accepted) >= SEVERAL and not finished(left, searcher.settings)
    return several or left > searcher.settings.open_excess
