"""What the time stamps of a log leave open: readings are later or earlier than their row says.

A host stamps a row once and reads its columns one after the other, of a servo that renews them at a rate of its own.
A model that takes them for simultaneous finds the difference in its numbers: duty and current that are an eighth of a
millisecond old make a delay that much longer, and the viscous friction of a stiff servo lower for it. More data do not
mend that, so a bootstrap does not show it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..replay.parameters import Parameter, absolute, address
from ..replay.problem import CLOCK, Problem, periods_of
from .bounded import bounded_step

STEP = 0.5  # of a sample period: either way, where a response that goes from sample to sample cannot tell times apart
BESIDE = 1.2e-3  # of the range tried: that far from what is believed a wider interval stops, which the data exclude
DELAY = "delay.seconds"


def moved_by_late_columns(
    problem: Problem,
    values: Mapping[str, float],
    simulated: np.ndarray,
    weighted: np.ndarray,
    curvature: np.ndarray,
    room: tuple[np.ndarray, np.ndarray],
) -> np.ndarray:
    """How far parameters (p,) go, as they are fitted, where all columns are :data:`CLOCK` late but the first one.

    A joint answers to its goals alone, so it does later what it does with a longer delay. Zero for all else.

    Args:
        problem: what they were fitted to.
        values: of the fit, by path.
        simulated: channels of the fit (n, 4).
        weighted: Jacobian of the residual, by its robust weights (m, p).
        curvature: of the cost (p, p).
        room: down and up to the bounds (p,), (p,).
    """
    others = [c for c in range(1, simulated.shape[1]) if problem.weight[c] > 0.0]
    if problem.joint is None or not others:
        return np.zeros(len(curvature))
    nominal = problem.joint.models[0]
    told = {path: value for path, value in values.items() if address(path).number == DELAY}
    late = absolute(told, nominal).get(DELAY, nominal.value(DELAY)) + CLOCK * max(periods_of(problem))
    shifted = simulated.copy()
    shifted[:, others] = problem.simulate([{**{p: v for p, v in values.items() if p not in told}, DELAY: late}])[0][
        :, others
    ]
    then, now = problem.residual(np.stack([shifted, simulated]))
    return bounded_step(curvature, weighted.T @ (then - now), *room)


def over_a_step(
    value: float, ends: tuple[float, float], period: float, parameter: Parameter, believed: float, unit: float = 1.0
) -> tuple[float, float]:
    """An interval of a time with half a sample either way, and with what the stamps of the log are late or early by.

    A command that goes on between its samples, of a host that is faster than the log, is seen by the nearest sample,
    where one that holds until the next is seen by the first after it: a delay may be half a sample longer for that.
    What the data tell from the value themselves, the nominal model, stays outside.

    Args:
        value, ends: of the parameter, in its own unit.
        period: of the samples [s].
        parameter: that is fitted.
        believed: where it changes nothing.
        unit: of the parameter [s]; of a factor what it is a factor of.
    """
    below, above = STEP + CLOCK, STEP + CLOCK + (STEP if parameter.number == DELAY else 0.0)
    least, most = min(ends[0], value - below * period / unit), max(ends[1], value + above * period / unit)
    beside = BESIDE * (parameter.high - parameter.low)
    if least <= believed + beside < ends[0]:
        least = believed + beside
    elif ends[1] < believed - beside <= most:
        most = believed - beside
    return least, most


def seconds_of(parameter: Parameter, problem: Problem) -> float:
    """How many seconds one of a parameter's unit is; 0 where it is no time."""
    if not parameter.factor:
        return 1.0 if parameter.unit == "s" else 0.0
    nominal = problem.models[0]
    return nominal.value(parameter.number) if nominal.unit(parameter.number) == "s" else 0.0
