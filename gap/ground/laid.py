"""A legged log laid out for a search of its ground, whatever the robot, and what that ground may be."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..causes.catalogue import checked
from ..causes.cause import Cause
from ..causes.registry import alone
from ..log.finding import Finding
from ..log.parts import FIT_A, FIT_B, PARTS
from ..replay.parameters import Parameter
from .problem import GroundProblem

CONTACT_TIME_FACTOR = 3.0
"""Factor on the time constant of the engine's contact that fits may take: it stands for no number of the machine."""
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


def ground_causes(
    stiffness: Sequence[float],
    stiffest: float,
    soft: float,
    shown: Mapping[str, str],
    slopes: Sequence[str] = ("contact.slope",),
    names: Sequence[str] | None = None,
    *,
    damped: bool = True,
) -> list[Cause]:
    """The catalogue of the ground under a robot.

    Args:
        stiffness: from which fits of soft ground start [N/m].
        stiffest: ground that still counts as soft [N/m].
        soft: ground that is plausible [N/m].
        shown: column that shows each cause best, by its name.
        slopes: numbers of the ground's slope; those that the robot can feel.
        names: of the causes to consider; default: all of them.
        damped: whether the damping of soft ground is fitted with it; else it is tuned in every fit.
    """
    friction = Parameter("contact.friction", "1", 0.05, 4.0, 0.4, 0.2, logarithmic=True, factor=True)
    damping = Parameter("contact.damping", "N.s/m", 1.0, 300.0, 20.0, 0.4, logarithmic=True, shape=True)
    soft_ground = Parameter("contact.stiffness", "N/m", 200.0, stiffest, stiffness[0], 0.3, logarithmic=True)
    gives = [(*variant, damping) if damped else variant for variant in alone(soft_ground, *stiffness)]
    slope = tuple(Parameter(name, "rad", -0.4, 0.4, 0.0, 0.01) for name in slopes)
    every = [
        Cause(
            name="contact.friction",
            sentence="The foot slides on less, or holds on more, friction than the model has.",
            picture="stance",
            against=shown["contact.friction"],
            plausible={"contact.friction*": 0.5},
            variants=alone(friction, 0.4, 0.8),
            error=True,
        ),
        Cause(
            name="contact.stiffness",
            sentence="The ground gives way under the foot.",
            picture="stance",
            against=shown["contact.stiffness"],
            plausible={"contact.stiffness": soft},
            variants=tuple(gives),
        ),
        Cause(
            name="contact.slope",
            sentence="The ground is not level.",
            picture="stance",
            against=shown["contact.slope"],
            plausible={slopes[0]: 0.02},
            variants=(slope,),
        ),
    ]
    return [cause for cause in every if cause.name in checked(names)]
