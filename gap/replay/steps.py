"""How long a step of the simulator may be."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from ...actuators import Chain
from .problem import JointProblem
from .simulator import DIVERGED, ELASTIC_STEP, EVENT_STEP

ROBOT_STEP = 5e-3  # [s] tried first at joints of robots, whose logs are coarser and longer than those of benches
STEPS = (2.5e-3, 1.7e-3, 1e-3, 5e-4, 2.5e-4, 1e-4)  # [s]

Joint = TypeVar("Joint", bound=JointProblem)


def largest_step(chain: Chain, coarse: float = 1.0) -> float:
    """The largest step that resolves what lies between motor and link, and firmware that switches [s].

    ``coarse`` is how many times longer that of teeth, switches and differences may be; teeth are springs, too. A push
    that a step of eight halves of its filter lumps together is still as large, within 5 %.
    """
    play = chain.find("backlash")
    teeth = play is not None and play.width > 0.0
    springs = teeth or chain.find("spring") or chain.find("compliance")
    differences = chain.find("derivative")
    push = 0.5 * differences.filter * min(coarse, 8.0) if differences else np.inf
    elastic = min(ELASTIC_STEP if springs else np.inf, push)
    switches = teeth or any(stage.switches for stage in chain.stages)
    return min(EVENT_STEP * coarse if switches else np.inf, elastic)


def converged(problem: Joint) -> Joint:
    """The problem with the largest step whose discretisation error is below a tenth of the noise.

    That is how much the replay changes as it is halved; :func:`largest_step` bounds it where that is less.

    A quarter would be invisible in the error, but not to a search that looks for structure in it.
    """
    step = problem.step
    # a chain with springs or switches is replayed in shorter steps whatever is tried, and says nothing of long ones
    bounded = largest_step(problem.models[0].chain) < np.inf
    for step in [length for length in problem.steps if not bounded or length <= STEPS[0]]:
        replays = [problem.simulate([{}], length)[0] for length in (step, step / 2.0)]
        if any(map(diverged, replays)):  # two that leave all bounds are alike
            continue
        whole, halved = map(problem.position_error, replays)
        if np.sqrt(np.mean((whole - halved) ** 2)) < 0.1 * problem.noise:
            break
    return replace(problem, step=step)


def diverged(simulated: np.ndarray) -> bool:
    """Whether a replay (n, 4) left all bounds: its steps are too long for what it simulates, or nothing holds it."""
    return bool((simulated == DIVERGED).all(axis=-1).any())
