"""The ways of a search of one joint, each tried where the one before leaves something open."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .changed import with_changed_numbers
from .led import search_led
from .loose import search_loosely
from .result import Search
from .tied import search_tied

if TYPE_CHECKING:
    from .forward import Searcher


def seek(searcher: Searcher) -> Search:
    """What is found of a joint: led by its fastest run where one stands out, and beside refitted numbers.

    Of these numbers, those that the data need are causes, too.
    """
    return with_changed_numbers(searcher, search_led(searcher, _ways))


def _ways(searcher: Searcher) -> tuple[Search, ...]:
    """What is found within the tolerance of the numbers, and what is taken in the end; one where they are the same."""
    first = searcher.run()
    taken = search_tied(searcher, search_loosely(searcher, first))
    return (first, taken) if taken.loose else (taken,)
