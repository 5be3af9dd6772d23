"""Less work for what only has to be about right: some pieces of a long log, and longer steps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar, cast

import numpy as np

from ..causes.catalogue import ENTRIES
from ..log.parts import FIT_A, FIT_B, WARM_UP
from ..replay.comparison import rms, robust_loss
from ..replay.parameters import Parameter
from ..replay.problem import UNNOTICED, JointProblem, Problem
from .fit import Fit, fit
from .settings import SearchSettings
from .several import Several
from .windows import hidden_state, split

WRONG = 1.0 / 3.0  # of what is kept: pieces that a model is most wrong about, beside some of all pieces
PIECE = 5.0  # [s] into which runs are cut that are longer than all that is kept
SKETCHED = -1  # label of the pieces that are kept
DROPPED = -2  # and of those that are not, where the others keep theirs
PLAY = "transmission.backlash"

AnyProblem = TypeVar("AnyProblem", bound=Problem)


def sketch(problem: AnyProblem, seconds: float, values: Mapping[str, float] | None = None) -> AnyProblem:
    """A joint's problem with every so many of the pieces of both parts, and those that a model is most wrong about.

    A chirp or a joint that warms up is another in each piece of a log: those kept of one part lie between those kept of
    the other. Of eight motions one alone may show what the others do not reach: the model is most wrong there. What is
    not of one joint stays whole: of several, each must be there.

    Args:
        problem: with pieces to fit on.
        seconds: length of what is judged, about; the log is not thinned below twice of that.
        values: of the model, by path; without one, two thirds are kept.
    """
    if not is_long(problem, seconds):
        return problem
    problem = _in_pieces(problem, seconds)
    every = max(math.floor(_length(problem) / ((1.0 - WRONG) * seconds)), 1)
    wrong = None if values is None else _wrong(problem, values)
    lengths = _lengths(problem)
    kept = set[int]()
    for part, first in ((FIT_A, 0), (FIT_B, every // 2)):
        mine = [k for k, unit in enumerate(problem.units) if unit.part == part]
        evenly = mine[first::every] or mine[:1]
        kept |= set(evenly)
        if wrong is not None:
            others = sorted(set(mine).difference(evenly), key=lambda k: float(wrong[k]), reverse=True)
            kept |= set(_first(others, lengths, WRONG / (1.0 - WRONG) * sum(lengths[k] for k in evenly)))
    units = tuple(replace(unit, part=SKETCHED) if k in kept else unit for k, unit in enumerate(problem.units))
    return replace(problem, units=units).part(SKETCHED)


def is_long(problem: Problem, seconds: float) -> bool:
    """Whether a log is so long that a sketch of so many seconds is much shorter."""
    return problem.joint is not None and _length(problem) >= 2.0 * seconds


def most_iterations(problem: Problem, settings: SearchSettings) -> int:
    """Of a fit to all of a problem that starts near its optimum, which takes the longer the longer the log is."""
    return settings.sketched_iterations if is_long(problem, settings.sketched) else settings.iterations


def fit_from_sketch(
    problem: Problem, parameters: Sequence[Parameter], start: Mapping[str, float] | None, settings: SearchSettings
) -> Fit:
    """A fit that starts far from its optimum: of a long log to the sketch first, and from there to all."""
    if is_long(problem, settings.sketched):
        start = fit(sketch(problem, settings.sketched, start or {}), parameters, start, settings.iterations).values
    return fit(problem, parameters, start, most_iterations(problem, settings))


def spread(problem: AnyProblem, seconds: float) -> AnyProblem:
    """A joint's problem with every so many of the pieces of each part, which stay in their parts.

    What joints share is sought at all joints at once, and shows in a part of a long log.

    Args:
        problem: with pieces in parts.
        seconds: length of what is judged of the parts that are fitted, about; the log is not thinned below it.
    """
    if _length(problem, FIT_A, FIT_B) < 2.0 * seconds:
        return problem
    problem = _in_pieces(problem, seconds)
    every = max(math.floor(_length(problem, FIT_A, FIT_B) / seconds), 1)
    kept, parts = set[int](), {unit.part for unit in problem.units}
    for part in parts:
        mine = [k for k, unit in enumerate(problem.units) if unit.part == part]
        kept |= set(mine[(every - 1) // 2 :: every] or mine[:1])
    units = tuple(unit if k in kept else replace(unit, part=DROPPED) for k, unit in enumerate(problem.units))
    return replace(problem, units=units).part(*parts)


def _in_pieces(problem: AnyProblem, seconds: float) -> AnyProblem:
    """A joint's problem with its runs cut into pieces, where they are longer than all that is kept: one motion of
    several says little of the others. Not where a piece would begin with a state that no reading tells.
    """
    longest = max(float(problem.time[b - 1] - problem.time[a]) for a, b in _judged(problem))
    if longest <= seconds or problem.free_joint is not problem:
        return problem
    joint = cast(JointProblem, problem)
    return problem if hidden_state(joint) else cast(AnyProblem, split(joint, PIECE, WARM_UP))


def _length(problem: Problem, *parts: int) -> float:
    """How much of it is judged [s], of all parts or of some."""
    pieces = zip(problem.units, _lengths(problem), strict=True)
    return sum(length for unit, length in pieces if not parts or unit.part in parts)


def _first(pieces: Sequence[int], lengths: Sequence[float], seconds: float) -> Sequence[int]:
    """The first of some pieces, as many as reach a length [s]."""
    before = np.cumsum([0.0, *(lengths[k] for k in pieces)])[:-1]
    return pieces[: int(np.searchsorted(before, seconds))]


def _lengths(problem: Problem) -> list[float]:
    """How much of each piece is judged [s]."""
    return [float(problem.time[b - 1] - problem.time[a]) for a, b in _judged(problem)]


def _wrong(problem: Problem, values: Mapping[str, float]) -> np.ndarray:
    """Mean loss of a model in each piece (u,): a few samples of a jam say little of the rest of theirs."""
    error = problem.errors(problem.simulate([values])[0])[:, 0] * problem.weight[0]
    judged = np.isfinite(error)
    loss = robust_loss(np.where(judged, error, 0.0))
    pieces = zip(problem.starts[:-1], problem.starts[1:], strict=True)
    return np.array([float(loss[a:b].sum()) / max(int(judged[a:b].sum()), 1) for a, b in pieces])


def coarsened(problem: AnyProblem, settings: SearchSettings) -> AnyProblem:
    """The problem with the longer steps of play and switches that a search replays.

    How long they may be is seen from a replay with play, at whose steps all that switches is replayed.
    """
    if isinstance(problem, Several):
        return cast(AnyProblem, problem.each(lambda joint: coarsened(joint, settings)))
    factor, play = settings.coarse_step, ENTRIES[PLAY]
    if problem.joint is None or not play.applies(problem.joint.models[0]):
        return problem.with_step_factor(factor)
    joint, values = problem.joint, [{p.path: p.start for p in play.cause(problem.joint.models[0]).variants[0]}]
    replay = joint.with_step_factor(factor).simulate(values)[0]
    while factor > 1.0:
        finer = joint.with_step_factor(0.5 * factor).simulate(values)[0]
        if rms(joint.position_error(replay) - joint.position_error(finer)) < UNNOTICED * joint.noise:
            break
        factor, replay = 0.5 * factor, finer
    return problem.with_step_factor(factor)


def _judged(problem: Problem) -> list[tuple[int, int]]:
    """First judged sample and end of each piece."""
    return [
        (min(int(a) + unit.judged, int(b) - 1), int(b))
        for unit, a, b in zip(problem.units, problem.starts[:-1], problem.starts[1:], strict=True)
    ]
