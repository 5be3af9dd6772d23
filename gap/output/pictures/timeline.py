"""A diagnosis over time: all runs one behind the other, with the pieces that were only for the test marked."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...log.parts import TEST
from ...verdict.verdict import JointDiagnosis
from ..numbers import LAYOUT

MODELS = ("nominal", "refitted", "extended")


@dataclass(frozen=True, eq=False)
class Timeline:
    """Signals over time (n,), with NaN where one piece ends and the next begins.

    Attributes:
        x: time [s], runs one behind the other.
        goal: command, None in a log without.
        measured: what was logged.
        models: simulated signal by model name, as far as there is one.
        tested: spans of the test part in ``x``.
        quantity, unit: of the signal.
    """

    x: np.ndarray
    goal: np.ndarray | None
    measured: np.ndarray
    models: dict[str, np.ndarray]
    tested: list[tuple[float, float]]
    quantity: str
    unit: str

    def thinned(self, most: int) -> Timeline:
        """About ``most`` samples that keep every peak of the measured signal and of the nominal error."""
        n = len(self.x)
        if n <= most:
            return self
        size = int(np.ceil(5 * n / most))
        error = np.abs(self.models.get("nominal", self.measured) - self.measured)
        keep = []
        for a in range(0, n, size):
            part, wrong = self.measured[a : a + size], error[a : a + size]
            good = np.flatnonzero(np.isfinite(part))
            keep += [a, *(a + np.flatnonzero(~np.isfinite(part))[:1])]
            if len(good):
                keep += [a + good[k] for k in (part[good].argmin(), part[good].argmax(), wrong[good].argmax(), -1)]
        at = np.unique(keep)
        goal = None if self.goal is None else self.goal[at]
        models = {name: values[at] for name, values in self.models.items()}
        return replace(self, x=self.x[at], goal=goal, measured=self.measured[at], models=models)


def timeline(diagnosis: JointDiagnosis) -> Timeline | None:
    """Signals of a diagnosis over time; None where nothing was replayed."""
    problem, simulated = diagnosis.problem, diagnosis.simulated
    if problem is None:
        return None
    rows, x, tested = [], [], []
    offset, end, last = 0.0, 0.0, -1
    for k, unit in enumerate(problem.units):
        at = np.arange(problem.starts[k], problem.starts[k + 1])
        at = at[problem.judged[at]]
        if not len(at):
            continue
        if unit.run != last:
            offset = end + (LAYOUT.pause if last >= 0 else 0.0) - problem.time[at[0]]
            last = unit.run
        time = offset + problem.time[at]
        end = float(time[-1])
        if unit.part == TEST:
            tested.append((float(time[0]), end))
        rows += [at, [-1]]
        x += [time, [end]]
    index = np.concatenate(rows).astype(int) if rows else np.zeros(0, int)

    def cut(values: np.ndarray) -> np.ndarray:
        return np.append(values, np.nan)[index]

    models = {name: cut(simulated[name][:, 0]) for name in MODELS if name in simulated}
    measured = cut(problem.measured[:, 0])
    joint = problem.joint if problem.signal[0] == "position" else None
    goal = None if joint is None or joint.models[0].command != "goal" else cut(joint.goal)  # no position
    quantity = diagnosis.signal.rpartition(".")[2]
    return Timeline(np.concatenate(x), goal, measured, models, tested, quantity, diagnosis.unit)


def worst_window(line: Timeline, width: float) -> tuple[float, float]:
    """Span of the test part, at most ``width`` seconds long, where the nominal model is most wrong."""
    error = line.models.get("nominal", line.measured) - line.measured
    total = np.concatenate([[0.0], np.cumsum(np.where(np.isfinite(error), error**2, 0.0))])
    best, window = -1.0, (float(line.x[0]), float(line.x[0]) + width)
    for start, stop in line.tested or [(float(line.x[0]), float(line.x[-1]))]:
        first = np.flatnonzero((line.x >= start) & (line.x <= max(start, stop - width)))
        last = np.searchsorted(line.x, np.minimum(line.x[first] + width, stop), side="right")
        sums = total[last] - total[first]
        if len(first) and sums.max() > best:
            best, begin = float(sums.max()), float(line.x[first[sums.argmax()]])
            window = (begin, min(begin + width, stop))
    return window
