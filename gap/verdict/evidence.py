"""What a verdict is decided on, and the thresholds that it is compared with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ..experiment import DetectionLimit
from ..log.finding import Finding
from ..search.settings import threshold
from ..search.structure import Structure
from .verdict import DataError, Error, NamedCause, OpenCause


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """What the decision compares with."""

    negligible: float = threshold(
        0.03,
        "Largest unexplained share of the gap that counts as explained although structure is noticed. Each cause must "
        "have the confidence `sure`, and the structure must stay below `as_noise`.",
    )
    as_noise: float = threshold(1.0, "Largest structure in that case, relative to the mean square of the noise.")
    at_noise: float = threshold(
        1.05,
        "Error on the test part, in noise floors, up to which no other model does clearly better.",
    )
    believed: float = threshold(
        1.2,
        "Error, in noise floors, up to which a joint of a robot has nothing to explain in spite of `slight` structure, "
        "and up to which tuned numbers leave room only for a cause that is `certain`. Robots without any effect that "
        "other programs simulated reached 1.16.",
    )
    slight: float = threshold(
        0.3,
        "Largest structure in that case, relative to the mean square of the noise: what the bodies and neighbours of a "
        "joint have wrong within their tolerance. Strangers on hidden arms left 2.9 noise floors and more.",
    )
    feeble: float = threshold(
        0.3, "Share of the tuned model's mean squared error that the causes must remove where structure is noticed."
    )
    sure: float = threshold(0.6, "Confidence from which a cause is named alone.")
    # Of the causes that the hidden benches named with as much, 218 of 219 were right; between ``sure`` and it, 24 of
    # 30; below, 17 of 54 (``python -m benchmarks.calibration``).
    certain: float = threshold(0.9, "Confidence from which a cause is certain, whatever else is open.")
    guessed: float = threshold(
        0.3, "Confidence below which a cause is a guess: where none has more, the gap is not identifiable."
    )
    form: float = threshold(
        0.01,
        "Relative error of any law of the catalogue. A cause that removes no more than that of what the others explain "
        "may mend their laws.",
    )
    neighbours: float = threshold(
        0.05,
        "Mean square, relative to that of the noise, of what a joint of a robot may have wrong since the acceleration "
        "of its neighbours is measured. A cause that removes no more may mend that.",
    )
    tuned_away: float = threshold(
        4.0,
        "Mean squared error of the nominal model, relative to that of the tuned one, from which the sentence of "
        "`nothing to explain` gives the tuned number that the fit needs most.",
    )
    at_bound: float = threshold(
        0.5, "Factor on the confidence where the value is at an end of the range tried: there it is no measurement."
    )
    contradicted: float = threshold(
        0.7, "Factor on the confidence where a feature of the cause stays as wrong as in the nominal model."
    )
    clearly: float = threshold(
        0.9,
        "Mean squared error on the test part, relative to that of the model with the causes, below which the refitted "
        "numbers are clearly better.",
    )
    certainly: float = threshold(0.975, "Share of the bootstrap draws in which the refitted numbers must be better.")
    missed: float = threshold(
        0.9,
        "Loss with a cause whose interval reaches no effect, relative to the loss without it, below which unseen data "
        "miss it and it stays; `certainly` holds for it too.",
    )
    at_rest: float = threshold(
        1e-3, "Share of the range tried: an interval that comes this close to the value without effect includes it."
    )
    torque_explained: float = threshold(0.15, "Largest unexplained share of a torque gap that counts as explained.")
    torque_as_good: float = threshold(
        1.05, "Torque error, relative to the tuned one, up to which the numbers of the sidecar are as good."
    )


THRESHOLDS = Thresholds()


def as_noise_allows(
    structure: Structure, error: float, noise: float, of_robot: bool, limit: Thresholds = THRESHOLDS
) -> bool:
    """Whether nothing asks for an explanation where no cause is named.

    Args:
        structure: that is left.
        error: of the model on the test part, and ``noise``: its floor; in the same unit.
        of_robot: whether it is a joint of a robot, whose other bodies are believed too.
        limit: what it is compared with.
    """
    little = of_robot and error <= limit.believed * noise and structure.level <= limit.slight
    return little or not structure.noticed


@dataclass(frozen=True)
class Adrift:
    """What is left of a joint that nothing holds near the log (:mod:`sealegs.gap.verdict.adrift`).

    Attributes:
        level: of the structure that is left once pieces begin where they fit best, over the mean square of the noise.
        error: that is left then, in the unit of the signal (rms).
        neighbours: what errors of its neighbours' accelerations leave, in the same unit (rms).
    """

    level: float
    error: float
    neighbours: float

    def at_noise(self, noise: float, limit: Thresholds = THRESHOLDS) -> bool:
        """Whether starts that were read with noise leave as much."""
        return self.error <= noise or (self.error <= limit.at_noise * noise and self.level <= limit.slight)

    def allows(self, noise: float, limit: Thresholds = THRESHOLDS) -> bool:
        """Whether what is left needs no cause: starts, or errors of the neighbours, leave as much."""
        return self.at_noise(noise, limit) or self.error <= self.neighbours


@dataclass(frozen=True)
class Replayed:
    """Evidence of a replay and a search.

    Attributes:
        joint: its name.
        errors: of the models on the test part, as :attr:`JointDiagnosis.gap`.
        tuned: error there of the nominal model with its numbers tuned within their tolerance.
        causes: that the search named, largest share first, with confidence and rivals.
        left: share of the nominal mean squared error beyond the noise that stays on the test part.
        structure: what is left that is not noise.
        whole_runs: whether the test part is whole runs, not pieces of runs that were fitted elsewhere.
        still: whether the joint hardly moves in any run.
        blind_to: causes that the motion would hardly show; asked only where nothing was found.
        beside: numbers of the nominal model that were refitted beside the causes, by more than their tolerance.
        held: why the link of a robot's joint moves as measured, and what to log instead.
        hidden: causes that such a link cannot show.
        limits: up to where each cause would not show; asked only where nothing was found.
        factors: by which the tuned numbers differ from the nominal ones, by number, the most telling first.
        beyond: the test part goes further than what was fitted, and errs there.
        data_errors: faults of the log.
        fault_in_replay: whether one of them was in a column that the replay takes or is judged by.
        open_causes: that are not named: withdrawn ones and near misses.
        of_robot: whether it is a joint of a robot.
        adrift: of such a joint that nothing holds, what its replay may be off by anyway.
        removed: where numbers were refitted beside the causes, the share of what these numbers leave on all data that
            no fit saw, and that the causes remove; None elsewhere: on the test part, of what tuned numbers leave.
        turned: the numbers that refitting turned, where the refitted model does better on unseen data than the causes.
    """

    joint: str
    errors: Mapping[str, Error]
    tuned: Error
    causes: Sequence[NamedCause]
    left: float
    structure: Structure
    whole_runs: bool = True
    still: bool = False
    blind_to: Sequence[str] = ()
    beyond: Finding | None = None
    data_errors: Sequence[DataError] = ()
    fault_in_replay: bool = False
    open_causes: Sequence[OpenCause] = ()
    turned: str = ""
    beside: str = ""
    held: Finding | None = None
    hidden: Sequence[str] = ()
    limits: Sequence[DetectionLimit] = ()
    factors: Mapping[str, float] = field(default_factory=dict)
    removed: float | None = None
    of_robot: bool = False
    adrift: Adrift | None = None

    def settled(self, limit: Thresholds = THRESHOLDS) -> bool:
        """As :func:`as_noise_allows`, of the model that is handed over."""
        error, noise = self.errors["extended"].rmse, self.errors["noise_floor"].rmse
        return as_noise_allows(self.structure, error, noise, self.of_robot, limit)

    def adds_up(self, limit: Thresholds = THRESHOLDS) -> bool:
        """Whether what is left is no more than what adds up in a replay that nothing holds."""
        return self.adrift is not None and self.adrift.allows(self.errors["noise_floor"].rmse, limit)

    def only_starts(self, limit: Thresholds = THRESHOLDS) -> bool:
        """Whether what is left is no more than where pieces begin does to a replay that nothing holds."""
        return self.adrift is not None and self.adrift.at_noise(self.errors["noise_floor"].rmse, limit)


@dataclass(frozen=True)
class Balanced:
    """Evidence of a torque balance: errors on the test blocks, causes if any, what stays, and what was withdrawn.

    Attributes:
        shift: by which the torque column is out of step, where that is among the causes [s].
        turned: as of :class:`Replayed`.
    """

    joint: str
    errors: Mapping[str, Error]
    causes: Sequence[NamedCause]
    left: float
    open_causes: Sequence[OpenCause] = ()
    shift: float | None = None
    turned: str = ""


@dataclass(frozen=True)
class Refused:
    """Why a log or a joint cannot be judged.

    Attributes:
        subject: in a sentence: ``'knee'``, ``the ground``.
        reason: a sentence or more.
        usable: whether the log as such is sound, and only what is asked of it is missing.
    """

    subject: str
    reason: str
    usable: bool = False


Evidence = Replayed | Balanced | Refused
