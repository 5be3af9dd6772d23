"""What a verdict is decided on, and the thresholds that it is compared with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ..experiment import DetectionLimit
from ..log.finding import Finding
from ..measure.confidence import THRESHOLDS, Adrift, Thresholds, as_noise_allows
from ..measure.named import Error, NamedCause, OpenCause
from ..search.structure import Structure
from .verdict import DataError


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
