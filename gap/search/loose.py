"""A second search, where the nominal numbers are off by more than their tolerance beside the causes.

A chain made for another motor has every number wrong, and an effect missing too. The first search holds the numbers
within their tolerance, and one cause after the other then stands in for them. Where data that no fit saw say so, causes
are sought once more on top of the refitted numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..causes.cause import Cause
from ..replay.parameters import Parameter
from ..replay.problem import Problem
from .forward import Searcher
from .result import Search

WEIGHT = "load.mass"


def search_loosely(searcher: Searcher, found: Search) -> Search:
    """What is found on top of refitted numbers, where that is something and better; else what was found.

    Both are charged for each parameter of their causes, and the second for each number that it refits.

    Args:
        searcher: that found something.
        found: by it.
    """
    tight = _blocks(searcher, found)
    far = searcher.held_back(found.fits) and searcher.excess(found.fits) > searcher.settings.open_excess
    if not (far or searcher.refitting_beats(found.accepted, found.fits, tight)):
        return found
    searcher.progress("its numbers are off by more than their tolerance: seeking causes beside refitted numbers")
    loose = beside_refitted(searcher)
    return loose if loose.accepted and charged(searcher, loose) < charged(searcher, found) else found


def beside_refitted(searcher: Searcher) -> Search:
    """What a searcher finds on top of refitted numbers."""
    unmeasured = _torque_is_open(searcher.problem)
    causes = [
        cause
        for cause in searcher.considered
        if not (_turned_anyway(cause, searcher.wide) or (unmeasured and cause.name == WEIGHT))
    ]
    found = replace(searcher, causes=causes, tuned=searcher.wide, wide=()).run()
    return replace(found, causes=searcher.considered, loose=True)


def charged(searcher: Searcher, found: Search) -> float:
    """Loss of what was found, with a charge for each parameter of its causes and each number that it refits."""
    turned = sum(p.factor for p in found.tuned) if found.loose else 0
    charge = searcher.settings.parameter_charge * (sum(candidate.flexibility for candidate in found.accepted) + turned)
    return float(_blocks(searcher, found).sum()) * (1.0 + charge)


def _torque_is_open(problem: Problem) -> bool:
    """Whether nothing in a robot's log is a torque: a refitted motor and another mass then stand in for each other.

    A slide was handed over with a fifth of its mass behind a motor with five times its resistance.
    """
    shown = zip(problem.channels, problem.weight, strict=True)
    measured = any(weight for name, weight in shown if name in ("torque", "current"))
    return problem.joint is not None and problem.joint.models[0].of_robot and not measured


def _blocks(searcher: Searcher, found: Search) -> np.ndarray:
    """Loss per block (b,) of the model that was found."""
    return found.accepted[-1].blocks if found.accepted else searcher.judged(found.base).blocks


def _turned_anyway(cause: Cause, wide: Sequence[Parameter]) -> bool:
    """Whether a wrong number is among those that are refitted, as far as the cause would turn it."""
    (first, *others) = cause.variants[0]
    known = next((p for p in wide if p.number == first.number and p.factor == first.factor), None)
    within = known is not None and not others and known.low <= first.low and first.high <= known.high
    return cause.error and within
