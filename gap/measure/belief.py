"""Joints of a robot that numbers within their tolerance bring as near as the believed robot can: nothing to explain.

Other bodies of a robot are believed, its neighbours move as they were read, and whoever made the log had a step, too:
small errors of all of these look like a cause now and then, mostly like an inertia. So no cause is named there that is
not certain.

A joint that follows torques has no goal that holds its replay near the log. What adds up there is counted as where no
cause is sought (:mod:`sealegs.gap.measure.adrift`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..search.result import Search
from .case import Replay
from .confidence import THRESHOLDS
from .measured import Measured, measure
from .named import NEAR_MISS, OpenCause
from .unseen import crossed_errors


def measured_within_belief(replay: Replay, search: Search, joint: str, seed: int) -> tuple[Measured, Search]:
    """What a search found, measured; and the search without its causes, where the joint has nothing to explain.

    Args:
        replay: of the joint.
        search: what was found.
        joint: its name.
        seed: of all resampling.
    """
    measured = measure(replay, search, joint, seed)
    if search.loose or not _is_doubtful(replay, measured):
        return measured, search
    times = _without(replay, measured, search)
    near = times <= THRESHOLDS.believed
    if not (near or replay.problem.open_loop):
        return measured, search
    less = search.less([candidate.cause.key for candidate in search.accepted])
    again = measure(replay, less, joint, seed)
    if not (near or (again.adrift is not None and again.adrift.allows(replay.problem.noise))):
        return measured, search
    why = "without it, no more is left than adds up in a replay that no goal holds"
    if near:
        why = f"numbers within their tolerance come within {times:.3g} times the noise without it"
        why += ", as those of any robot may"
    found = tuple(OpenCause(cause.name, NEAR_MISS, why) for cause in measured.causes)
    return replace(again, open_causes=(*found, *measured.open_causes)), less


def _is_doubtful(replay: Replay, measured: Measured) -> bool:
    """Whether it is a joint of a robot with causes of which none is certain."""
    sure = any(cause.confidence >= THRESHOLDS.certain for cause in measured.causes)
    return replay.of_robot and bool(measured.causes) and not sure


def _without(replay: Replay, measured: Measured, search: Search) -> float:
    """Error of the tuned model without causes, on all that its fits did not see, in noise floors."""
    problem = replay.problem
    halves = crossed_errors(problem, [fit.values for fit in search.base])
    unseen = float(np.sqrt(np.mean(halves**2)))
    return max(unseen, measured.tuned_error.rmse) / problem.noise
