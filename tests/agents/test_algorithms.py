"""Algorithms by name, files of rl-baselines3-zoo, callbacks, wrappers and earlier observations from the config."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from sealegs.agents import algorithms
from sealegs.agents.config import expression, read_config
from sealegs.agents.policy_files import mean_reward
from sealegs.commands import train
from sealegs.common.errors import SealegsError
from sealegs.configs.compose import choices
from sealegs.configs.script import run as run_script
from sealegs.envs.engine.sb3 import BatchVecEnv
from sealegs.hw.run.policy import Policy

from tests.quick import quick

SMALL = ["env=bench", "n_envs=2", "total_timesteps=128", "evaluate.every=0", "evaluate.episodes=2", "video.seconds=0"]
ON_POLICY = ["agent.n_steps=32", "checkpoint.every=64"]
OFF_POLICY = ["agent.learning_starts=32", "agent.buffer_size=200", "agent.batch_size=16", "checkpoint.every=64"]
OPTIONS = {
    "a2c": ON_POLICY,
    "ppo": [*ON_POLICY, "agent.batch_size=32"],
    "trpo": [*ON_POLICY, "agent.batch_size=32"],
    "recurrent_ppo": [*ON_POLICY, "agent.batch_size=32", "agent.policy_kwargs.lstm_hidden_size=8"],
    "ars": ["agent.n_delta=2", "agent.n_top=1", "env.control_rate=10"],
    **dict.fromkeys(("crossq", "ddpg", "sac", "td3", "tqc"), OFF_POLICY),
    "sbx_ppo": [*ON_POLICY, "agent.batch_size=32"],
    **dict.fromkeys(("sbx_ddpg", "sbx_sac", "sbx_td3", "sbx_tqc"), OFF_POLICY),
}
ZOO = """
defaults: &usual
  n_envs: 4
  n_timesteps: !!float 2e6
  normalize: "dict(norm_obs=True, norm_reward=False)"
  policy: 'MlpPolicy'
  learning_rate: lin_3e-4

Pendulum-v1:
  <<: *usual
  n_steps: 512
  policy_kwargs: "dict(log_std_init=-2, ortho_init=False, activation_fn=nn.ReLU, net_arch=dict(pi=[64, 64], vf=[64]))"

SeaLegs/Bench-v0:
  <<: *usual
  frame_stack: 3
  callback:
    - stable_baselines3.common.callbacks.StopTrainingOnMaxEpisodes:
        max_episodes: 50
