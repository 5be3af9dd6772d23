"""What is passed along the way of a log: a joint that is ready to be searched, and what else is known of it."""

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
from ..replay.tree import HELD

ROBOT = "robot"
"""What stands in the place of a joint's name for what joints share."""


@dataclass(frozen=True, eq=False)
class Replay:
    """A joint or the ground, ready to be searched.

    Attributes:
        problem: all data.
        fitting: the same as the search sees them.
        wide: what refitting alone may turn, and how far; nothing where causes are held against what was found before.
        tuned: what every fit of the search turns.
        causes: that may be sought.
        stops: that the log shows.
        along: of a hinge of a robot that takes position goals, its load on a motion that is planned.
    """

    problem: Problem
    fitting: Problem
    wide: Sequence[Parameter] = ()
    tuned: Sequence[Parameter] = ()
    causes: Sequence[Cause] = ()
    stops: tuple[Stop, ...] = ()
    along: Along | None = None

    @property
    def of_robot(self) -> bool:
        """Whether it is of a joint of a robot that is replayed alone, whose other bodies are believed."""
        joint = self.problem.joint
        return joint is not None and joint.terms is not None


@dataclass(frozen=True, eq=False)
class Case:
    """What is known of a joint, whatever is found of it.

    Attributes:
        joint: its name, or ``ground``, or that of the whole robot.
        findings: about its log, its stops, and what its replay can show.
        signal: that is judged, as ``servo.position``.
        unit: of the signal.
        still: whether the joint hardly moves in any run: what fits that best may not be what it is.
        frames: of a robot's joints, as ``meta.frames`` of a sidecar has them.
        hidden: causes that a link which moves as measured cannot show.
        replay: of it; None where it cannot be replayed, or was read from a folder.
    """

    joint: str
    findings: tuple[Finding, ...] = ()
    signal: str = ""
    unit: str = "rad"
    still: bool = False
    frames: Mapping[str, Any] | None = None
    hidden: tuple[str, ...] = ()
    replay: Replay | None = None

    @property
    def held(self) -> Finding | None:
        """Why the link of a robot's joint moves as measured, and what to log instead."""
        return next((finding for finding in self.findings if finding.code == HELD), None)
