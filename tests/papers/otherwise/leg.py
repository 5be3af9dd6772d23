"""The leg's rows on few lines and paths, and another value of each of its chosen numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from sealegs.actuators import Chain
from sealegs.envs.leg.parameters import NUMBERS
from sealegs.envs.leg.robot import chains_of
from sealegs.papers.leg import control, paper, table_rows, tracking
from sealegs.papers.leg import rows as leg
from sealegs.papers.leg.choices import MEASURE, SIGN
from sealegs.papers.published import Row

from .changes import Change, assumed_numbers, attribute, item

FEW, DRAWS, PATHS, SHORT = 30, 2, 8, 0.8  # lines and draws of them, paths, and seconds of each


def rows() -> Sequence[Row]:
    """All rows."""
    analysis, own = paper.Analysis(), leg.OWN_SPEED
    lines = analysis.lines(FEW, horizontal=True)
    found = {speed: [analysis.along(line, speed) for line in lines] for speed in (paper.FIGURE_7, own)}
    sweeps = [leg.swept(speed, contributions) for speed, contributions in found.items()]
    drawn = {speed: paper.draws(analysis, speed, FEW, DRAWS) for speed in found}
    slanted = paper.draws(analysis, own, FEW, DRAWS, horizontal=False)
    commands = tracking.other_paths()[:PATHS]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tracking, "other_paths", lambda: commands)
        patch.setattr(leg, "FAST_LINES", 6)
        return [
            *table_rows.table_rows(),
            *table_rows.motor_rows(),
            *table_rows.equation_rows(analysis, paper.against_engine(20)),
            *leg.speed_rows(analysis),
            *leg.gearing_rows(found, drawn[own], slanted),
            *leg.coriolis_rows(sweeps, drawn, slanted),
            *leg.mechanical_rows(found[own]),
            *leg.actuator_rows(analysis, found[own], sweeps),
            *tracking.control_rows(tracking.controllers(analysis, SHORT)),
        ]


def chains(path: str, factor: float) -> Change:
    """Drives one number of which is another, wherever a chain has it."""

    def changed(file: str) -> dict[str, Chain]:
        stage = path.partition(".")[0]
        return {
            name: chain if chain.find(stage) is None else chain.with_value(path, factor * chain.value(path))
            for name, chain in chains_of(file).items()
        }

    return together(attribute(paper, "chains_of", changed), attribute(tracking, "chains_of", changed))


def together(*changes: Change) -> Change:
    """Several changes at once."""

    def all_of_them(patch: pytest.MonkeyPatch) -> None:
        for change in changes:
            change(patch)

    return all_of_them


def beside_its_own(found: paper.Contributions) -> float:
    """Another measure of figure 7: Coriolis torque over the perturbation of the same joint, of the worst joint."""
    return float((paper.peak(found.coriolis) / paper.peak(found.perturbation)).max())


OTHERWISE: Mapping[str, Change] = {
    **assumed_numbers(NUMBERS),
    SIGN: item(NUMBERS, "product_sign", replace(NUMBERS["product_sign"], value=-1.0)),
    "lines of the foot": attribute(paper, "REACH_HIGH", np.array([0.45, 0.3, 0.05])),
    "speed of the foot": attribute(leg, "OWN_SPEED", 0.5),
    MEASURE: attribute(paper, "coriolis_error", beside_its_own),
    "supply": chains("supply.volts", 0.9),
    "paths of the foot": attribute(tracking, "other_paths", lambda: control.paths(PATHS, seed=3)),
    "gains": chains("position_pi.gain", 0.8),
    "period": together(attribute(control, "PERIOD", 0.004), chains("position_pi.period", 2.0)),
}
