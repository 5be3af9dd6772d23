"""Whether a log shows that a fitted stop is met: something must push the joint on to it.

A stop that only cuts off the ends of a motion explains as much as dry friction does that holds the joint there, and is
wrong on every motion that goes further. A goal beyond it, or a load that the drive holds up to it, cannot be friction.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..causes.load import STOPS, as_logged
from ..checks.stops import STOP_FOLLOWING, follows
from ..replay.parameters import Parameter
from ..replay.problem import JointProblem

FELT = 3.0  # noise floors by which a stop must change the position to act at a sample
BEYOND = 0.01  # [rad] that a goal must be beyond the joint to push it on, on top of how far it is ahead elsewhere
AHEAD = 1.5  # times the median by which goals are ahead of a free joint, as friction or a soft drive lets them be
OFTEN = 0.25  # share of the visits to a stop on which the joint must be pushed on
BINS = 10  # of the goals at which a stop acts
ALWAYS = 0.8  # share of the samples of a bin that must be at the stop, in the mean, where a load alone pushes


def unmet(problem: JointProblem, variant: tuple[Parameter, ...], fitted: Mapping[str, float]) -> bool:
    """Whether one of the fitted stops acts somewhere, and nothing shows that the joint is pushed on to it.

    It is pushed on by goals that are further ahead of it than they are of a free joint, by a load while the drive is
    off, or by a load that the drive works against. The last leads to the stop whenever the goals are those that led to
    it before; dry friction does so from one side alone.

    Args:
        problem: of a joint with a free link.
        variant: what was fitted.
        fitted: numbers of the fit, by path.
    """
    nominal = problem.models[0]
    if nominal.command != "goal":  # which pushes
        return False
    ends = [(STOPS[p.number], as_logged(fitted[p.path], fitted, nominal)) for p in variant if p.number in STOPS]
    without = {path: value for path, value in fitted.items() if path not in {p.path for p in variant}}
    stopped, onward = problem.simulate([fitted, without])[:, :, 0]
    for side, angle in ends:
        acts = problem.judged & (side * (onward - stopped) > FELT * problem.noise)
        acts &= side * (stopped - angle) > -FELT * problem.noise  # what a stop left behind is no visit to it
        if acts.any() and not (_pushed(problem, side, acts) or _loaded(problem, acts)):
            return True
    return False


def _pushed(problem: JointProblem, side: float, acts: np.ndarray) -> bool:
    """Whether goals far ahead of a joint push it on, or its drive is off, on enough of its visits to a stop."""
    position = problem.measured[:, problem.channels.index("position")]
    ahead = side * (problem.goal - position)
    free = ahead[problem.judged & problem.on & ~acts & (ahead > 0.0)]
    usual = AHEAD * float(np.median(free)) if len(free) else 0.0
    pushed = (ahead > BEYOND * problem.models[0].axis.reach + usual) | ~problem.on
    visit = np.cumsum(np.diff(acts.astype(int), prepend=0) == 1)[acts]
    return float(np.mean(np.bincount(visit, pushed[acts])[1:] > 0.0)) >= OFTEN


def _loaded(problem: JointProblem, acts: np.ndarray) -> bool:
    """Whether the goals at which a stop acts, in runs where it does, are goals at which it always does there.

    And the joint does not follow them.
    """
    position = problem.measured[:, problem.channels.index("position")]
    if follows(problem.goal[acts], position[acts]) > STOP_FOLLOWING:
        return False
    run = np.repeat([unit.run for unit in problem.units], np.diff(problem.starts))
    judged = [problem.judged & (run == each) for each in np.unique(run[acts])]
    return float(np.mean([_share(problem.goal[rows], acts[rows]) for rows in judged])) >= ALWAYS


def _share(goal: np.ndarray, acts: np.ndarray) -> float:
    """Share of the samples with goals (n,) at which a stop acts (n,), on average over these goals, at which it does."""
    low, high = np.quantile(goal[acts], (0.05, 0.95))
    alike = (goal >= low) & (goal <= high)
    bins = np.minimum((BINS * (goal[alike] - low) / max(high - low, 1e-12)).astype(int), BINS - 1)
    there, those = np.bincount(bins, acts[alike], BINS), np.bincount(bins, minlength=BINS)
    return float(np.mean(there[those > 0] / those[those > 0]))
