"""Where the fit of a delay starts, where the response has steps of its own.

Along a measured motion a drive is judged at the samples, so that a command which is late by less than a sample changes
nothing: between these steps a fit has no slope to follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..causes.cause import Cause
from ..log.parts import FIT_A, FIT_B
from ..replay.problem import Problem

DELAY = "drive.delay"
MOST = 0.1  # [s] beyond what is believed: no servo on a bus is later
POINTS = 40


def with_started_delays(problem: Problem, causes: Sequence[Cause]) -> list[Cause]:
    """Causes of which a delay starts where one of a grid fits best too; it is tried first.

    Args:
        problem: in which the drive is judged along the measured motion.
        causes: to be sought.
    """
    found = list(causes)
    at = next((k for k, cause in enumerate(found) if cause.name == DELAY), None)
    if at is None:
        return found
    ((first, *_), *_) = found[at].variants
    fitted = problem.part(FIT_A, FIT_B)
    believed = problem.models[0].value(first.number)
    period = float(np.median(np.diff(fitted.time)))
    step = max(0.5 * period, MOST / POINTS)
    tried = [believed + k * step for k in range(int(MOST / step) + 1)]
    errors = [
        float(fitted.block_errors(simulated).sum())
        for simulated in fitted.simulate([{first.path: seconds} for seconds in tried])
    ]
    start = max(tried[int(np.argmin(errors))], believed + 0.25 * step)
    # a slope, and with it an interval, is over more than one step of the response
    wider = max(first.difference, 1.5 * period / first.scale)
    variants = tuple((replace(p, difference=wider), *rest) for p, *rest in found[at].variants)
    found[at] = replace(found[at], variants=((replace(first, start=start, difference=wider),), *variants))
    return found
