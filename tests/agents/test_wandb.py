"""Curves in Weights & Biases: off by default, offline on this machine, one run over all sessions."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest
from sealegs.agents.config import read_config

from tests.agents.short_training import SMALL, run


def test_nothing_is_tracked_unless_asked_for() -> None:
    config: Any = read_config(SMALL).config
    assert config.wandb is None


@pytest.mark.long
def test_offline_curves_stay_in_the_run_and_go_on_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WANDB_MODE", "offline")
    folder = tmp_path / "first"
    assert run(*SMALL, "wandb=tests", f"out={tmp_path}", "name=first") == 0
    (file,) = folder.glob("wandb/offline-run-*/run-*.wandb")
    identity = (folder / "wandb.txt").read_text()
    content = file.read_bytes()
    assert identity in file.name and b"time/fps" in content and b"eval/mean_reward" in content
    assert run(f"resume={folder}", "total_timesteps=256") == 0
    assert {path.name for path in folder.glob("wandb/offline-run-*/run-*.wandb")} == {f"run-{identity}.wandb"}
    assert len(list(folder.glob("wandb/offline-run-*"))) == 2


def test_without_the_package_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "wandb", None)
    assert run(*SMALL, "wandb=tests", f"out={tmp_path}", "name=first") == 2
    assert "wandb=tests needs the package wandb: pip install 'sealegs[wandb]'" in capsys.readouterr().err
