"""Curvature along a valley, where differences of single parameters are ripple."""

from __future__ import annotations

import numpy as np
import pytest
from sealegs.gap.search.axes import along_axes

ROOT = np.sqrt(0.5)
LOW, HIGH = np.full(2, -10.0), np.full(2, 10.0)


def rippled(rows: np.ndarray) -> np.ndarray:
    """Residuals (v, 200) of two parameters that do the same, but for a thousandth, with a ripple of each alone."""
    rng = np.random.default_rng(0)
    along, across, *phases = rng.standard_normal((4, 200))
    together, apart = (rows @ [1.0, 1.0]) * ROOT, (rows @ [1.0, -1.0]) * ROOT
    waves = [0.03 * np.sin(60.0 * rows[:, k, None] + 6.0 * phases[k]) for k in range(2)]
    return 40.0 * together[:, None] * along + 0.04 * apart[:, None] * across + waves[0] + waves[1]


def by_one(step: float) -> np.ndarray:
    """Jacobian (2, 200) by differences of one parameter at a time."""
    sides = rippled(np.concatenate([step * np.eye(2), -step * np.eye(2)]))
    return (sides[:2] - sides[2:]) / (2.0 * step)


def spread(jacobian: np.ndarray) -> float:
    """Standard deviation of the first parameter."""
    return float(np.sqrt(np.linalg.inv(jacobian @ jacobian.T)[0, 0]))


def test_what_two_parameters_leave_open_together_is_seen_through_the_ripple_of_each() -> None:
    """A resistance beside friction seemed known to 2 %, and a fit that held it 5 % off was as good."""
    true = 1.0 / (0.04 * np.sqrt(200.0)) * ROOT
    alone = by_one(0.02)
    found = along_axes(rippled, np.zeros(2), (LOW, HIGH), alone, np.ones(200))
    assert spread(alone) < 0.3 * true
    assert spread(found) == pytest.approx(true, rel=0.5)


def test_an_axis_that_bounds_leave_no_room_stays_as_it_was_seen() -> None:
    alone = by_one(0.1)
    found = along_axes(rippled, np.zeros(2), (np.zeros(2), np.full(2, 1e-4)), alone, np.ones(200))
    assert np.allclose(found, alone)


def test_a_parameter_that_does_nothing_stays_open() -> None:
    first = np.eye(2, 50)
    found = along_axes(lambda rows: rows[:, :1] * np.ones(50), np.zeros(2), (LOW, HIGH), first, np.ones(50))
    assert found.shape == (2, 50) and np.isfinite(found).all()


def test_an_axis_along_which_nothing_cancels_is_left_to_the_differences() -> None:
    """A delay between two samples changes nothing, and one that was told by its samples was open altogether."""
    stairs = lambda rows: 30.0 * np.floor(rows / 0.5 + 0.5) * np.ones(50)  # noqa: E731
    first = np.full((1, 50), 60.0)
    found = along_axes(stairs, np.zeros(1), (LOW[:1], HIGH[:1]), first, np.ones(50))
    assert np.allclose(found, first)
