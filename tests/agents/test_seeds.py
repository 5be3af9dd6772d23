"""Runs of several seeds: their table, their curve, and what a resume repeats."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from sealegs.agents import training
from sealegs.agents.seeds import interquartile_mean
from sealegs.configs.script import Interrupted

from tests.agents.short_training import SMALL, run


def test_the_interquartile_mean_leaves_out_the_outer_quarters() -> None:
    values = np.array([[-100.0], [1.0], [2.0], [3.0], [4.0], [5.0], [6.0], [100.0]])
    mean, low, high = interquartile_mean(values)
    assert mean == pytest.approx([3.5]) and low[0] < 3.5 < high[0]
    assert np.isnan(interquartile_mean(values[:2])[1]).all(), "two seeds have no interval"


def test_the_interval_of_many_normal_seeds_is_that_of_theory() -> None:
    """The interquartile mean of n normal numbers has a standard deviation of about 1.09 / sqrt(n)."""
    _, low, high = interquartile_mean(np.random.default_rng(1).normal(size=(400, 1)))
    assert (high - low)[0] == pytest.approx(2 * 1.96 * 1.09 / 20.0, rel=0.15)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["seeds=0"], "seeds must be at least 1"),
        (["seeds=2", "seed=[1,2]"], "say the same"),
        (["seed=[1,1]"], "each once"),
        (["seed=[]"], "one seed at least"),
        (["seed=[1,x]"], "seed"),
    ],
)
def test_seeds_that_are_none_are_one_sentence(
    words: list[str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*SMALL, f"out={tmp_path}", *words) == 2
    said = capsys.readouterr().err
    assert sentence in said and said.count("\n") == 1 and not list(tmp_path.iterdir())


def test_a_stopped_run_of_seeds_goes_on_without_repeating_the_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    learn, learned = training.Session.learn, []

    def stops_at_the_second(session: training.Session) -> None:
        if session.config.seed == 5:
            raise Interrupted("Stopped")
        learn(session)

    monkeypatch.setattr(training.Session, "learn", stops_at_the_second)
    assert run(*SMALL, "seed=[3,5,8]", f"out={tmp_path}", "name=mine") == 130
    folder = tmp_path / "mine"
    assert f"sealegs train resume={folder}" in capsys.readouterr().err
    first = (folder / "seed3" / "final" / "policy.safetensors").read_bytes()

    def counted(session: training.Session) -> None:
        learned.append(session.config.seed)
        learn(session)

    monkeypatch.setattr(training.Session, "learn", counted)
    assert run(f"resume={folder}") == 0
    assert learned == [5, 8]
    assert (folder / "seed3" / "final" / "policy.safetensors").read_bytes() == first
    assert (folder / "seed5" / "final" / "policy.safetensors").read_bytes() != first
    table = capsys.readouterr().out
    assert (
        re.search(r"interquartile mean \| -?[\d.]+", table) and "its 95 % interval" in (folder / "seeds.md").read_text()
    )
    document = json.loads((folder / "seeds.json").read_text())
    rewards = [row["final policy"] for row in document["seeds"].values()]
    assert list(document["seeds"]) == ["seed3", "seed5", "seed8"]
    assert document["interquartile_mean"]["final policy"]["mean"] == pytest.approx(np.mean(rewards))
    assert (folder / "seeds.png").stat().st_size > 5000
    assert run(f"resume={folder}") == 0 and learned == [5, 8], "all are finished: only the table is made again"
    assert run(f"resume={folder}", "total_timesteps=192") == 0 and learned == [5, 8, 3, 5, 8]


def test_a_seed_of_several_is_the_run_of_that_seed(tmp_path: Path) -> None:
    assert run(*SMALL, "seed=[4,7]", f"out={tmp_path}", "name=both") == 0
    assert run(*SMALL, "seed=7", f"out={tmp_path}", "name=one") == 0
    both, one = tmp_path / "both" / "seed7", tmp_path / "one"
    assert yaml.safe_load((both / "config.yaml").read_text()) == yaml.safe_load((one / "config.yaml").read_text())
    policies = [(folder / "final" / "policy.safetensors").read_bytes() for folder in (both, one)]
    assert policies[0] == policies[1]
