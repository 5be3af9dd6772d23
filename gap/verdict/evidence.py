"""What a verdict is decided on, and the thresholds that it is compared with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..log.finding import Finding
from ..search.structure import Structure
from .verdict import DataError, Error, NamedCause, OpenCause


@dataclass(frozen=True)
class Thresholds:
    """What the decision compares with.

    Attributes:
        negligible: most unexplained share of the gap that still counts as explained while structure is noticed; its
            causes must be certain, and the structure no larger than the noise.
        feeble: least share of the mean squared error of the tuned model that causes must remove beside structure.
        sure: least confidence of a cause that is named alone.
        certain: least confidence of a cause that is certain, whatever is said of others. Of the causes that the hidden
            benches named with as much, 173 of 175 were right; between ``sure`` and it, 12 of 15; below, 10 of 18
            (``python -m benchmarks.calibration``).
        torque_explained: most unexplained share of a torque gap that counts as explained by a shift.
        torque_nothing: most unexplained share of it, without a shift, that counts as nothing to explain.
    """

    negligible: float = 0.03
    feeble: float = 0.3
    sure: float = 0.6
    certain: float = 0.9
    torque_explained: float = 0.15
    torque_nothing: float = 0.05


THRESHOLDS = Thresholds()


@dataclass(frozen=True)
class Replayed:
    """Evidence of a replay and a search.

    Attributes:
        joint: its name.
        errors: of the models on the test part, as :attr:`JointDiagnosis.gap`.
        tuned: error there of the nominal model with its numbers tuned within their tolerance.
        causes: that the search named, largest share first, with confidence and near misses.
        left: share of the nominal mean squared error beyond the noise that stays on the test part.
        structure: what is left that is not noise.
        whole_runs: whether the test part is whole runs, not pieces of runs that were fitted elsewhere.
        still: whether the joint hardly moves in any run.
        blind_to: causes that the motion would hardly show; asked only where nothing was found.
        held: why the link of a robot's joint moves as measured, and what to log instead.
        hidden: causes that such a link cannot show.
        beyond: the test part goes further than what was fitted, and errs there.
        data_errors: faults of the log.
        fault_in_replay: whether one of them was in a column that the replay takes or is judged by.
        open_causes: that are not named: withdrawn ones and near misses.
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
    held: Finding | None = None
    hidden: Sequence[str] = ()


@dataclass(frozen=True)
class Balanced:
    """Evidence of a torque balance: errors on the test blocks, causes if any, what stays, and what was withdrawn."""

    joint: str
    errors: Mapping[str, Error]
    causes: Sequence[NamedCause]
    left: float
    open_causes: Sequence[OpenCause] = ()


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
