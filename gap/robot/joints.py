"""Joints of a robot as they were searched, and how they are judged with what is known of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from ..causes.catalogue import adjustable
from ..log.finding import Finding
from ..log.types import Array
from ..replay.problem import JointProblem
from ..search.result import Search
from ..search.settings import SearchSettings
from ..search.windows import in_windows
from ..verdict.verdict import JointDiagnosis


@dataclass(frozen=True, eq=False)
class Known:
    """What is known of a joint from the others.

    Attributes:
        more: what is added to the load that the robot's file gives it, in each run (samples, T_SIZE); None: nothing.
        notes: findings that say so.
        begun: what was found of the joint first; None where it is another with what is known.
    """

    more: Sequence[Array] | None = None
    notes: tuple[Finding, ...] = ()
    begun: Search | None = None

    def also(self, more: Sequence[Array] | None, *notes: Finding) -> Known:
        """With what else is known of it."""
        rows = self.more if more is None else more
        if more is not None and self.more is not None:
            rows = [a + b for a, b in zip(self.more, more, strict=True)]
        return Known(rows, (*self.notes, *notes), self.begun if more is None else None)


NOTHING_KNOWN = Known()
Again = Callable[[Mapping[str, Known]], Sequence[JointDiagnosis]]
"""Seeks what joints have once more, in their order."""


@dataclass(frozen=True, eq=False)
class Joints:
    """What is known of the joints that were replayed freely: problem and search by name."""

    problems: Mapping[str, JointProblem]
    searches: Mapping[str, Search]


def joints_of(found: Sequence[JointDiagnosis], settings: SearchSettings) -> Joints:
    """Problems and searches of the joints that were replayed freely."""
    problems, searches = {}, {}
    for diagnosis in found:
        problem, search = None if diagnosis.problem is None else diagnosis.problem.joint, diagnosis.search
        if problem is not None and problem.terms is not None and search is not None:
            problems[diagnosis.joint] = in_windows(
                problem, adjustable(problem.models[0], settings.refitted_by), settings
            )
            searches[diagnosis.joint] = search
    return Joints(problems, searches)
