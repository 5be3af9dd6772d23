"""Pieces of a second in place of whole runs, where a model is so far off that errors grow along a run.

A joint that should have slipped and stuck instead runs the rest of a free replay elsewhere. The squared error of such a
replay has many minima, and where a fit ends says more about its start than about the joint. Replays that begin anew
from the measured state every second have few (multiple shooting). What is found so is still judged on whole runs.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from ..log.parts import FIT_A, FIT_B, LEAST_START, Unit, state_at, steady
from ..replay.comparison import rms
from ..replay.constants import K
from ..replay.parameters import Parameter
from ..replay.problem import JointProblem
from .fit import fit
from .settings import DEFAULT, SearchSettings

WINDOW = 1.0  # [s]
NEAR = 0.2  # [s] around the multiples of a window in which the start of one is looked for
SHORTEST = 0.5  # [s] what is left at the end of a run, if shorter, belongs to the window before


Joint = TypeVar("Joint", bound=JointProblem)


def in_windows(problem: Joint, tuned: Sequence[Parameter], settings: SearchSettings = DEFAULT) -> Joint:
    """The same data in windows, where that serves better than whole runs.

    It does not where the model comes near the data with its numbers refitted (``tuned``), nor where the first state of
    a window is not measured: with something that gives way between motor and encoder, or with an integrator.

    Args:
        problem: of a free joint.
        tuned: what refitting may turn.
        settings: thresholds of the search.
    """
    if hidden_state(problem):
        return problem
    part = problem.part(FIT_A, FIT_B)
    far = settings.window_error
    if not (_off(part, part.simulate([{}])[0]) > far and _off(part, fit(part, tuned).simulated) > far):
        return problem
    return split(problem)


def _off(part: JointProblem, simulated: np.ndarray) -> float:
    """Error of a model (rms) in noise floors."""
    return rms(part.position_error(simulated)) / part.noise


def window_starts(
    time: np.ndarray,
    position: np.ndarray,
    command: np.ndarray,
    window: float = WINDOW,
    shortest: float = SHORTEST,
) -> list[int]:
    """First sample of each window of a run: the first of all, and near each multiple of a window the one at which the
    state of the joint is read best. A speed that is read where a goal jumps is far off, and causes are sought that mend
    it.

    Args:
        time, position: of the run (n,) [s], [rad].
        command: of it (n,).
        window: between them, about [s].
        shortest: what the last one is longer than [s].
    """
    marks = np.arange(time[0] + window, time[-1] - shortest - NEAR, window)
    return [0, *(steady(time, position, command, mark - NEAR, mark + NEAR) for mark in marks)]


def split(problem: Joint, window: float = WINDOW, lead: float = LEAST_START) -> Joint:
    """Cut every unit into windows, each judged from ``lead`` [s] after its start on; the first from where the unit was.

    Args:
        problem: of one joint.
        window: length of each [s].
        lead: what is replayed and not judged [s].
    """
    units: list[Unit] = []
    starts: list[int] = []
    judged = problem.judged.copy()
    group = problem.group.copy()
    for unit, first, end in zip(problem.units, problem.starts[:-1], problem.starts[1:], strict=True):
        time, position = problem.time[first:end], problem.measured[first:end, 0]
        goal, shortest = problem.goal[first:end], max(SHORTEST, 2.0 * lead)
        cuts = [*window_starts(time, position, goal, window, shortest), int(end - first)]
        for a, b in itertools.pairwise(cuts):
            ready = int(np.searchsorted(time, time[a] + lead)) if a > 0 else unit.judged
            judged[first + a : first + ready] = False
            group[first + a : first + ready] = -1
            state = state_at(time, position, a) if a > 0 else unit.state
            units.append(Unit(unit.run, unit.part, unit.start + a, unit.start + b, max(ready - a, 1), state))
            starts.append(int(first) + a)
    return replace(
        problem,
        units=tuple(units),
        starts=np.array([*starts, problem.starts[-1]]),
        states=np.array([unit.state for unit in units]),
        judged=judged,
        group=group,
    )


def hidden_state(problem: JointProblem) -> bool:
    """Whether a joint has, in any run, a state that no reading tells: a link that gives way, or an integral."""
    return any(_hidden_state(problem, run) for run in range(len(problem.models)))


def _hidden_state(problem: JointProblem, run: int) -> bool:
    model = problem.models[run]
    constants = model.constants(problem.params[run], model.chain.program())
    integral = model.chain.find("position_pi") or model.chain.find("velocity_pi")
    return bool(constants[K.coupled] > 0.0 or (integral is not None and integral.parameters()["integral"] > 0.0))
