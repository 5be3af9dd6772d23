"""A search of a log of many motions, led by what the fastest of them names.

What one motion alone reaches, as a sweep does the acceleration limit of a servo, is little of the loss of all of them:
causes that stand in for it in the rest come first, and the search goes astray. Sought in that motion, it comes first.
What is found there must pay on all data, and all causes may be added to it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..log.parts import FIT_A, FIT_B
from ..replay.problem import JointProblem, Problem
from .loose import beside_refitted, charged, search_loosely
from .result import Search

if TYPE_CHECKING:
    from .forward import Searcher

RUNS = 3  # that a log must have
LENGTH = 120.0  # [s] that is judged of them, at least: shorter ones are searched as a whole
OWN = 20.0  # [s] the same of the run itself
MOST = 0.5  # of the data that the run may be: else all is about the same
FASTER = 2.0  # times the mean speed that is commanded in the others that its own is

AnyProblem = TypeVar("AnyProblem", bound=Problem)


def search_led(searcher: Searcher, find: Callable[[Searcher], Sequence[Search]]) -> Search:
    """What is found led by the fastest run, where there is one.

    Args:
        searcher: of all data.
        find: how it is sought where nothing leads: within the tolerance of the numbers or beside refitted ones, what is
            to be taken last.
    """
    problem = searcher.both
    run = None if problem.joint is None else fastest(problem.joint)
    if run is None:
        return find(searcher)[-1]
    searcher.progress("one run is far faster than the others: seeking in it alone")
    leads = [
        lead for lead in find(replace(searcher, problem=of_run(searcher.problem, run), begun=None)) if lead.accepted
    ]
    if not leads:
        return find(searcher)[-1]
    searcher.progress("seeking what was found there in all runs")
    both = any(lead.loose for lead in leads)
    found = [each for lead in leads if (each := _led(searcher, lead, run, loosely=not both)) is not None]
    if not found:
        return find(searcher)[-1]
    return min(found, key=lambda each: charged(searcher, each))


def _led(searcher: Searcher, lead: Search, run: int, *, loosely: bool) -> Search | None:
    """What is found of all data led by what was found of one run; None where none of that pays.

    Args:
        searcher: of all data.
        lead: what was found of the run.
        run: its number.
        loosely: whether all data are searched beside refitted numbers too, where they ask for it: in the run alone it
            may have been a close thing.
    """
    keys = tuple(candidate.cause.key for candidate in lead.accepted)
    led = replace(searcher, led=keys)
    found = beside_refitted(led) if lead.loose else led.run()
    if loosely:
        led.led = keys  # it has forgotten them where none of them paid any more
        found = search_loosely(led, found)
    if not any(candidate.cause.key in keys for candidate in found.accepted):
        return None
    # a cause that led had none to compete with but those that led too: it is as sure as where it was found
    sure = {candidate.cause.key: candidate.best for candidate in lead.accepted}
    accepted = tuple(replace(c, best=min(c.best, sure.get(c.cause.key, 1.0))) for c in found.accepted)
    rounds = [r for r in lead.rounds if r.accepted]
    removed = {
        candidate.cause.key: float((own.before.sum() - candidate.blocks.sum()) / lead.counts.sum())
        for candidate, own in zip(lead.accepted, rounds, strict=True)
    }
    return replace(found, accepted=accepted, led=removed, leader=run)


def fastest(problem: JointProblem) -> int | None:
    """The run in which a joint is commanded to move far faster than in the others; None where there is none.

    Args:
        problem: the parts that are fitted.
    """
    lengths: dict[int, float] = {}
    ways: dict[int, float] = {}
    for unit, a, b in zip(problem.units, problem.starts[:-1], problem.starts[1:], strict=True):
        a = min(int(a) + unit.judged, int(b) - 1)
        lengths[unit.run] = lengths.get(unit.run, 0.0) + float(problem.time[b - 1] - problem.time[a])
        ways[unit.run] = ways.get(unit.run, 0.0) + float(np.nansum(np.abs(np.diff(problem.goal[a:b]))))
    whole = sum(lengths.values())
    if len(lengths) < RUNS or whole < LENGTH:
        return None
    first = max((run for run in ways if lengths[run] >= OWN), key=lambda run: ways[run] / lengths[run], default=None)
    if first is None or lengths[first] > MOST * whole:
        return None
    others = (sum(ways.values()) - ways[first]) / (whole - lengths[first])
    parts = {unit.part for unit in problem.units if unit.run == first}
    fast = ways[first] > FASTER * others * lengths[first]
    return first if fast and parts >= {FIT_A, FIT_B} else None


def of_run(problem: AnyProblem, run: int, parts: Collection[int] = (FIT_A, FIT_B)) -> AnyProblem:
    """Parts of a problem, by default those that are fitted, of one run alone."""
    kept = tuple(unit if unit.run == run and unit.part in parts else replace(unit, part=-1) for unit in problem.units)
    return replace(problem, units=kept).part(*parts)
