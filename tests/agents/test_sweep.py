"""Sweeps: what is read as one, what becomes of trials that fail, are killed or are finished, and what is told."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("optuna", reason="the extra sweep is not installed")
from sealegs.agents.sweep import read_sweep, sweep
from sealegs.agents.sweep_space import as_arguments, combinations, first_values, read_space
from sealegs.agents.sweep_workers import reward_of
from sealegs.commands import sweep as command
from sealegs.configs.script import run as run_script

from tests.agents.training_runs import REPOSITORY, SMALL
from tests.agents.training_runs import run as train
from tests.waiting import wait_until

SHORT = [*SMALL, "total_timesteps=512", "evaluate.every=0"]


def run(*arguments: str) -> int:
    """Exit status of ``sealegs sweep`` in this process."""
    return run_script(command.main, "sweep", "", list(arguments))


@pytest.mark.parametrize(
    ("argument", "values"),
    [
        ("agent.n_steps=16,32", ["16", "32"]),
        ("agent.policy_kwargs.net_arch=[8],[8,8]", ["[8]", "[8,8]"]),
        ("agent.learning_rate=choice(lin_1e-3,lin_1e-4)", ["lin_1e-3", "lin_1e-4"]),
        ("n_envs=range(1,4)", [1, 2, 3]),
        ("agent.gamma=range(0.8,1.0,0.1)", [0.8, 0.9]),
    ],
)
def test_lists_and_ranges_of_hydra_are_swept_value_by_value(argument: str, values: list[Any]) -> None:
    space, fixed = read_space(["env=bench", argument])
    each = combinations(space)
    assert fixed == ["env=bench"] and each is not None
    assert [row[argument.partition("=")[0]] for row in each] == pytest.approx(values) or each == values


def test_an_interval_has_no_end_of_combinations_and_may_be_logarithmic() -> None:
    space, _ = read_space(["a=tag(log,interval(1e-4,1e-2))", "b=int(interval(2,9))", "c=1,2"])
    assert combinations(space) is None
    assert as_arguments(first_values(space)) == ["a=0.0001", "b=2", "c=1"]
    assert "log=True" in str(space["a"]) and str(space["b"]).startswith("IntDistribution")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["env=bench"], "Nothing is swept"),
        (["env=bench", "agent.gama=0.9,0.95"], "did you mean 'agent.gamma'"),
        (["env=bench", "agent.gamma=interval(0.9,0.8)"], "from low to high"),
        (["env=bench", "agent.gamma=0.9,0.95", "trials=0"], "trials must be at least 1"),
        (["env=bench", "agent.gamma=0.9,0.95", "cluster=slurm"], "give cluster=ray"),
        (["resume=runs/none", "agent.gamma=0.9"], "keeps what it sweeps"),
        (["resume=runs/none"], "resume=runs/none does not exist"),
        (["resume=actuators"], "is not the folder of a sweep"),
        (["resume="], "names no folder"),
        (["resume=runs/none", "name=other"], "name=other cannot be given with resume"),
        (["env=bench", "agent.gamma=interval(0.9,0.99"], "agent.gamma=interval(0.9,0.99 cannot be read"),
        (["env=bench", "agent.gamma=choice()"], "agent.gamma=choice() cannot be read"),
        (["env=bench", "agent.gamma=0.9,0.95", "trial=3"], "did you mean 'trials'"),
        (["env=bench", "agent=ppo,foo"], "agent=foo is not known"),
        (["env=bench", "agent.n_steps=32,abc"], "agent.n_steps takes a whole number"),
        (["env=bench", "agent.n_steps=interval(32,64)"], "int(interval(a,b))"),
    ],
)
def test_a_sweep_that_cannot_be_is_one_sentence(
    words: list[str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*words, *([] if "resume" in words[0] else [f"out={tmp_path}"])) == 2
    said = capsys.readouterr().err
    assert sentence in said and said.count("\n") == 1 and not list(tmp_path.iterdir())


def test_ray_is_named_where_it_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    assert run(*SHORT, "agent.gamma=0.9,0.95", "cluster=ray", f"out={tmp_path}", "name=mine") == 2
    assert "pip install 'sealegs[fleet]'" in capsys.readouterr().err


@pytest.mark.long
def test_each_combination_is_trained_once_and_the_best_comes_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert train("--multirun", *SHORT, "agent.gamma=0.9,0.95", "workers=1", f"out={tmp_path}", "name=mine") == 0
    folder = tmp_path / "mine"
    rows = [line.split(" | ") for line in (folder / "trials.md").read_text().splitlines() if line.startswith("| ")][1:]
    assert {row[2].strip(" |") for row in rows} == {"0.9", "0.95"}
    rewards = [float(row[1]) for row in rows]
    assert rewards == sorted(rewards, reverse=True)
    assert rewards[0] == pytest.approx(reward_of(folder / f"trial{rows[0][0].strip('| ')}"), rel=1e-4)
    assert "Best policy" in capsys.readouterr().out


@pytest.mark.long
def test_a_trial_that_fails_is_told_and_the_others_go_on(tmp_path: Path) -> None:
    assert run(*SHORT, "agent.learning_rate=1e-3,1e30", "workers=1", f"out={tmp_path}", "name=mine") == 2
    table = (tmp_path / "mine" / "trials.md").read_text()
    assert "1 of 2 trials" in table and "failed: trial1.log" in table
    assert (tmp_path / "mine" / "trial1.log").read_text().strip()


@pytest.mark.long
def test_a_killed_sweep_goes_on_and_trains_no_finished_trial_again(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    words = [
        *SMALL,
        "total_timesteps=4096",
        "evaluate.every=0",
        "agent.gamma=interval(0.8,0.99)",
        "trials=3",
        "workers=1",
    ]
    process = subprocess.Popen(
        [sys.executable, "-m", "sealegs", "sweep", *words, f"out={tmp_path}", "name=mine"],
        cwd=REPOSITORY, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    second = folder / "trial1" / "checkpoints"
    wait_until(lambda: any(second.glob("[0-9]*/state.json")), process, lambda: f"no checkpoint in {second}")
    process.kill()
    process.communicate()
    final = folder / "trial0" / "final" / "policy.json"
    before = final.stat().st_mtime_ns
    gammas = (folder / "trial1" / "config.yaml").read_text()
    sweep(read_sweep([f"resume={folder}", "workers=1"]))
    assert "3 of 3 trials" in (folder / "trials.md").read_text()
    assert final.stat().st_mtime_ns == before
    assert (folder / "trial1" / "config.yaml").read_text() == gammas
    assert '"from_step": 0' in (folder / "trial0" / "run.json").read_text()
    sweep(read_sweep([f"resume={folder}", "trials=4", "workers=1"]))
    assert "4 of 4 trials" in (folder / "trials.md").read_text()
