"""How small a cause must be to leave no trace in a log: what finding nothing in it is worth, cause by cause."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..causes.cause import Variant
from ..log.parts import FIT_A, FIT_B
from ..replay.problem import JointProblem
from ..search.bounded import bounded_step
from ..search.result import Search
from .proposal import RIDGE, SHOWS, Hypothesis, Prediction, everything, predict, thinned

SIZES = tuple(2.0**k for k in range(-4, 6))  # that a detection limit is sought among, in parts of a plausible size
AT_ONCE = 16  # replays
FAR = 1e4  # noise floors at which a change is clipped: larger ones are those of a replay that diverges
STEPS = 3  # evaluations of the tuned numbers on their way towards the log that was measured
HOPELESS = 3.0  # times what shows, as a step foresees it: from there tuned numbers do not hide a cause


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
        low, high = first.to_fit(max(first.low, 1e-12) if first.logarithmic else first.low), first.to_fit(first.high)
        neutral = first.neutral(self.log.models[0])
        neutral = max(neutral, first.from_fit(low))
        none, plausible = first.to_fit(min(neutral, first.high)), first.to_fit(cause.values[first.path])
        sizes = none + side * abs(plausible - none) * np.array(SIZES)
        sizes = sizes[(sizes >= low) & (sizes <= high)]
        if not len(sizes):
            return side * math.inf
        apart = self.apart([{**cause.values, first.path: first.from_fit(size)} for size in sizes], variant)
        unseen = np.flatnonzero(apart < SHOWS)
        k = int(unseen[-1]) + 1 if len(unseen) else 0
        if k == len(sizes):
            return side * math.inf
        size = max(abs(sizes[k] - none) * SHOWS / apart[k], abs(sizes[k - 1] - none) if k else 0.0)
        return first.from_fit(none + side * size)

    def apart(self, rows: Sequence[Mapping[str, float]], variant: Variant) -> np.ndarray:
        """How far models with a cause (s,) stay from the one that fits, with the numbers beside it tuned (rms).

        Steps of a fixed Jacobian, each from what the step before really did.
        """
        own = {p.number for p in variant}
        kept = [k for k, p in enumerate(self.model.parameters) if p.number not in own]
        numbers = [self.model.parameters[k] for k in kept]
        change, low, high = self.predicted.change[:, kept], self.predicted.low[kept], self.predicted.high[kept]
        gram = change.T @ change
        gram += np.diag(RIDGE * gram.diagonal() + RIDGE)
        here = np.array([p.to_fit(self.model.values[p.path]) for p in numbers])
        moved, least = np.zeros((len(rows), len(kept))), np.full(len(rows), np.inf)
        left = list(range(len(rows)))
        for _ in range(STEPS):
            tuned = [{p.path: p.from_fit(u) for p, u in zip(numbers, here + moved[k], strict=True)} for k in left]
            rest = self.signals([{**rows[k], **more} for k, more in zip(left, tuned, strict=True)])
            rest = np.clip(np.nan_to_num(rest - self.predicted.signal, nan=FAR), -FAR, FAR)
            least[left] = np.minimum(least[left], np.sqrt(np.mean(rest**2, axis=1)))
            foreseen = np.full(len(rows), np.inf)
            for k, error in zip(left, rest, strict=True):
                move = bounded_step(gram, change.T @ error, low - moved[k], high - moved[k]) if kept else moved[k]
                moved[k] += move
                foreseen[k] = np.sqrt(np.mean((error + change @ move) ** 2))
            left = [int(k) for k in np.flatnonzero((least >= SHOWS) & (foreseen < HOPELESS * SHOWS))]
            if not (left and kept):
                break
        return least

    def signals(self, rows: Sequence[Mapping[str, float]]) -> np.ndarray:
        """Weighted signals of several models (s, m)."""
        blank = dataclasses.replace(self.log, measured=np.where(np.isfinite(self.log.measured), 0.0, np.nan))
        parts = [rows[k : k + AT_ONCE] for k in range(0, len(rows), AT_ONCE)]
        return np.concatenate([blank.residual(blank.simulate(part)) for part in parts])
