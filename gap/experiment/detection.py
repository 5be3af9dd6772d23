"""What a log could not show, and how small a cause must be to leave no trace: what finding nothing in it is worth."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..causes.catalogue import adjustable, catalogue
from ..causes.cause import Variant
from ..log.parts import FIT_A, FIT_B, Unit
from ..log.types import MeasuredRun
from ..replay.free import free_problem
from ..replay.joint_model import JointModel
from ..replay.problem import JointProblem
from ..search.bounded import bounded_step
from ..search.fit import Fit
from ..search.result import Search
from ..search.torque_gauge import is_open
from .excitations import Limits
from .proposal import (
    MIN_SEPARATION,
    NORMAL_RIDGE,
    VISIBLE_DIFFERENCE,
    Experiment,
    Hypothesis,
    Prediction,
    everything,
    predict,
    propose,
    thinned,
    unlike,
)

TRIED_SIZES = tuple(
    2.0**k for k in range(-4, 6)
)  # that a detection limit is sought among, in parts of a plausible size
REPLAYS_AT_ONCE = 16  # replays
MAX_CHANGE = 1e4  # noise floors at which a change is clipped: larger ones are those of a replay that diverges
MAX_TUNING_STEPS = 12  # evaluations of the tuned numbers, at most, on their way towards the log that was measured
MIN_STEP_GAIN = 0.02  # of what is left, that such a step must take for the next one to be worth it

MAX_BLIND_SHARE = 0.25
"""Share of the catalogue that a log may be unable to show for "nothing to explain" to mean something."""
ASSUMED_NOISE = 5e-4  # [rad] of an encoder whose log never moves: a tick of 4096 a turn, and as much noise


@dataclass(frozen=True)
class DetectionLimit:
    """Between which values a cause leaves too little in a log to be found, whatever is tuned within its tolerance.

    Attributes:
        name: of the cause.
        number: that makes it act.
        unit: of the values.
        nominal: what the model has.
        low, high: nearest values that show; infinite where none of that side does, or there is no such side.
    """

    name: str
    number: str
    unit: str
    nominal: float
    low: float
    high: float

    @property
    def sentence(self) -> str:
        """For people: ``friction.coulomb 0.04 to 0.06 N.m``."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        low, high = (math.isfinite(end) for end in (self.low, self.high))
        if not (low or high):
            return f"{self.name} at all"
        if not low:
            return f"{self.name} below {self.high:.3g}{unit}"
        if not high:
            return f"{self.name} above {self.low:.3g}{unit}"
        return f"{self.name} {self.low:.3g} to {self.high:.3g}{unit}"

    def hides(self, value: float) -> bool:
        """Whether a value [``unit``] may be there unseen."""
        return not (value <= self.low or value >= self.high)


def detection_limits(problem: JointProblem, search: Search) -> tuple[DetectionLimit, ...]:
    """The detection limit of each cause of a search that found none.

    Each cause is simulated at growing sizes. It is hidden where the tuned numbers, anywhere within their tolerance,
    make a log like the one that was measured: the model that fits it may have taken the cause up.
    """
    none, *causes = everything(problem, search)
    old = thinned(problem.part(FIT_A, FIT_B))
    looks = Looks(old, none, predict(old, none))
    nominal = problem.models[0]
    variants = {cause.name: cause.variants[0] for cause in search.causes}
    found = []
    for cause in causes:
        variant = variants[cause.name]
        first = variant[0]
        low, high = (first.physical(looks.shows(cause, variant, side), nominal) for side in (-1.0, 1.0))
        unit = nominal.unit(first.number) if first.factor else first.unit
        found.append(DetectionLimit(cause.name, first.number, unit, float(nominal.value(first.number)), low, high))
    return tuple(found)


