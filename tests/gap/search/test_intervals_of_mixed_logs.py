"""Errors that hang together: in logs of two rates, and at parameters that feel them differently."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from sealegs.gap.search.correlated import shared
from sealegs.gap.search.intervals import inflation


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
