"""What adds up in a replay that nothing holds near the log, though nothing is wrong with the joint.

A goal pulls a joint back. A joint that follows a commanded torque is where two integrals of all torques took it: where
a piece of the log begins is read with noise and stays wrong, and so do the accelerations of its neighbours, which are
smoothed readings. Of an arm whose file was exact this left 18 noise floors.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ..load.terms import E_BIAS, E_COUPLING, E_INERTIA, T_OWN
from ..log.parts import FIT_A, FIT_B
from ..replay.comparison import rms
from ..replay.parameters import Parameter
from ..replay.problem import OF_A_ROBOT, JointProblem
from ..search.correlated import reading_error, shared
from ..search.fit import Fit, fit
from .confidence import Adrift

START_SPEED_SECONDS = 0.03  # [s] over which the speed is read with which a piece begins
MAX_START_ERROR = 3.0  # times their noise, by which a start may be read wrong
START_NUDGE = 0.5  # of their noise, by which starts are moved to see what they change
START_ROUNDS = 4  # of steps of the starts
START_STEP_PARTS = (1.0, 0.3, 0.1)  # parts of such a step
MAX_START_TURNS = 12  # times that starts and numbers are fitted in turn, at most
MIN_TURN_GAIN = 0.98  # of the error before, which a turn must reach for another one
STARTS_ALONE_ERROR = 1.5  # noise floors that may be left for the starts to be all that was wrong
BIAS, COUPLING = T_OWN + E_BIAS - E_INERTIA, T_OWN + E_COUPLING - E_INERTIA  # columns of the joint's own block


def adrift(problem: JointProblem, values: Mapping[str, float], seed: int) -> Adrift:
    """What a model of a joint that nothing holds leaves once its pieces begin where they fit best, and what errors of
    its neighbours would.

    Args:
        problem: all data of a joint of a robot.
        values: of the model, by path.
        seed: of the noise that the reading error is drawn with.
    """
    begun = with_starts(problem, values)
    simulated = begun.simulate([values])[0]
    error = np.where(begun.judged, (simulated[:, 0] - begun.measured[:, 0]) / begun.noise, np.nan)
    level = shared(begun, error) - shared(begun, reading_error(begun, simulated, error, seed))
    neighbours = np.zeros(1)
    if begun.terms is not None:
        terms = begun.terms.copy()
        terms[:, [BIAS, COUPLING]] += OF_A_ROBOT * terms[:, [COUPLING]]
        moved = dataclasses.replace(begun, terms=terms).simulate([values])[0]
        neighbours = (moved - simulated)[begun.judged, 0]
    return Adrift(max(level, 0.0), begun.noise * rms(error[np.isfinite(error)]), rms(neighbours))


def left_by(
    problem: JointProblem, found: Mapping[str, Mapping[str, float]], handed: str, named: bool, seed: int
) -> tuple[str, Adrift]:
    """Which model of a joint that nothing holds is handed over, and what adds up with it.

    Numbers that are not wrong fit what adds up, too: without a cause they stay as believed where that needs none.

    Args:
        problem: all data of the joint.
        found: values of each model, by its name and path.
        handed: what errors on unseen data ask for.
        named: whether a cause is.
        seed: as of :func:`adrift`.
    """
    if named:
        return handed, adrift(problem, found[handed], seed)
    believed = adrift(problem, found["nominal"], seed)
    if handed == "nominal" or believed.at_noise(problem.noise):
        return "nominal", believed
    left = adrift(problem, found["tuned"], seed)
    return "tuned" if handed == "refitted" and left.allows(problem.noise) else handed, left


def begun_fit(problem: JointProblem, parameters: Sequence[Parameter], found: Fit, evaluations: int) -> Fit:
    """A fit to pieces that begin where it fits them best, if that leaves little more than noise; else as it was.

    Starts that are read with noise bend the numbers of a joint that nothing holds: 8 N of friction were 7.5 N.

    Args:
        problem: all data of a joint of a robot.
        parameters: that were fitted.
        found: the fit.
        evaluations: iterations of a further one.
    """
    better, last = found, np.inf
    for _ in range(MAX_START_TURNS):
        begun = with_starts(problem, better.values)
        left = rms(begun.position_error(begun.simulate([better.values])[0]))
        if left > MIN_TURN_GAIN * last:
            break
        better, last = fit(begun.part(FIT_A, FIT_B), parameters, better.values, evaluations), left
    return better if last <= STARTS_ALONE_ERROR * problem.noise else found


def with_starts(problem: JointProblem, values: Mapping[str, float]) -> JointProblem:
    """The problem with pieces that begin where a model fits them best, as far as noise may have put them elsewhere.

    Each piece has a position and a speed of its own, which cost what they are off by in parts of their noise. Damped
    steps of least squares; a piece takes one where it fits better then.
    """
    spread = problem.noise * np.array([1.0, 1.0 / START_SPEED_SECONDS])
    rows = [slice(a, b) for a, b in zip(problem.starts[:-1], problem.starts[1:], strict=True)]

    def errors(moved: np.ndarray) -> np.ndarray:
        at = dataclasses.replace(problem, states=problem.states + spread * moved)
        error = (at.simulate([values])[0][:, 0] - problem.measured[:, 0]) / problem.noise
        return np.where(problem.judged & np.isfinite(error), error, 0.0)

    def costs(error: np.ndarray, moved: np.ndarray) -> np.ndarray:
        return np.array([error[piece] @ error[piece] for piece in rows]) + np.sum(moved**2, axis=1)

    moved = np.zeros((len(rows), 2))
    here = errors(moved)
    cost = costs(here, moved)
    for _ in range(START_ROUNDS):
        change = np.stack([(errors(moved + START_NUDGE * way) - here) / START_NUDGE for way in np.eye(2)], axis=1)
        step = np.zeros_like(moved)
        for k, piece in enumerate(rows):
            gram = change[piece].T @ change[piece] + np.eye(2)
            step[k] = -np.linalg.solve(gram, change[piece].T @ here[piece] + moved[k])
        for part in START_STEP_PARTS:
            trial = np.clip(moved + part * step, -MAX_START_ERROR, MAX_START_ERROR)
            there = errors(trial)
            better = costs(there, trial)
            for k in np.flatnonzero(better < cost):
                moved[k], here[rows[k]], cost[k] = trial[k], there[rows[k]], better[k]
    return dataclasses.replace(problem, states=problem.states + spread * moved)