@dataclass(frozen=True, eq=False)
class Looks:
    """A log, and the model without any cause that fits it.

    Attributes:
        log: of which a part may be enough.
        model: its tuned numbers and their values.
        predicted: what it predicts, and its change by each tuned number.
    """

    log: JointProblem
    model: Hypothesis
    predicted: Prediction

    def shows(self, cause: Hypothesis, variant: Variant, side: float) -> float:
        """The value of a cause's first parameter, above or below the nominal one, from which on it shows."""
        first = variant[0]
        low, high = first.to_fit(first.least), first.to_fit(first.high)
        none, plausible = first.nothing(self.log.models[0]), first.to_fit(cause.values[first.path])
        sizes = none + side * abs(plausible - none) * np.array(TRIED_SIZES)
        sizes = sizes[(sizes >= low) & (sizes <= high)]
        if not len(sizes):
            return side * math.inf
        apart = self.apart([{**cause.values, first.path: first.from_fit(size)} for size in sizes], variant)
        unseen = np.flatnonzero(apart < VISIBLE_DIFFERENCE)
        k = int(unseen[-1]) + 1 if len(unseen) else 0
        if k == len(sizes):
            return side * math.inf
        shown, hidden, left = abs(sizes[k] - none), *((abs(sizes[k - 1] - none), apart[k - 1]) if k else (0.0, 0.0))
        # lines to the first size that shows, from none and from the last that does not, whichever hides more
        between = hidden + (shown - hidden) * (VISIBLE_DIFFERENCE - left) / (apart[k] - left)
        return first.from_fit(none + side * max(shown * VISIBLE_DIFFERENCE / apart[k], between))

    def apart(self, rows: Sequence[Mapping[str, float]], variant: Variant) -> np.ndarray:
        """How far models with a cause (s,) stay from the one that fits, with the numbers beside it tuned (rms).

        From the numbers of the model that fits and from those that are believed, whichever come nearer: tuning may be
        what hides the cause, and so may be that nothing is tuned.
        """
        own = {p.number for p in variant}
        kept = [k for k, p in enumerate(self.model.parameters) if p.number not in own]
        numbers = [self.model.parameters[k] for k in kept]
        here = np.array([p.to_fit(self.model.values[p.path]) for p in numbers])
        low, high = self.predicted.low[kept], self.predicted.high[kept]
        believed = np.array([p.to_fit(min(max(p.neutral(self.log.models[0]), p.low), p.high)) for p in numbers])
        starts = [np.zeros(len(kept)), np.clip(believed - here, low, high)] if kept else [np.zeros(0)]
        trips = [_Trip(row, k, start, self.predicted.change[:, kept]) for k, row in enumerate(rows) for start in starts]
        least, left = np.full(len(rows), np.inf), trips
        for _ in range(MAX_TUNING_STEPS):
            rest = self.signals([
                trip.row | {p.path: p.from_fit(u) for p, u in zip(numbers, here + trip.moved, strict=True)}
                for trip in left
            ])  # fmt: skip
            rest = np.clip(np.nan_to_num(rest - self.predicted.signal, nan=MAX_CHANGE), -MAX_CHANGE, MAX_CHANGE)
            for trip, error in zip(left, rest, strict=True):
                trip.arrived(error)
                least[trip.number] = min(least[trip.number], trip.least)
            left = [t for t in left if kept and least[t.number] >= VISIBLE_DIFFERENCE and t.goes_on(low, high)]
            if not left:
                break
        return least

    def signals(self, rows: Sequence[Mapping[str, float]]) -> np.ndarray:
        """Weighted signals of several models (s, m)."""
        blank = dataclasses.replace(self.log, measured=np.where(np.isfinite(self.log.measured), 0.0, np.nan))
        parts = [rows[k : k + REPLAYS_AT_ONCE] for k in range(0, len(rows), REPLAYS_AT_ONCE)]
        return np.concatenate([blank.residual(blank.simulate(part)) for part in parts])


