"""What no cause explains: structure in what is left of a gap, and which signals it depends on.

Two questions, answered apart. How much is structure: noise of an encoder is independent from sample to sample, the
error of a model is not, so errors a few samples apart have in common what the model gets wrong, whatever its cause.
What it depends on: a flexible learner (gradient boosting on the motion and its past) predicts the error on pieces of
the logs that it was not trained on; what it manages bounds from below what a better model could still explain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..replay.problem import NOISE_FLOORS, Problem
from .correlated import reading_error, shared
from .settings import DEFAULT, SearchSettings, threshold
from .where import where

FOLDS = 3  # parts of the pieces, each predicted from the others
PASTS = (0.02, 0.06, 0.12)  # [s] how long ago the past values lie that the learner sees
MOST_SAMPLES = 30_000  # for training; more teach it nothing
CLIP = 8.0  # noise floors: a jam must not be all that it learns


@dataclass(frozen=True, kw_only=True)
class StructureLimits:
    """From when on what is left counts as structure, and what of it is told."""

    noticed: float = threshold(
        0.08,
        "Structure, relative to the mean square of the noise, from which it is reported. Right models leave up to "
        "0.03, and up to 0.09 where encoder ticks decide where the joint sticks.",
    )
    learnt: float = threshold(0.1, "Share of the structure that the learner must predict for its signals to be named.")
    matters: float = threshold(0.15, "Share of the learner's success that a signal must carry to be named.")


LIMITS = StructureLimits()


@dataclass(frozen=True)
class Structure:
    """Structure in the errors of a model.

    Attributes:
        level: mean square of the structure over that of the noise.
        rms: of the structure, in ``unit``.
        predicted: share of it that the learner predicts on unseen pieces; 0 where there was too little to learn.
        depends_on: signals that the prediction needs with their shares of it, the strongest first; empty where the
            structure follows none of them.
        unit: of what is judged.
        where: most of it is, for people.
    """

    level: float
    rms: float
    predicted: float = 0.0
    depends_on: tuple[tuple[str, float], ...] = ()
    unit: str = "rad"
    where: str = ""

    @property
    def noticed(self) -> bool:
        """Whether it is more than a right model leaves."""
        return self.level > LIMITS.noticed

    @property
    def sentence(self) -> str:
        """For people."""
        if not self.noticed:
            return "What is left is noise."
        rms = fine(self.rms, self.unit, 2)
        size = f"What is left holds {rms} (rms) of structure that no cause of the catalogue explains"
        where = f"; {self.where}" if self.where else ""
        if not self.depends_on:
            return f"{size}{where}."
        names = listed([name for name, _ in self.depends_on])
        return f"{size}{where}; a flexible learner predicts {100 * self.predicted:.0f} % of it, from {names}."


def listed(names: Sequence[str]) -> str:
    """Names in a sentence: ``a``, ``a and b``, ``a, b and c``."""
    return " and ".join(part for part in (", ".join(names[:-1]), *names[-1:]) if part)


def fine(value: float, unit: str, digits: int = 1) -> str:
    """A small value for people, in the words of :func:`told_in`."""
    factor, words = told_in(unit)
    return f"{factor * value:.{digits}f} {words}"


def told_in(unit: str) -> tuple[float, str]:
    """Factor and unit for people: ``mrad`` for ``rad``, ``per mille`` for a number without unit, noise floors as is."""
    if unit == NOISE_FLOORS:
        return 1.0, unit
    return 1e3, "per mille" if unit == "1" else f"m{unit}"


def structure(problem: Problem, simulated: np.ndarray, seed: int = 0, settings: SearchSettings = DEFAULT) -> Structure:
    """Structure in the position errors of a model (n, 4)."""
    if (known := problem.left_over(simulated)) is not None:
        return Structure(known, float(np.sqrt(known)) * problem.noise, unit=problem.signal[1])
    error = (simulated[:, 0] - problem.measured[:, 0]) / problem.noise
    error = np.where(problem.judged & np.isfinite(error), error, np.nan)
    level = max(shared(problem, error) - shared(problem, reading_error(problem, simulated, error, seed)), 0.0)
    rms = float(np.sqrt(level)) * problem.noise
    if level <= LIMITS.noticed:
        return Structure(level, rms, unit=problem.signal[1])
    predicted, depends_on = _learn(problem, simulated, error, level, seed)
    return Structure(level, rms, predicted, depends_on, problem.signal[1], where(problem, simulated, error, settings))


# --- what it depends on --------------------------------------------------------------------------------------------


def _features(problem: Problem, simulated: np.ndarray) -> dict[str, np.ndarray]:
    """Signals that the learner sees, by the name that a person reads, each (n, columns)."""
    table: dict[str, list[np.ndarray]] = {}
    runs = np.array([unit.run for unit in problem.units])
    signals = problem.covariates(simulated)
    for k, (a, b) in enumerate(zip(problem.starts[:-1], problem.starts[1:], strict=True)):
        time, here = problem.time[a:b], {name: values[a:b] for name, values in signals.items()}
        position, speed, duty = here["position"], here["speed"], here["duty"]
        command = here["goal"] - position
        past = [np.maximum(np.searchsorted(time, time - ago), 0) for ago in PASTS]
        rows = {
            "position": [position],
            "speed": [speed, *(speed[p] for p in past)],
            "acceleration": [here["acceleration"]],
            "position error": [command, *(command[p] for p in past)],
            "duty": [duty, duty[past[1]]],
            "time since the start": [time],
            "temperature": [here["temperature"]],
            "which run": [np.full(b - a, float(runs[k]))],
        }
        for name, columns in rows.items():
            table.setdefault(name, []).append(np.stack(columns, axis=1))
    return {name: np.concatenate(parts) for name, parts in table.items()}


def _learn(
    problem: Problem, simulated: np.ndarray, error: np.ndarray, level: float, seed: int
) -> tuple[float, tuple[tuple[str, float], ...]]:
    """Share of the structure that is predicted on unseen pieces, and the signals it needs."""
    from sklearn.ensemble import HistGradientBoostingRegressor
    from threadpoolctl import threadpool_limits

    features = {name: columns for name, columns in _features(problem, simulated).items() if np.ptp(columns) > 0.0}
    table = np.concatenate(list(features.values()), axis=1)
    spans = np.cumsum([0, *(columns.shape[1] for columns in features.values())])
    fold = np.repeat(np.arange(len(problem.units)) % FOLDS, np.diff(problem.starts))
    good, wanted = np.isfinite(error), np.clip(np.nan_to_num(error), -CLIP, CLIP)
    rng = np.random.default_rng(seed)
    before = after = 0.0
    worse = np.zeros(len(features))
    for k in range(FOLDS):
        seen, unseen = np.flatnonzero(good & (fold != k)), np.flatnonzero(good & (fold == k))
        if len(seen) < 500 or len(unseen) < 100:
            continue
        seen = seen[:: max(len(seen) // MOST_SAMPLES, 1)]
        learner = HistGradientBoostingRegressor(
            max_iter=80, learning_rate=0.08, max_leaf_nodes=12, min_samples_leaf=80, l2_regularization=10.0,
            random_state=seed,
        )  # fmt: skip
        with threadpool_limits(1):  # its threads wait for each other in loops, which a busy machine cannot bear
            learner.fit(table[seen], wanted[seen])
            rows = unseen[:: max(len(unseen) // MOST_SAMPLES, 1)]
            target, weight = wanted[rows], len(unseen) / len(rows)
            here = float(((target - learner.predict(table[rows])) ** 2).sum())
            before, after = before + weight * float((target**2).sum()), after + weight * here
            for j in range(len(features)):
                shuffled = table[rows]
                shuffled[:, spans[j] : spans[j + 1]] = rng.permutation(shuffled[:, spans[j] : spans[j + 1]])
                worse[j] += weight * max(float(((target - learner.predict(shuffled)) ** 2).sum()) - here, 0.0)
    count = float(good.sum())
    share = float(np.clip((before - after) / count / level, 0.0, 1.0)) if count else 0.0
    if share < LIMITS.learnt:
        return share, ()
    parts = worse / max(worse.sum(), 1e-12)
    order = [j for j in np.argsort(-parts) if parts[j] > LIMITS.matters][:3]
    names = list(features)
    return share, tuple((names[j], float(parts[j])) for j in order)
