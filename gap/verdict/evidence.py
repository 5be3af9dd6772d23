"""What a verdict is decided on, and the thresholds that it is compared with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ..experiment import DetectionLimit
from ..log.finding import Finding
from ..measure.case import Case
from ..measure.measured import Measured
from ..measure.named import NamedCause
from ..search.structure import Structure
from .verdict import DataError


@dataclass(frozen=True, eq=False)
class Replayed:
    """Evidence of a replay and a search.

    Attributes:
        case: the joint.
        measured: errors, causes, and what is left.
        data_errors: faults of the log.
        beyond: the test part goes further than what was fitted, and errs there.
        blind_to: causes that the motion would hardly show; asked only where nothing was found.
        limits: up to where each cause would not show; asked only where nothing was found.
        factors: by which the tuned numbers differ from the nominal ones, by number, the most telling first.
    """

    case: Case
    measured: Measured
    data_errors: Sequence[DataError] = ()
    beyond: Finding | None = None
    blind_to: Sequence[str] = ()
    limits: Sequence[DetectionLimit] = ()
    factors: Mapping[str, float] = field(default_factory=dict)

    @property
    def joint(self) -> str:
        """Its name."""
        return self.case.joint

    @property
    def causes(self) -> Sequence[NamedCause]:
        """That the search named, largest share first, with confidence and rivals."""
        return self.measured.causes

    @property
    def structure(self) -> Structure:
        """What is left that is not noise."""
        assert self.measured.structure is not None
        return self.measured.structure

    @property
    def fault_in_replay(self) -> bool:
        """Whether a fault of the log is in a column that the replay takes or is judged by."""
        columns = (f"{self.joint}.goal", f"{self.joint}.position")
        return self.case.unit == "rad" and any(error.column in columns for error in self.data_errors)


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


Evidence = Replayed | Refused
