"""Joints of a robot as they were searched, and how they are judged once more."""

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

Asked = Mapping[str, tuple[Sequence[Array] | None, Finding]]
"""Joints to be diagnosed again: what is added to their terms in each run, and the finding that says so."""
Again = Callable[[Asked], Sequence[JointDiagnosis]]
"""Diagnoses joints again, in their order."""


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