class _Trip:
    """A model with a cause on its way towards the log, its numbers within their tolerance."""

    def __init__(self, row: Mapping[str, float], number: int, start: np.ndarray, change: np.ndarray) -> None:
        """A trip.

        Args:
            row: values of the cause.
            number: of the size that it is of.
            start: of the tuned numbers, from those that fit without the cause (p,).
            change: of the signals by each of them (m, p).
        """
        self.row, self.number = dict(row), number
        self.moved, self.change = start.copy(), change
        self.least, self.slow = math.inf, False
        self._error = self._move = np.zeros(0)

    def arrived(self, error: np.ndarray) -> None:
        """Learn from what the last step really did (m,): the change along it is known better now."""
        if len(self._move) and (length := float(self._move @ self._move)) > 0.0:
            missed = error - self._error - self.change @ self._move
            self.change = self.change + np.outer(missed, self._move) / length
        size = float(np.sqrt(np.mean(error**2)))
        self.slow = size > (1.0 - MIN_STEP_GAIN) * self.least
        self.least, self._error = min(self.least, size), error

    def goes_on(self, low: np.ndarray, high: np.ndarray) -> bool:
        """Take the next step within bounds of all steps together; whether it is worth to be looked at."""
        if self.slow:
            return False
        gram = self.change.T @ self.change
        gram += np.diag(NORMAL_RIDGE * gram.diagonal() + NORMAL_RIDGE)
        self._move = bounded_step(gram, self.change.T @ self._error, low - self.moved, high - self.moved)
        self.moved = self.moved + self._move
        return float(np.sqrt(np.mean((self._error + self.change @ self._move) ** 2))) < MIN_SEPARATION


# --- causes that would have left no trace ---------------------------------------------------------------------------


def unseen(problem: JointProblem, search: Search) -> tuple[str, ...]:
    """Causes of the catalogue which, at a plausible size, the log would hardly show beside what may be tuned."""
    none, *causes = everything(problem, search)
    old = thinned(problem.part(FIT_A, FIT_B))
    nothing = predict(old, none)
    hidden = []
    # numbers of a joint whose log leaves all torques open hide behind each other in any motion, up to their tolerance
    behind = {p.number for p in search.tuned} if is_open(problem.models[0]) else set()
    behind = {cause.name for cause in search.causes if cause.error and cause.variants[0][0].number in behind}
    for cause in causes:
        if cause.name in behind:
            continue
        there = predict(old, cause)
        if unlike(there, nothing, there, nothing) < VISIBLE_DIFFERENCE:
            hidden.append(cause.name)
    return tuple(hidden)


def blind_spots(problem: JointProblem, search: Search, held: Collection[str] = ()) -> tuple[str, ...]:
    """Causes that a log could not show, where they are so many that finding nothing in it means nothing.

    Args:
        problem: of the log.
        search: what was found in it.
        held: causes that were not sought, since a link that moves as measured shows none of them.
    """
    hidden = (*held, *unseen(problem, search))
    return hidden if too_many(len(hidden), len(held) + len(everything(problem, search)) - 1) else ()


def too_many(hidden: int, considered: int) -> bool:
    """Whether so many hidden causes, of those considered, make finding nothing worthless.

    One of a few that somebody asked for does not: a number of the model may be a few per cent off unseen in any log.
    """
    return 0 < hidden == considered or hidden > max(MAX_BLIND_SHARE * considered, 1)


def experiment_for_still(
    runs: Sequence[MeasuredRun],
    joint: str,
    models: Sequence[JointModel],
    limits: Limits | None = None,
    seed: int = 0,
    causes: Sequence[str] | None = None,
) -> Experiment | None:
    """The measurement to begin with where a joint was never moved: it tells all causes apart, or those named."""
    units = [Unit(0, FIT_A, 0, len(runs[0].time), 1, (float(runs[0].joints[joint].position[0]), 0.0))]
    problem = free_problem(runs[:1], joint, models[:1], units, {"position": 1.0 / ASSUMED_NOISE})
    start = Fit({}, np.empty((0, 4)), 0.0)
    considered = tuple(catalogue(models[0], causes))
    search = Search(tuple(adjustable(models[0])), (), (), np.ones(1), (start, start), considered)
    return propose(problem, search, limits, seed, blind=True)
