"""What is measured of a joint, as typed data: errors, values, and causes that are named or left open."""

from __future__ import annotations

from dataclasses import dataclass

from .signatures import Signature

CERTAIN, LIKELY, POSSIBLE, ONE_OF_SEVERAL, WITHDRAWN, NEAR_MISS = (
    "certain",
    "likely",
    "possible",
    "one of several",
    "withdrawn",
    "near miss",
)
"""Standing of a cause: of those named the first four, of those not named the last two."""


@dataclass(frozen=True)
class Error:
    """Error of one model on the test part: root mean square and mean absolute."""

    rmse: float
    mae: float


@dataclass(frozen=True)
class Value:
    """A parameter that was found: value, 95 % interval, unit, and what the nominal model has."""

    value: float
    low: float
    high: float
    unit: str
    nominal: float


@dataclass(frozen=True)
class NamedCause:
    """A cause in the verdict.

    Attributes:
        name, sentence, joint: what it is and where.
        share: of the nominal model's mean squared error beyond the noise, that the final model owes to this cause: by
            how far its replay moves when the cause is put back to what is believed.
        confidence: win rate x removed / (removed + residual structure + model error) x beyond refitting x doubts; see
            docs/verdict.md. The win rate is the share of block-bootstrap draws in which it beats every other candidate
            on data that its fit did not see.
        parameters: by path.
        gain: error that it removed when it was found, as a share of the error before; cross-validated on the data that
            chose it.
        kind: ``effect`` that the model lacks, wrong ``number`` of the model, or, where a column's fault is itself what
            is fitted (a torque column that lags), ``data``.
        picture: which picture shows it.
        rivals: those that win more than 5 % of the draws of the round that it won, less those that are named, too.
        standing: :data:`CERTAIN`, :data:`LIKELY`, :data:`POSSIBLE` or :data:`ONE_OF_SEVERAL`, whatever is said of other
            causes.
        signatures: features that it must bring to where they were measured before it is certain.
        against: as of the cause in the catalogue.
    """

    name: str
    sentence: str
    joint: str
    share: float
    confidence: float
    parameters: dict[str, Value]
    gain: float
    kind: str
    picture: str = ""
    rivals: tuple[str, ...] = ()
    standing: str = LIKELY
    signatures: tuple[Signature, ...] = ()
    against: str = "speed"


@dataclass(frozen=True)
class OpenCause:
    """A cause that is not named, though something speaks for it.

    Attributes:
        name: of the cause.
        standing: :data:`WITHDRAWN` (it was named, and does not hold) or :data:`NEAR_MISS` (it nearly was).
        sentence: why, or what it lacks, in words that go on after its name and a colon.
    """

    name: str
    standing: str
    sentence: str
