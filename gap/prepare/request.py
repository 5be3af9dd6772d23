"""What a person asks of a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..experiment import Limits
from ..log.progress import Progress
from ..search.latency import Latency
from ..search.settings import DEFAULT, SearchSettings


@dataclass(frozen=True)
class Request:
    """What a person asked for; the attributes are the arguments of :func:`diagnose`.

    Attributes:
        latency: what was found of it at all joints, before their own causes are sought.
    """

    test_group: str | None = None
    seed: int = 0
    progress: Progress = lambda text: None
    limits: Limits | None = None
    causes: Sequence[str] | None = None
    search: SearchSettings = DEFAULT
    look_on: bool = False
    latency: Latency | None = None
