"""A finished run for all tests of training."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.agents.training_runs import SMALL, run


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run of PPO from start to end."""
    out = tmp_path_factory.mktemp("runs")
    assert run(*SMALL, f"out={out}", "name=first", "total_timesteps=512") == 0
    return out / "first"
