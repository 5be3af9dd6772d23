"""A first look at a joint, from the starts that a delay has."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from sealegs.gap.search import look
from sealegs.gap.search.fit import Fit


def test_a_fit_that_stays_far_off_gives_way_to_one_from_another_start_nearby(monkeypatch: pytest.MonkeyPatch) -> None:
    """A joint at 0.5 mrad was told to be 2.9 mrad off, since the better fit had nearly the same delay."""
    ends = {None: (0.0091, 12.75), 0.00625: (0.0047, 0.49)}

    def fit(part: Any, parameters: Any, start: Mapping[str, float] | None, iterations: int) -> Fit:
        value, cost = ends[None if start is None else start["delay.seconds"]]
        return Fit({"delay.seconds": value}, np.zeros((1, 4)), cost)

    monkeypatch.setattr(look, "fit", fit)
    monkeypatch.setattr(look, "periods_of", lambda part: [0.01])
    starts = [(SimpleNamespace(path="delay.seconds", start=start),) for start in (0.02, 0.00625)]
    cause = SimpleNamespace(name=look.DELAY, variants=starts)
    assert look.looked(cast(Any, None), (), cast(Any, [cause])).cost == 0.49


def test_numbers_that_bring_a_replay_no_nearer_are_no_effects() -> None:
    """A joint within its noise was told to have a mass of 8 % more."""
    mass: Any = SimpleNamespace(path="load.mass_factor", neutral=lambda model: 1.0)
    problem: Any = SimpleNamespace(
        noise=0.5, models=[None], simulate=lambda rows: np.ones((len(rows), 9, 4)), position_error=lambda row: row[:, 0]
    )
    fitted = Fit({mass.path: 1.085}, np.zeros((9, 4)), 1.0)
    known = {mass.path: (1.051, 1.119)}, {mass.path: "load.mass"}
    near, far = (look.Look(problem, (mass,), fitted, *known, errors) for errors in ((0.52, 0.50), (5.0, 0.50)))
    assert near.effects() == {} and far.effects() == {mass.path: 1.0}
