"""Intervals: errors that hang together, instants at which a column was read, and rivals of another cause."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import sealegs
from sealegs.gap.fit import FittedValue
from sealegs.gap.measure.measured import beside_rivals
from sealegs.gap.replay.parameters import Parameter, factor
from sealegs.gap.search.correlated import shared
from sealegs.gap.search.intervals import inflation

from testbed import hidden_bench


def drifting(time: np.ndarray, memory: float) -> np.ndarray:
    """Errors of unit variance that forget within ``memory`` [s]."""
    rng = np.random.default_rng(2)
    kept = np.exp(-np.diff(time, prepend=time[0]) / memory)
    error, last = np.empty(len(time)), rng.standard_normal()
    for k, share in enumerate(kept):
        last = share * last + np.sqrt(1.0 - share**2) * rng.standard_normal()
        error[k] = last
    return error


def test_what_neighbours_share_does_not_hang_on_which_run_comes_first() -> None:
    """The first run's period counted for all: 0.62 or 0.89 by their order."""
    times = np.arange(0.0, 20.0, 0.002), np.arange(0.0, 400.0, 0.02)
    errors = [drifting(time, 0.1) for time in times]
    found = []
    for order in ((0, 1), (1, 0)):
        starts = np.cumsum([0, *(len(times[k]) for k in order)])
        problem = SimpleNamespace(time=np.concatenate([times[k] for k in order]), starts=starts)
        found.append(shared(cast(Any, problem), np.concatenate([errors[k] for k in order])))
    assert found[0] == pytest.approx(found[1])


def test_each_parameter_is_widened_by_how_its_own_errors_hang_together() -> None:
    """A mean over all: a slow parameter beside a quick one had an interval of half its size."""
    rng = np.random.default_rng(0)
    moves = rng.standard_normal((4000, 2)) * np.sqrt([50.0, 1.0])
    found = inflation(np.eye(2), moves)
    assert found[0] == pytest.approx(50.0, rel=0.1) and found[1] == pytest.approx(1.0, rel=0.1)


ASKED = ("friction.viscous", "delay.seconds")


def true_and_fitted(seed: int) -> dict[str, tuple[float, FittedValue]]:
    """What a machine has, and what is fitted to 6 s of it; its duty and current are up to 0.25 ms old when read."""
    data, truth = hidden_bench({"friction.viscous": 0.05}, seed=seed, runs=1, duration=6.0, nominal_error=0.0)
    machine = truth["machines"][0]
    found = sealegs.fit(data, ASKED)
    return {name: (getattr(machine, key), found.values[name]) for name, key in zip(ASKED, KEYS, strict=True)}


KEYS = ("viscous", "command_delay")


def test_columns_that_are_read_a_little_late_widen_the_intervals_of_delay_and_viscous_friction() -> None:
    """Both left the truth out: the clock widened no number that is fitted as a factor, and none but times."""
    for true, value in true_and_fitted(3).values():
        assert value.low < true < value.high
        assert value.high - value.low < 0.08 * true


@pytest.mark.long
def test_intervals_of_delay_and_viscous_friction_hold_the_truth() -> None:
    seeds = range(1, 9)
    inside: dict[str, int] = dict.fromkeys(ASKED, 0)
    for seed in seeds:
        for name, (true, value) in true_and_fitted(seed).items():
            inside[name] += value.low < true < value.high
    assert min(inside.values()) >= len(seeds) - 1, inside


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
