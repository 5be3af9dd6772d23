"""A model that spoils what the believed one had right is not handed over."""

from __future__ import annotations

import numpy as np
from sealegs.gap.measure.harm import harm_of

NOISE = 1e-3
BLOCK = np.repeat(np.arange(10), 50)
RNG = np.random.default_rng(0)
QUIET = NOISE * RNG.standard_normal(500)


def after_a_trip(size: float) -> np.ndarray:
    """Errors that are noise until something trips in the last third."""
    return QUIET + np.where(BLOCK >= 7, size, 0.0)


def test_a_model_that_is_off_where_the_believed_one_was_exact_does_harm() -> None:
    """An overload trip was handed over as fivefold friction: 16 mrad off where the believed model was exact."""
    assert harm_of(after_a_trip(0.1), QUIET + 0.016, BLOCK, 10, NOISE) > 0.015


def test_a_model_that_mends_the_rest_and_stays_near_the_noise_does_none() -> None:
    assert harm_of(after_a_trip(0.1), 1.5 * QUIET, BLOCK, 10, NOISE) == 0.0


def test_a_believed_model_that_is_right_almost_nowhere_says_nothing() -> None:
    nominal = QUIET + np.where(BLOCK >= 1, 0.05, 0.0)
    assert harm_of(nominal, QUIET + 0.016, BLOCK, 10, NOISE) == 0.0
