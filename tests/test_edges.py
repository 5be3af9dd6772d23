"""A law at the edge of its own shape is the simpler law that it is there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.causes.cause import Cause
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.search.fit import Fit
from sealegs.gap.search.forward import Judged, Searcher
from sealegs.gap.search.result import Candidate

from tests.smooth_bench import CHAIN
from tests.test_decisions import evidence


class Slow:
    """Data of a joint that moves at up to 1 rad/s."""

    def simulate(self, variants: list[dict[str, float]]) -> np.ndarray:
        return np.zeros((len(variants), 3, 4))

    def covariates(self, simulated: np.ndarray) -> dict[str, np.ndarray]:
        del simulated
        return {"speed": np.array([-1.0, 0.2, 1.0])}


def left(velocity: float, *names: str, taken: tuple[str, ...] = ()) -> list[str]:
    """Names of what stays of a Stribeck friction that was found with a velocity [rad/s]."""
    causes = {cause.name: cause for cause in catalogue(JointModel(load_chain(CHAIN)), names)}
    searcher: Any = object.__new__(Searcher)
    searcher.shown, searcher.parts = list(causes.values()), (Slow(), Slow())
    values = {"friction.stribeck": 0.04, "friction.stribeck_velocity": velocity}
    fit = Fit(values, np.zeros((3, 4)), 1.0)
    fits = (fit, fit)
    searcher.fit_both = lambda parameters, start: fits
    searcher.judged = lambda found: Judged(found, np.ones(60), 1.0)

    def made(cause: Cause, variant: Any, judged: Judged) -> Candidate:
        return Candidate(cause, variant, judged.fits, replace(evidence(cause.name, 0.3), blocks=judged.blocks))

    searcher.candidate = made
    searcher.at_edge = lambda candidate: Searcher.at_edge(searcher, candidate)
    stribeck = causes["friction.stribeck"]
    found = [made(stribeck, stribeck.variants[0], Judged(fits, np.ones(60), 1.0))]
    return [c.cause.name for c in Searcher.simplest(searcher, found, (), set(taken))]


@pytest.mark.parametrize("velocity", [1.2, 3.0])
def test_stribeck_friction_beyond_all_speeds_of_the_log_is_dry_friction(velocity: float) -> None:
    """It was named with confidence 1.00 at a velocity of 3.0 rad/s, its bound, where dry friction was hidden."""
    both = ("friction.stribeck", "friction.coulomb")
    assert left(velocity, *both) == ["friction.coulomb"]
    assert left(velocity, *both, taken=("friction.coulomb",)) == []


def test_within_the_speeds_of_the_log_it_stays_what_it_is() -> None:
    assert left(0.2, "friction.stribeck", "friction.coulomb") == ["friction.stribeck"]
    assert left(3.0, "friction.stribeck") == ["friction.stribeck"]
