"""The study of learned robots keeps what was trained, and says what came out."""

from __future__ import annotations

import importlib
import zipfile
from pathlib import Path

import numpy as np
import pytest
import yaml
from sealegs.agents.policy_files import load_policy
from sealegs.agents.seeds import read_curve
from sealegs.common.errors import SealegsError
from sealegs.configs.compose import choices

from benchmarks import learning
from benchmarks.learning import Bar, interval, page

SMALL = ("env=bench", "total_timesteps=64", "n_envs=2", "agent.n_steps=16", "agent.batch_size=16", "evaluate.every=32")


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
    text = page("hexapod", ("env=hexapod",), rows, {"speed": 2.5}, [Bar("at least 2", "1 to 3", False)])
    assert "| **no** | 1 to 3 | at least 2 |" in text
    assert "| reference controller | 2.5 |" in text
    assert "2 ± 13" in text


@pytest.mark.long
def test_a_seed_is_trained_once_and_its_policy_kept(tmp_path: Path) -> None:
    target = tmp_path / "policies" / "seed3"
    learning.train((*SMALL, "video.seconds=0"), 3, tmp_path / "runs", target)
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
    learning.train((*SMALL, "video.seconds=0"), 3, tmp_path / "runs", tmp_path / "again")
    assert (tmp_path / "runs" / "seed3" / "run.json").read_text() == before


def test_a_policy_of_another_config_is_not_taken_for_this_one(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(learning.asked(SMALL).as_dict() | {"seed": 7}))
    learning.same_config(tmp_path, SMALL)
    with pytest.raises(SealegsError, match="was trained with total_timesteps: 64"):
        learning.same_config(tmp_path, (*SMALL, "total_timesteps=128"))


SEEDS = {"arm": 2, "leg": 1}
"""Learned policies that are kept of a robot, where they are not five."""


@pytest.mark.long
def test_kept_policies_are_those_of_the_tuned_settings() -> None:
    for robot in learning.ROBOTS:
        training = importlib.import_module(f"benchmarks.learned_{robot}").TRAINING
        folders = sorted((learning.REPOSITORY / "policies" / robot).glob("seed*"))
        assert len(folders) == SEEDS.get(robot, 5)
        for folder in folders:
            learning.same_config(folder, training)


def test_tuned_settings_belong_to_an_environment_and_an_algorithm() -> None:
    for path in (learning.REPOSITORY / "configs" / "tuned").glob("*.yaml"):
        env, _, agent = path.stem.rpartition("_")
        assert env in choices("env") and agent in choices("agent")
        wanted = yaml.safe_load(path.read_text())["total_timesteps"]
        assert learning.asked([f"env={env}", f"agent={agent}"]).total_timesteps == wanted


def test_a_study_without_policies_says_so(tmp_path: Path) -> None:
    with pytest.raises(SealegsError, match="has no policy yet"):
        learning.study("hexapod", 5, None, False, tmp_path, tmp_path)
