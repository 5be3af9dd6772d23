"""Controllers tuned on rigid cables, as the paper's was before it knew that its cables stretch (VIII-C).

    python -m sealegs.papers.biped.tune_on_rigid        about eight minutes

Draws gains and lean at random and prints those with which the biped hops for 30 s on rigid cables, without the update
(44) that the paper added later. ``choices.TUNED_ON_RIGID`` holds all of them; none was chosen by what it
does on stretching cables.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...common.errors import SealegsError
from .choices import DRAWN_FROM, DRAWS
from .controller import Gait
from .hopping import STEADY, HoppingExperiment, rigid_cables
from .paper import SUBSTEPS

LEAN = (-0.02, 0.25)  # [rad]
GAINS, DAMPINGS = ((15.0, 90.0), (4.0, 25.0)), ((1.0, 10.0), (0.03, 0.6))  # [N.m/rad], [N.m.s/rad] of angle and shape
FIRST, LASTS = (5.0, 4), (30.0, STEADY)  # [s], and least hops within them


def drawn(seed: int = DRAWN_FROM, draws: int = DRAWS) -> Iterator[Gait]:
    """Random controllers; numbers of three digits, gains and dampings evenly on a logarithmic scale."""
    rng = np.random.default_rng(seed)

    def pair(bounds: tuple[tuple[float, float], tuple[float, float]]) -> tuple[float, float]:
        first, second = (_rounded(np.exp(rng.uniform(np.log(low), np.log(high)))) for low, high in bounds)
        return first, second

    for _ in range(draws):
        lean = _rounded(rng.uniform(*LEAN))
        yield Gait(torso=lean, torso_gain=0.0, gains=pair(GAINS), dampings=pair(DAMPINGS))


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")


def hops_on_rigid(gait: Gait) -> bool:
    """Whether the biped hops on rigid cables without a fall."""
    for seconds, least in (FIRST, LASTS):
        try:
            hopping = HoppingExperiment(gait, rigid_cables, substeps=SUBSTEPS).run(10_000, seconds)
        except SealegsError:  # unstable
            return False
        if hopping.fell or hopping.hops < least:
            return False
    return True


if __name__ == "__main__":
    for found in filter(hops_on_rigid, drawn()):
        print(f"({found.torso:g}, {found.gains}, {found.dampings}),", flush=True)
