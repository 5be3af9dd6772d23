"""Where a search under way stands."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from .fit import Fit
from .record import Step
from .result import Candidate, Round


@dataclass(frozen=True, eq=False)
class Judged:
    """A model and its loss on data that its fits did not see.

    Attributes:
        fits: to the two parts, each judged on the other.
        blocks: loss of each block (b,).
        sampled: loss per value of what is judged sample by sample.
    """

    fits: tuple[Fit, Fit]
    blocks: np.ndarray
    sampled: float


@dataclass
class Found:
    """What a search under way has found.

    Attributes:
        current: the model with the causes accepted so far.
        accepted, rounds, steps: as :class:`sealegs.gap.search.result.Search` and its record have them.
        settled: key of the cause that was chosen beside all others, so that nothing more is asked of it.
    """

    current: Judged
    accepted: list[Candidate] = field(default_factory=list)
    rounds: list[Round] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    settled: str = ""

    def put(self, current: Judged, settled: str = "") -> None:
        """Take a model in which other causes stand; what was accepted is from now on as it is in that one."""
        self.current, self.settled = current, settled
        values = (current.fits[0].values, current.fits[1].values)
        self.accepted[:] = [
            replace(
                one,
                fits=current.fits,
                evidence=replace(one.evidence, blocks=current.blocks, sampled=current.sampled, values=values),
            )
            for one in self.accepted
        ]
