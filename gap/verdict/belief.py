"""Joints of a robot that numbers within their tolerance bring as near as the believed robot can: nothing to explain.

Other bodies of a robot are believed, its neighbours move as they were read, and whoever made the log had a step, too:
small errors of all of these look like a cause now and then, mostly like an inertia. So no cause is named there that is
not certain.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..search.result import Search
from .case import Replay
from .evidence import THRESHOLDS
from .measure import Measured, is_of_robot, measure
from .unseen import crossed_errors
from .verdict import NEAR_MISS, OpenCause


def measured_within_belief(replay: Replay, search: Search, joint: str, seed: int) -> tuple[Measured, Search]:
    """What a search found, measured; and the search without its causes, where the joint has nothing to explain.

    Args:
        replay: of the joint.
        search: what was found.
        joint: its name.
        seed: of all resampling.
    """
    measured = measure(replay.problem, replay.fitting, search, joint, replay.wide, seed)
    if search.loose or not _is_near(replay, measured, search):
        return measured, search
    times = f"{_without(replay, measured, search):.3g}"
    why = f"numbers within their tolerance come within {times} times the noise without it, as those of any robot may"
    found = tuple(OpenCause(cause.name, NEAR_MISS, why) for cause in measured.causes)
    less = search.less([candidate.cause.key for candidate in search.accepted])
    again = measure(replay.problem, replay.fitting, less, joint, replay.wide, seed)
    return replace(again, open_causes=(*found, *measured.open_causes)), less


def _is_near(replay: Replay, measured: Measured, search: Search) -> bool:
    """Whether causes were named, none is certain, and the tuned model is as near as that of a robot may be."""
    if not (is_of_robot(replay.problem) and measured.causes):
        return False
    if any(cause.confidence >= THRESHOLDS.certain for cause in measured.causes):
        return False
    return _without(replay, measured, search) <= THRESHOLDS.believed


def _without(replay: Replay, measured: Measured, search: Search) -> float:
    """Error of the tuned model without causes, on all that its fits did not see, in noise floors."""
    problem = replay.problem
    halves = crossed_errors(problem, [fit.values for fit in search.base])
    unseen = float(np.sqrt(np.mean(halves**2)))
    return max(unseen, measured.tuned.rmse) / problem.noise
