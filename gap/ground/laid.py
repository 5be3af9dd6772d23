"""A legged log laid out for a search of its ground, whatever the robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..causes.cause import Cause
from ..log.finding import Finding
from ..log.parts import FIT_A, FIT_B, PARTS
from ..replay.parameters import Parameter
from .problem import GroundProblem

MIN_PIECES = 3 * len(PARTS)  # pieces, three for each part of the data


@dataclass(frozen=True, eq=False)
class Laid:
    """Pieces of a log, and what is sought in them.

    Attributes:
        problem: the pieces.
        causes: the catalogue, or those of the names that are given.
        tuned: numbers of the ground that every fit tunes, and refits.
        pieces: what they are called.
        advice: what would show what they do not.
        findings: about the log.
        needs_joints: whether drives take part in a replay, so that their errors may look like the ground's.
        by_worst: whether the gap is told in the column where the nominal robot is most wrong; else in the first.
    """

    problem: GroundProblem
    causes: Callable[[Sequence[str] | None], list[Cause]]
    tuned: tuple[Parameter, ...]
    pieces: str
    advice: str
    findings: tuple[Finding, ...] = ()
    needs_joints: bool = False
    by_worst: bool = False

    def told(self, problem: GroundProblem) -> GroundProblem:
        """The problem with its gap told in the column where that is to be."""
        if not self.by_worst:
            return problem
        fitted = problem.part(FIT_A, FIT_B)
        errors = fitted.errors(fitted.simulate([{}])[0]) * fitted.weight
        used = fitted.weight > 0.0
        size = np.where(used, np.nan_to_num(np.nanmean(np.where(used, errors, 0.0) ** 2, axis=0)), -1.0)
        return replace(problem, told_in=int(np.argmax(size)))


def too_few(count: int, tested: int, held: bool, group: str | None, pieces: str) -> str | None:
    """Why pieces are too few for three parts of the data, in a sentence; None where they are enough.

    Args:
        count: of all pieces.
        tested: of them in the group that is kept for the test.
        held: whether there is one.
        group: its name.
        pieces: what they are called.
    """
    if held and (tested < MIN_PIECES // 3 or count - tested < MIN_PIECES - MIN_PIECES // 3):
        return (
            f"of {count} {pieces} {tested} are in the group '{group}'; {MIN_PIECES // 3} are needed there to "
            f"test on and {MIN_PIECES - MIN_PIECES // 3} in the others to fit on."
        )
    return None
