"""What a log could not show: causes that would have left no trace in its motion, had they been there."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from ..causes.catalogue import adjustable, catalogue
from ..log.parts import FIT_A, FIT_B, Unit
from ..log.types import MeasuredRun
from ..replay.free import free_problem
from ..replay.joint_model import JointModel
from ..replay.problem import JointProblem
from ..search.fit import Fit
from ..search.result import Search
from ..search.torque_gauge import is_open
from .excitations import Limits
from .proposal import VISIBLE_DIFFERENCE, Experiment, everything, predict, propose, thinned, unlike

MAX_BLIND_SHARE = 0.25
"""Share of the catalogue that a log may be unable to show for "nothing to explain" to mean something."""
ASSUMED_NOISE = 5e-4  # [rad] of an encoder whose log never moves: a tick of 4096 a turn, and as much noise


def unseen(problem: JointProblem, search: Search) -> tuple[str, ...]:
    """Causes of the catalogue which, at a plausible size, the log would hardly show beside what may be tuned."""
    none, *causes = everything(problem, search)
    old = thinned(problem.part(FIT_A, FIT_B))
    nothing = predict(old, none)
    hidden = []
    # numbers of a joint whose log leaves all torques open hide behind each other in any motion, up to their tolerance
    behind = {p.number for p in search.tuned} if is_open(problem.models[0]) else set()
    behind = {cause.name for cause in search.causes if cause.error and cause.variants[0][0].number in behind}
    for cause in causes:
        if cause.name in behind:
            continue
        there = predict(old, cause)
        if unlike(there, nothing, there, nothing) < VISIBLE_DIFFERENCE:
            hidden.append(cause.name)
    return tuple(hidden)


def blind_spots(problem: JointProblem, search: Search, held: Collection[str] = ()) -> tuple[str, ...]:
    """Causes that a log could not show, where they are so many that finding nothing in it means nothing.

    Args:
        problem: of the log.
        search: what was found in it.
        held: causes that were not sought, since a link that moves as measured shows none of them.
    """
    hidden = (*held, *unseen(problem, search))
    return hidden if too_many(len(hidden), len(held) + len(everything(problem, search)) - 1) else ()


def too_many(hidden: int, considered: int) -> bool:
    """Whether so many hidden causes, of those considered, make finding nothing worthless.

    One of a few that somebody asked for does not: a number of the model may be a few per cent off unseen in any log.
    """
    return 0 < hidden == considered or hidden > max(MAX_BLIND_SHARE * considered, 1)


def experiment_for_still(
    runs: Sequence[MeasuredRun],
    joint: str,
    models: Sequence[JointModel],
    limits: Limits | None = None,
    seed: int = 0,
    causes: Sequence[str] | None = None,
) -> Experiment | None:
    """The measurement to begin with where a joint was never moved: it tells all causes apart, or those named."""
    units = [Unit(0, FIT_A, 0, len(runs[0].time), 1, (float(runs[0].joints[joint].position[0]), 0.0))]
    problem = free_problem(runs[:1], joint, models[:1], units, {"position": 1.0 / ASSUMED_NOISE})
    start = Fit({}, np.empty((0, 4)), 0.0)
    considered = tuple(catalogue(models[0], causes))
    search = Search(tuple(adjustable(models[0])), (), (), np.ones(1), (start, start), considered)
    return propose(problem, search, limits, seed, blind=True)
