"""Curves and runs of several seeds: table, study, what a resume repeats, and what Weights & Biases gets."""

from __future__ import annotations

import json
import re
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from sealegs.agents import training
from sealegs.agents.config import read_config
from sealegs.agents.policy_files import load_policy
from sealegs.agents.seeds import interquartile_mean, read_curve
from sealegs.common.errors import SealegsError
from sealegs.configs.compose import choices
from sealegs.configs.script import Interrupted

from benchmarks import learning
from benchmarks.kept import CHECKOUT
from benchmarks.learning import Bar, interval, told
from tests.agents.training_runs import SHORT, run


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
    assert run(*SHORT, f"out={tmp_path}", *words) == 2
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
    assert run(*SHORT, "seed=[3,5,8]", f"out={tmp_path}", "name=mine") == 130
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
    assert run(*SHORT, "seed=[4,7]", f"out={tmp_path}", "name=both") == 0
    assert run(*SHORT, "seed=7", f"out={tmp_path}", "name=one") == 0
    both, one = tmp_path / "both" / "seed7", tmp_path / "one"
    assert yaml.safe_load((both / "config.yaml").read_text()) == yaml.safe_load((one / "config.yaml").read_text())
    policies = [(folder / "final" / "policy.safetensors").read_bytes() for folder in (both, one)]
    assert policies[0] == policies[1]


def test_nothing_is_tracked_unless_asked_for() -> None:
    config: Any = read_config(SHORT).config
    assert config.wandb is None


@pytest.mark.long
def test_offline_curves_stay_in_the_run_and_go_on_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wandb = pytest.importorskip("wandb")
    monkeypatch.setenv("WANDB_MODE", "offline")
    folder = tmp_path / "first"
    assert run(*SHORT, "wandb=tests", f"out={tmp_path}", "name=first") == 0
    wandb.teardown()  # its service writes the file, and has written all of it only once it has ended
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
    assert run(*SHORT, "wandb=tests", f"out={tmp_path}", "name=first") == 2
    assert "wandb=tests needs the package wandb: pip install 'sealegs[wandb]'" in capsys.readouterr().err


STUDY = ("env=bench", "total_timesteps=64", "n_envs=2", "agent.n_steps=16", "agent.batch_size=16", "evaluate.every=32")


def test_the_interval_is_students() -> None:
    mean, half = interval(np.array([[1.0], [2.0], [3.0], [4.0], [5.0]]))
    assert mean == pytest.approx([3.0])
    assert half == pytest.approx([2.776 * np.sqrt(2.5 / 5.0)], rel=1e-3)
    assert np.isnan(interval(np.array([[1.0]]))[1]).all()


def test_the_curve_covers_the_steps_in_which_all_seeds_were_evaluated(tmp_path: Path) -> None:
    for seed, steps in enumerate(([10, 20, 30], [10, 30, 40])):
        folder = tmp_path / f"seed{seed}"
        folder.mkdir()
        results = np.array([[step + seed - 1.0, step + seed + 1.0] for step in steps])
        np.savez(folder / "evaluations.npz", timesteps=steps, results=results)
    curve = read_curve([tmp_path / "seed0", tmp_path / "seed1"])
    assert curve.steps.tolist() == [10, 20, 30]
    assert curve.rewards.tolist() == [[10.0, 20.0, 30.0], [11.0, 21.0, 31.0]]


def test_a_missed_bar_is_called_missed() -> None:
    rows = {0: {"speed": 1.0}, 1: {"speed": 3.0}}
    text = told("hexapod", ("env=hexapod",), rows, {"speed": 2.5}, [Bar("at least 2", "1 to 3", False)])
    assert "| **no** | 1 to 3 | at least 2 |" in text
    assert "| reference controller | 2.5 |" in text
    assert "2 ± 13" in text


@pytest.mark.long
def test_a_seed_is_trained_once_and_its_policy_kept(tmp_path: Path) -> None:
    target = tmp_path / "policies" / "seed3"
    learning.train((*STUDY, "video.seconds=0"), 3, tmp_path / "runs", target)
    kept = {path.name for path in target.iterdir()}
    assert {
        "policy.safetensors",
        "model.zip",
        "vecnormalize.pkl",
        "policy.json",
        "config.yaml",
        "evaluations.npz",
    } <= kept
    with zipfile.ZipFile(target / "model.zip") as file:
        assert b"OS:" not in file.read("system_info.txt")  # where it was trained is nobody's business
    act, description = load_policy(target)
    assert act(np.zeros((2, *description["observation"]["shape"]), np.float32)).shape == (2, 1)
    before = (tmp_path / "runs" / "seed3" / "run.json").read_text()
    learning.train((*STUDY, "video.seconds=0"), 3, tmp_path / "runs", tmp_path / "again")
    assert (tmp_path / "runs" / "seed3" / "run.json").read_text() == before


def test_a_policy_of_another_config_is_not_taken_for_this_one(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(learning.asked(STUDY).as_dict() | {"seed": 7}))
    learning.same_config(tmp_path, STUDY)
    with pytest.raises(SealegsError, match="was trained with total_timesteps: 64"):
        learning.same_config(tmp_path, (*STUDY, "total_timesteps=128"))


SEEDS = {"arm": 2, "leg": 1}
"""Learned policies that are kept of a robot, where they are not five."""


@pytest.mark.long
def test_kept_policies_are_those_of_the_tuned_settings() -> None:
    for robot, learned in learning.LEARNED.items():
        folders = sorted((CHECKOUT / "policies" / robot).glob("seed*"))
        assert len(folders) == SEEDS.get(robot, 5)
        for folder in folders:
            learning.same_config(folder, learned.training)


def test_tuned_settings_belong_to_an_environment_and_an_algorithm() -> None:
    for path in (CHECKOUT / "configs" / "tuned").glob("*.yaml"):
        env, _, agent = path.stem.rpartition("_")
        assert env in choices("env") and agent in choices("agent")
        wanted = yaml.safe_load(path.read_text())["total_timesteps"]
        assert learning.asked([f"env={env}", f"agent={agent}"]).total_timesteps == wanted


def test_a_study_without_policies_says_so(tmp_path: Path) -> None:
    with pytest.raises(SealegsError, match="has no policy yet"):
        learning.study("hexapod", 5, None, False, tmp_path, tmp_path)
