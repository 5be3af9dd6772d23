"""A search that goes on where several causes remove much and none wins alone: one is named, the others are its rivals.

Three laws of dry friction that fit alike took half of what a double pendulum had left, and none was named. It comes
last: what refitted numbers or a single cause explain is explained by these.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from .decide import decide
from .record import SearchRecord
from .result import Search
from .settings import SearchSettings

if TYPE_CHECKING:
    from .forward import Searcher
    from .subsets import Subset

GAIN = 0.2  # share of what is left that they must remove
NEVER = 1.0  # which nothing exceeds


def search_tied(searcher: Searcher, found: Search, usual: Subset | None) -> Search:
    """What is found with ties named, where a search ended on one; else what was found.

    Args:
        searcher: that found something.
        found: by it, or beside refitted numbers.
        usual: causes that it began with.
    """
    if found.loose or not leaves_tie(searcher, found):
        return found
    searcher.progress("several causes fit alike and remove much: going on with one of them")
    return replace(searcher, settings=replace(searcher.settings, shared_win_gain=GAIN)).run(usual)


def leaves_tie(searcher: Searcher, found: Search) -> bool:
    """Whether a search ended on a tie that it did not name."""
    named = found.settings.shared_win_gain == GAIN
    return not named and ended_tied(found.record, replace(searcher.settings, shared_win_gain=GAIN))


def ended_tied(record: SearchRecord, settings: SearchSettings) -> bool:
    """Whether a search whose settings name no ties would have named one more cause with these."""
    without = replace(settings, shared_win_gain=NEVER)
    return len(decide(record, settings).names) > len(decide(record, without).names)
