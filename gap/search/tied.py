"""A search that goes on where several causes remove much and none wins alone: one is named, the others are its rivals.

Three laws of dry friction that fit alike took half of what a double pendulum had left, and none was named. It comes
last: what refitted numbers or a single cause explain is explained by these.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from .decide import one_pays, pays, standings
from .record import SearchRecord
from .result import Search
from .settings import SearchSettings

if TYPE_CHECKING:
    from .forward import Searcher

GAIN = 0.2  # share of what is left that they must remove


def search_tied(searcher: Searcher, found: Search) -> Search:
    """What is found with ties named, where a search ended on one; else what was found.

    Args:
        searcher: that found something.
        found: by it, or beside refitted numbers.
    """
    settings = replace(searcher.settings, shared_win_gain=GAIN)
    if found.loose or not ended_tied(found.record, settings):
        return found
    searcher.progress("several causes fit alike and remove much: going on with one of them")
    return replace(searcher, settings=settings).run()


def ended_tied(record: SearchRecord, settings: SearchSettings) -> bool:
    """Whether the last round of a search named nothing for want of a cause that wins alone."""
    if not record.steps or record.steps[-1].winner is not None:
        return False
    last, further = record.steps[-1].round, len(record.steps) > 1
    order = standings(last, settings, record.seed)
    tied = one_pays(last, order, settings, further=further)
    return tied and not pays(last, order[0], settings, further=further)
