"""When a candidate is no more than another, simpler one, or nothing at all."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from ...actuators.chain import GIVING
from ..causes.cause import Cause, Variant
from ..replay.parameters import Parameter
from ..replay.problem import Nominal, Problem
from .fit import Fit
from .met import unmet
from .result import Candidate
from .settings import SearchSettings


def elaborates(candidate: Candidate, simple: Candidate, settings: SearchSettings) -> bool:
    """Whether a candidate turns all that another cause turns and more, and is not much the better for it."""
    more, fewer = ({p.number for p in c.variant} for c in (candidate, simple))
    charged = settings.form_charge * float(candidate.blocks.sum())
    return candidate.cause is not simple.cause and more > fewer and charged > float(simple.blocks.sum())


def at_bound(candidate: Candidate) -> bool:
    """Whether a number of a candidate is at a bound in both parts of the data."""
    return any(all(p.path in found.at_bound for found in candidate.fits) for p in candidate.variant)


def contradicted(problem: Problem, cause: Cause, variant: Variant, fits: Sequence[Fit]) -> float:
    """Share of the samples that show a cause is not there, such as duties above a limit that was fitted.

    All of them do where nothing pushes a joint on to a stop.
    """
    joint = problem.free_joint
    if cause.at_stops and joint is not None:
        return float(any(unmet(joint, variant, found.values) for found in fits))
    limit = cause.refuted_by
    if limit is None or limit.channel not in problem.channels:
        return 0.0
    column = problem.channels.index(limit.channel)
    if problem.weight[column] == 0.0:
        return 0.0
    return limit.exceeded(problem.measured[:, column], [found.values for found in fits], problem.models[0])


def without_friction(causes: Iterable[Cause], turned: Iterable[Parameter], nominal: Nominal) -> set[str]:
    """Keys of causes that change dry friction, where there is none: neither nominal nor among what is turned."""
    asked = {cause.key for cause in causes if cause.needs.dry_friction}
    dry = "friction.coulomb"
    has = not asked or any(p.number == dry for p in turned) or nominal.value(dry) > 0.0
    return set() if has else asked


def gives(turned: Iterable[Parameter]) -> bool:
    """Whether what is turned lets motor and link turn apart."""
    return any(p.number.partition(".")[0] in GIVING for p in turned)


def visited(problem: Problem) -> float:
    """Range of a joint's logged positions [rad]; infinite, so that it excludes nothing, where there are none.

    The position is not the first channel where a driven joint is judged by its torque.
    """
    if "position" not in problem.channels:
        return math.inf
    positions = problem.measured[problem.judged, problem.channels.index("position")]
    known = positions[np.isfinite(positions)]
    return float(np.ptp(known)) if len(known) else math.inf
