"""What is passed along the way of a log: a joint cut into parts, its replay, and what else is known of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..causes.cause import Cause
from ..checks.stops import Stop
from ..experiment import Along
from ..log.finding import Finding
from ..replay.parameters import Parameter
from ..replay.problem import Problem


@dataclass(frozen=True, eq=False)
class Replay:
    """A joint or the ground, ready to be searched.

    Attributes:
        problem: all data.
        fitting: the same as the search sees them.
        wide: what refitting alone may turn, and how far.
        tuned: what every fit of the search turns.
        causes: that may be sought.
        findings: about what this replay can show, and the stops of the joint.
        stops: that the log shows.
        hidden: causes that a link which moves as measured cannot show.
        along: of a hinge of a robot that takes position goals, its load on a motion that is planned.
    """

    problem: Problem
    fitting: Problem
    wide: Sequence[Parameter]
    tuned: Sequence[Parameter]
    causes: Sequence[Cause] = ()
    findings: tuple[Finding, ...] = ()
    stops: tuple[Stop, ...] = ()
    hidden: tuple[str, ...] = ()
    along: Along | None = None


@dataclass(frozen=True, eq=False)
class Case:
    """What is known of a joint beside its replay.

    Attributes:
        joint: its name, or ``ground``.
        findings: about its log.
        still: whether it hardly moves in any run: what fits that best may not be what it is.
        frames: of a robot's joints, as ``meta.frames`` of a sidecar has them.
    """

    joint: str
    findings: tuple[Finding, ...] = ()
    still: bool = False
    frames: Mapping[str, Any] | None = None
