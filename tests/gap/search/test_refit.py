"""The refitted baseline: as good as any of its starts finds, and never worse than what is believed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sealegs.gap.replay.comparison import robust_loss
from sealegs.gap.replay.parameters import Parameter
from sealegs.gap.search.refit import refit
from sealegs.gap.search.settings import DEFAULT

NUMBER = Parameter("friction.coulomb", "N.m", 0.0, 10.0, 0.0, 0.1)


class Machine:
    """One number; errors of samples are what ``errors`` says of it."""

    judged = np.ones(100, bool)
    joint = None
    models = (SimpleNamespace(value=lambda path: 0.0),)

    def simulate(self, rows: list[dict[str, float]]) -> np.ndarray:
        return np.stack([self.errors(row.get(NUMBER.path, 0.0)) for row in rows])[..., None]

    def residual(self, simulated: np.ndarray, every: int = 1) -> np.ndarray:
        return simulated[:, ::every, 0]

    def position_error(self, simulated: np.ndarray) -> np.ndarray:
        return simulated[:, 0]

    def errors(self, x: float) -> np.ndarray:
        """Most samples ask for 1, and a few that are far off for as little as can be."""
        return np.concatenate([np.full(95, 5.0 * (1.0 - x)), np.full(5, 100.0 + 30.0 * x)])


def rms(machine: Any, x: float) -> float:
    return float(np.sqrt(np.mean(machine.errors(x) ** 2)))


def test_a_refitted_model_is_never_worse_than_the_believed_one_on_what_it_was_fitted_to() -> None:
    """The robust loss fell, and the error rose: 318 mrad in place of 310."""
    machine: Any = Machine()
    assert robust_loss(machine.errors(1.0)).sum() < robust_loss(machine.errors(0.0)).sum()
    assert rms(machine, 1.0) > rms(machine, 0.0)
    found = refit(machine, [NUMBER], (), DEFAULT)
    assert rms(machine, found.values[NUMBER.path]) <= rms(machine, 0.0)


class Trapped(Machine):
    """Far from its optimum the error ripples, so that a fit from the believed number stays where it is."""

    noise = 1.0

    @property
    def joint(self) -> Any:  # pyright: ignore[reportIncompatibleVariableOverride]
        return SimpleNamespace(noise=1.0)

    def errors(self, x: float) -> np.ndarray:
        return np.full(100, 40.0 * abs(x - 5.0) + 30.0 * np.cos(8.0 * np.pi * x))


def test_a_start_that_is_known_to_be_better_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sealegs.gap.search.refit._coarse", lambda *given: {})
    monkeypatch.setattr("sealegs.gap.search.refit.is_long", lambda *given: False)
    monkeypatch.setattr("sealegs.gap.search.sketch.is_long", lambda *given: False)
    machine: Any = Trapped()
    alone, helped = (refit(machine, [NUMBER], starts, DEFAULT) for starts in ((), ({NUMBER.path: 4.9},)))
    assert helped.cost < 0.5 * alone.cost
