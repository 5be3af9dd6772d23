"""Intervals of numbers that lean on the instant at which a column was read."""

from __future__ import annotations

import pytest
import sealegs
from sealegs.gap.fit import FittedValue

from testbed import hidden_bench

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
