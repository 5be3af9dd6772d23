"""An interval holds what a number is beside the rivals of another cause."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from sealegs.gap.measure.measured import beside_rivals
from sealegs.gap.replay.parameters import Parameter, factor

ROTOR = Parameter("load.extra_inertia", "kg.m2", 0.0, 0.04, 0.0, 0.01)
TUNED = factor("dc_motor.resistance", 0.94, 1.06, 0.05, 0.4)
BOUNDS = {ROTOR.path: (0.0287, 0.0326), TUNED.path: (0.95, 1.06)}


def fitted(rotor: float, resistance: float) -> Any:
    one = SimpleNamespace(values={ROTOR.path: rotor, TUNED.path: resistance})
    return one, one


def widened(*rivals: Any, accepted: bool = True) -> dict[str, tuple[float, float]]:
    """Intervals of a rotor beside an encoder that reads too much, with these in its place."""
    rounds = [SimpleNamespace(accepted=accepted), SimpleNamespace(accepted=False)]
    candidates = [SimpleNamespace(fits=fits) for fits in rivals]
    search: Any = SimpleNamespace(
        rounds=rounds, fits=fitted(0.0297, 1.0), close=lambda step: candidates * step.accepted,
        parameters=lambda: [ROTOR, TUNED],
    )  # fmt: skip
    nominal: Any = SimpleNamespace(value=lambda number: 2.7)
    return beside_rivals(search, BOUNDS, nominal)


def test_a_rotor_may_be_what_it_is_beside_a_rival_of_the_last_cause() -> None:
    """Beside an encoder's scale of 1.09 it was 0.0297 [0.0287, 0.0326], beside the weaker motor that was meant 0.02."""
    found = widened(fitted(0.0201, 1.0), fitted(0.0300, 1.02))
    assert found[ROTOR.path] == pytest.approx((0.0191, 0.0329))
    assert found[TUNED.path] == pytest.approx((0.95, 1.06))  # never beyond what may be


def test_without_a_rival_an_interval_stays() -> None:
    assert widened() == BOUNDS and widened(fitted(0.02, 1.0), accepted=False) == BOUNDS