"""


def run(*arguments: str) -> int:
    """Exit status of train.py in this process."""
    return run_script(train.main, "train", "", list(arguments))


def config(*arguments: str) -> Any:
    """The config that arguments of train.py make."""
    return read_config(arguments).config


@pytest.fixture
def zoo(tmp_path: Path) -> Path:
    (tmp_path / "zoo.yml").write_text(ZOO)
    return tmp_path / "zoo.yml"


def test_each_algorithm_has_a_config_and_the_rest_are_told_why_not(capsys: pytest.CaptureFixture[str]) -> None:
    assert sorted(algorithms.ALGORITHMS) == choices("agent") == sorted(OPTIONS)
    assert run(*SMALL, "agent.algorithm=dqn") == 2 and "discrete actions" in capsys.readouterr().err
    assert run(*SMALL, "agent.algorithm=tqk") == 2 and "did you mean 'tqc'" in capsys.readouterr().err


@pytest.mark.parametrize("name", quick(sorted(OPTIONS), 4))
def test_an_algorithm_learns_goes_on_and_acts_from_its_files(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if name.startswith("sbx"):
        pytest.importorskip("sbx")
    assert run(*SMALL, f"agent={name}", *OPTIONS[name], f"out={tmp_path}", "name=first") == 0
    assert "No policy.onnx" not in capsys.readouterr().err
    final = tmp_path / "first" / "final"
    contract = Policy(final).contract
    assert contract.robot == "bench" and (contract.policy_memory > 0) == (name == "recurrent_ppo")
    (final / "model.zip").unlink(missing_ok=name.startswith("sbx"))
    assert np.isfinite(mean_reward(final, "sts3215", episodes=1))
    longer = json.loads((final / "policy.json").read_text())["step"] + 128
    assert run(f"resume={tmp_path / 'first'}", f"total_timesteps={longer}") == 0
    assert json.loads((final / "policy.json").read_text())["step"] >= longer
    assert "cannot be read" not in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.parametrize("name", ["PPO", "TQC"])
def test_a_learner_of_jax_goes_on_with_the_numbers_that_it_had(name: str, tmp_path: Path) -> None:
    sbx = pytest.importorskip("sbx")
    from sealegs.agents.weights import restore, states, twin

    def learner(seed: int) -> Any:
        env = BatchVecEnv("SeaLegs/Bench-v0", 2, seed=0)
        short = {"n_steps": 16} if name == "PPO" else {"learning_starts": 8, "buffer_size": 100}
        return getattr(sbx, name)("MlpPolicy", env, seed=seed, batch_size=8, policy_kwargs={"net_arch": [8]}, **short)

    first, second = learner(0), learner(1)
    first.learn(32)
    kept, seen = states(first), np.random.default_rng(0).normal(size=(16, 6)).astype(np.float32)
    assert restore(second, {**kept, "normalizer.x": kept[next(iter(kept))]}, tmp_path).keys() == {"normalizer.x"}
    assert all(bool((value == kept[key]).all()) for key, value in states(second).items())
    wanted = first.predict(seen, deterministic=True)[0]
    assert second.predict(seen, deterministic=True)[0] == pytest.approx(wanted, abs=1e-6)
    assert twin(first).predict(seen, deterministic=True)[0] == pytest.approx(wanted, abs=1e-5)
    second.learn(32)


def test_an_algorithm_whose_package_is_missing_names_the_extra(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "sb3_contrib", None)
    assert run(*SMALL, "agent=tqc") == 2
    assert (
        "agent.algorithm=tqc needs the package sb3_contrib: pip install 'sealegs[contrib]'" in capsys.readouterr().err
    )


def test_an_entry_of_the_zoo_is_the_config_of_a_run(zoo: Path) -> None:
    found = config("env=bench", f"hyperparams={zoo}")
    assert (found.n_envs, found.total_timesteps) == (4, 2_000_000)
    assert found.agent["algorithm"] == "ppo" and found.agent["learning_rate"] == "lin_3e-4"
    assert found.agent["history"] == 3 and found.agent["normalize"] == {"norm_obs": True, "norm_reward": False}
    assert "batch_size" not in found.agent, "what the file does not say is the algorithm's default"
    other = config("env=bench", f"hyperparams={zoo}:Pendulum-v1", "n_envs=2", "agent.n_steps=64")
    assert (other.n_envs, other.agent["n_steps"]) == (2, 64), "the command line counts more than the file"
    wanted = {
        "log_std_init": -2,
        "ortho_init": False,
        "activation_fn": "relu",
        "net_arch": {"pi": [64, 64], "vf": [64]},
    }
    assert other.agent["policy_kwargs"] == wanted


def test_a_file_without_the_entry_names_those_that_it_has(zoo: Path) -> None:
    with pytest.raises(SealegsError, match=r"zoo\.yml:<entry>, one of defaults, Pendulum-v1, SeaLegs/Bench-v0"):
        config("env=hopper", f"hyperparams={zoo}")


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "dict(a=open('x'))",
        "(lambda: 1)()",
        "[x for x in (1,)]",
        "dict(**{'a': 1})",
        "nn.Module.forward",
        "1 +",
        "(" * 500,
    ],
)
def test_text_that_is_no_literal_is_refused_and_not_run(text: str) -> None:
    with pytest.raises(SealegsError, match="which is not read"):
        expression(text, "ppo.yml:x: policy_kwargs")


def test_earlier_observations_and_a_callback_of_the_config_reach_run_and_file(
    zoo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stop = "agent.callbacks=[{stable_baselines3.common.callbacks.StopTrainingOnMaxEpisodes: {max_episodes: 1}}]"
    quick_run = [*ON_POLICY, "agent.batch_size=32", "agent.policy_kwargs.net_arch=[8]"]
    wrapped = "agent.wrappers=[stable_baselines3.common.vec_env.VecCheckNan]"
    assert run(*SMALL, *quick_run, "agent.history=3", wrapped, f"out={tmp_path}", "name=first") == 0
    final = tmp_path / "first" / "final"
    assert Policy(final).contract.history == 3
    assert json.loads((final / "policy.json").read_text())["observation"]["shape"] == [18]
    assert np.isfinite(mean_reward(final, "sts3215", episodes=2))
    assert run(f"resume={tmp_path / 'first'}", "total_timesteps=192") == 0
    short = [*SMALL[:2], "total_timesteps=100000", *SMALL[3:], "env.control_rate=10"]
    capsys.readouterr()
    assert run(*short, *quick_run, stop, f"out={tmp_path}", "name=stops") == 0
    assert json.loads((tmp_path / "stops" / "final" / "policy.json").read_text())["step"] < 2000


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["agent.callbacks=[no.such.Thing]"], "names no.such.Thing, which there is not"),
        (["agent.callbacks=[pathlib.Path]"], "which is no BaseCallback"),
        (["agent.wrappers=[gymnasium.wrappers.TimeAwareObservation]"], "wraps one simulation"),
        (["agent.callbacks=[{stable_baselines3.common.callbacks.StopTrainingOnMaxEpisodes: {max: 1}}]"], "refuses its"),
    ],
)
def test_classes_that_are_none_are_one_sentence(
    words: list[str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*SMALL, *words, f"out={tmp_path}") == 2
    said = capsys.readouterr().err
    assert sentence in said and said.count("\n") == 1


def test_code_that_a_stored_config_names_is_not_loaded_unasked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "hostile_module.py").write_text("open(__file__ + '.ran', 'w')\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    quick_run = [*ON_POLICY, "agent.batch_size=32", "agent.policy_kwargs.net_arch=[8]"]
    assert run(*SMALL, *quick_run, f"out={tmp_path}", "name=first") == 0
    file = tmp_path / "first" / "config.yaml"
    document = yaml.safe_load(file.read_text())
    document["agent"]["callbacks"] = ["hostile_module.Callback"]
    file.write_text(yaml.safe_dump(document))
    assert run(f"resume={tmp_path / 'first'}", "total_timesteps=256") == 2
    assert "names hostile_module.Callback, which is code: give trust=true" in capsys.readouterr().err
    assert not (tmp_path / "hostile_module.py.ran").exists()
