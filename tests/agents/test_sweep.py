"""Sweeps: what is swept, and that one goes on wherever it was stopped."""

from __future__ import annotations

import contextlib
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import pytest
from sealegs.agents import sweep as module
from sealegs.agents import sweep_workers, training
from sealegs.agents.config import read_config
from sealegs.agents.sweep import JOURNAL, TABLE, read_sweep, sweep
from sealegs.agents.sweep_space import as_arguments, combinations, first_values, read_space
from sealegs.agents.sweep_workers import MARK, Result, Trial, attempt, begun, outcome, reward_of, workers_for
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


# --- going on ---------------------------------------------------------------------------------------------------------


Answer = Callable[[Trial], Result]
GRID = ("env=bench", "agent.gamma=0.9,0.95", "workers=1")
TASK = """
from dataclasses import dataclass
from pathlib import Path

from sealegs.envs.any_robot.reach import ReachTask

Path(__file__).with_suffix(".ran").write_text("")


@dataclass(frozen=True)
class Mine(ReachTask):
    episode_steps = 40
"""
ROBOT = f"robot={REPOSITORY}/tests/robots/arm.xml"
CALLBACK = """
from stable_baselines3.common.callbacks import BaseCallback


class Mine(BaseCallback):
    def _on_step(self):
        return True
"""


class Told:
    """Workers that answer at once; ``asked`` has what they were asked to train."""

    size = 1

    def __init__(self, answer: Answer) -> None:
        self._answer = answer
        self.asked: list[Trial] = []

    def submit(self, trial: Trial) -> Future[Result]:
        self.asked.append(trial)
        future: Future[Result] = Future()
        future.set_result(self._answer(trial))
        return future

    def stop(self) -> None:
        pass


Go = Callable[..., tuple[int, list[Trial]]]


@pytest.fixture
def go(monkeypatch: pytest.MonkeyPatch) -> Go:
    """Runs a sweep with an answer to each trial; its exit status, and the trials that were asked for."""

    def run(answer: Answer, *words: str) -> tuple[int, list[Trial]]:
        told = Told(answer)

        @contextlib.contextmanager
        def workers(cluster: str | None, size: int | None) -> Iterator[Told]:
            yield told

        monkeypatch.setattr(module, "workers_for", workers)
        return run_script(command.main, "sweep", "", list(words)), told.asked

    return run


def good(trial: Trial) -> Result:
    return Result(float(trial.number))


def killed(trial: Trial) -> Result:
    raise KeyboardInterrupt


def swept(trials: Sequence[Trial], key: str = "agent.gamma") -> list[str]:
    """The value of a key in each trial."""
    return [word.partition("=")[2] for trial in trials for word in trial.arguments if word.startswith(f"{key}=")]


def test_a_sweep_goes_on_in_a_folder_that_was_moved_or_is_the_current_one(
    go: Go, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("env=bench", "agent.gamma=interval(0.9,0.95)", "trials=2")
    go(lambda trial: good(trial) if trial.number == 0 else killed(trial), *words, f"out={tmp_path}", "name=mine")
    moved = (tmp_path / "mine").rename(tmp_path / "elsewhere")
    (tmp_path / "link").symlink_to(moved)
    monkeypatch.chdir(moved)
    for folder, trials in ((".", 2), ("../link", 3), (str(moved), 4)):
        status, asked = go(good, f"resume={folder}", f"trials={trials}")
        assert status == 0 and [trial.number for trial in asked] == [trials - 1] and asked[0].sweep == moved
    assert "# elsewhere: 4 of 4 trials" in (moved / TABLE).read_text()


def test_a_failed_trial_is_tried_again_where_the_sweep_goes_on(
    go: Go, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert go(lambda _: Result(error="The disk is full."), *GRID, f"out={tmp_path}", "name=mine")[0] == 2
    folder = tmp_path / "mine"
    assert "failed: trial1.log" in (folder / TABLE).read_text() and "disk" in (folder / "trial1.log").read_text()
    said = capsys.readouterr().err
    assert "2 of 2 trials failed" in said and said.endswith(f"sealegs sweep resume={folder}\n")
    status, asked = go(good, f"resume={folder}")
    assert status == 0 and swept(asked) == ["0.9", "0.95"]
    assert "2 of 2 trials" in (folder / TABLE).read_text()


def test_no_combination_is_trained_twice_however_many_trials_are_asked_for(
    go: Go, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("env=bench", "agent.gamma=0.9,0.95,0.9", f"out={tmp_path}", "name=mine")
    assert swept(go(good, *words)[1]) == ["0.9", "0.95"]
    assert go(good, f"resume={tmp_path / 'mine'}", "trials=5") == (0, [])
    assert "trials=5: 2 are all combinations." in capsys.readouterr().out
    assert go(good, f"resume={tmp_path / 'mine'}", "trials=1") == (0, [])
    assert "trials=1: 2 are there already." in capsys.readouterr().out


def test_a_trial_that_its_machine_stopped_is_begun_again_but_not_without_end(
    go: Go, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stops = iter([True, False, False])
    status, asked = go(lambda trial: Result(lost="x") if next(stops) else good(trial), *GRID, f"out={tmp_path}")
    assert status == 0 and [trial.number for trial in asked] == [0, 0, 1]
    capsys.readouterr()
    status, asked = go(lambda _: Result(lost="No folder there."), *GRID, f"out={tmp_path}", "name=mine")
    said = capsys.readouterr().err
    assert status == 2 and len(asked) == 3 and "No folder there. Go on with: sealegs sweep" in said
    assert said.count("\n") == 1 and go(good, f"resume={tmp_path / 'mine'}")[0] == 0


def test_a_machine_without_the_folder_of_the_sweep_says_so(tmp_path: Path) -> None:
    result = attempt(Trial(0, (), tmp_path / "none"))
    assert "give out=<a folder that all machines share>" in result.lost and not list(tmp_path.iterdir())


def test_a_line_of_the_journal_that_a_power_failure_cut_off_is_left_out(go: Go, tmp_path: Path) -> None:
    go(lambda trial: good(trial) if trial.number == 0 else killed(trial), *GRID, f"out={tmp_path}", "name=mine")
    with (tmp_path / "mine" / JOURNAL).open("ab") as journal:
        journal.write(b'{"op_code":4,"tri')
    status, asked = go(good, f"resume={tmp_path / 'mine'}")
    assert status == 0 and [trial.number for trial in asked] == [1]


@pytest.mark.parametrize("lines", (2, 5, 6, 7))
def test_wherever_a_sweep_is_killed_each_combination_is_trained_once(go: Go, tmp_path: Path, lines: int) -> None:
    go(killed, "env=bench", "agent.gamma=0.9,0.95", "agent.n_steps=16,32", f"out={tmp_path}", "name=mine")
    journal = tmp_path / "mine" / JOURNAL
    kept = journal.read_bytes().splitlines(keepends=True)
    assert len(kept) > 7
    journal.write_bytes(b"".join(kept[:lines] if lines < 7 else kept[:-1]))
    status, asked = go(good, f"resume={tmp_path / 'mine'}")
    pairs = zip(swept(asked), swept(asked, "agent.n_steps"), strict=True)
    assert status == 0 and sorted(pairs) == [("0.9", "16"), ("0.9", "32"), ("0.95", "16"), ("0.95", "32")]
    assert "4 of 4 trials" in (tmp_path / "mine" / TABLE).read_text()


def test_a_trial_killed_between_its_list_of_seeds_and_its_config_is_begun_anew(tmp_path: Path) -> None:
    (tmp_path / "seeds.yaml").write_text("[0, 1]\n")
    assert not begun(tmp_path)
    (tmp_path / "seed0").mkdir()
    (tmp_path / "seed0" / "config.yaml").write_text("{}\n")
    assert begun(tmp_path)


def test_a_shuffled_list_is_the_same_list_each_time() -> None:
    spaces = [read_space([f"a=shuffle({','.join('abcdefgh')})"])[0] for _ in range(2)]
    assert spaces[0] == spaces[1] and combinations(spaces[0]) == [{"a": letter} for letter in "abcdefgh"]


def test_what_a_trial_did_not_foresee_is_in_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / MARK).write_text("")

    def broken(trial: Trial) -> Result:
        print("before it")
        raise ZeroDivisionError("nobody thought of it")

    monkeypatch.setattr(sweep_workers, "learn", broken)
    with capfd.disabled():
        result = attempt(trial := Trial(0, (), tmp_path))
    log = trial.log.read_text()
    assert "before it" in log and "Traceback" in log and "nobody thought of it" in log
    assert "ZeroDivisionError (nobody thought of it)" in result.error and str(trial.log) in result.error


def test_what_ray_could_not_run_is_told_by_the_last_line_of_its_error(tmp_path: Path) -> None:
    error = type("RayTaskError", (Exception,), {"__module__": "ray.exceptions"})
    future: Future[Result] = Future()
    future.set_exception(error("ray::learn() (pid=1)\n  File ...\nOSError: no disk"))
    assert outcome(future, Trial(0, (), tmp_path)).error.endswith("OSError: no disk")


def _task(folder: Path, name: str = "mine") -> Path:
    folder.mkdir(exist_ok=True)
    file = folder / f"{name}.py"
    file.write_text(TASK)
    return file


def test_own_tasks_are_swept_and_named_again_where_the_sweep_goes_on(
    go: Go, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second = _task(tmp_path / "one", "first"), _task(tmp_path / "one", "second")
    monkeypatch.chdir(first.parent)
    words = ("env=first.py:Mine,second.py:Mine", ROBOT, "agent.n_steps=64", f"out={tmp_path}", "name=mine")
    status, asked = go(killed, *words)
    said = capsys.readouterr().err
    named = f"env={first}:Mine,{second}:Mine"
    assert status == 130 and f"resume={tmp_path / 'mine'} {named}" in said
    assert asked[0].task == f"{first}:Mine" and asked[0].trust
    monkeypatch.chdir(tmp_path)
    status, asked = go(good, *shlex.split(said.partition("sealegs sweep ")[2]))
    assert status == 0 and [trial.task for trial in asked] == [f"{first}:Mine", f"{second}:Mine"]
    read_config(asked[0].arguments)


def test_no_file_is_run_because_the_folder_of_a_sweep_names_it(
    go: Go, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = _task(tmp_path / "theirs")
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "sweep.yaml").write_text(
        f"arguments: ['env={file}:Mine', '{ROBOT}', 'agent.gamma=0.9,0.95']\ntrials: null\n"
    )
    status, asked = go(good, f"resume={folder}")
    said = capsys.readouterr().err
    assert status == 2 and not asked and not file.with_suffix(".ran").exists()
    assert f"give 'env={file}:Mine'" in said or f"give env={file}:Mine" in said
    here = _task(tmp_path / "here")
    status, asked = go(good, f"resume={folder}", f"env={here}:Mine")
    assert status == 0 and swept(asked, "env") == [f"{here}:Mine"] * 2 and not file.with_suffix(".ran").exists()
    assert go(good, f"resume={folder}", "env=hopper")[0] == 2


def test_a_callback_of_another_package_is_named_again_by_trust(
    go: Go, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "theirs_of_sweep.py").write_text(CALLBACK)
    monkeypatch.syspath_prepend(tmp_path)
    folder = tmp_path / "mine"
    status, asked = go(killed, *GRID, "agent.callbacks=[theirs_of_sweep.Mine]", f"out={tmp_path}", "name=mine")
    assert status == 130 and asked[0].trust and f"resume={folder} trust=true" in capsys.readouterr().err
    assert go(good, f"resume={folder}") == (2, [])
    assert "theirs_of_sweep.Mine, which is code: give trust=true" in capsys.readouterr().err
    status, asked = go(good, f"resume={folder}", "trust=true")
    assert status == 0 and all(trial.trust for trial in asked)


def test_paths_of_a_sweep_mean_the_same_files_from_any_folder(
    go: Go, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("one.yaml", "it's two.yaml"):
        shutil.copy(Path(module.__file__).parents[1] / "configs" / "actuator" / "sts3215.yaml", tmp_path / name)
    monkeypatch.chdir(tmp_path)
    assert go(killed, "env=bench", """actuator=one.yaml,"it's two.yaml",ideal""", "name=mine", "out=.")[0] == 130
    monkeypatch.chdir("/")
    _, asked = go(good, f"resume={tmp_path / 'mine'}")
    assert swept(asked, "actuator") == [f"{tmp_path}/one.yaml", f"{tmp_path}/it's two.yaml", "ideal"]
    for trial in asked:
        read_config(trial.arguments)


@pytest.mark.long
def test_a_trial_of_seeds_with_code_of_ones_own_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    task = f"{_task(tmp_path / 'one')}:Mine"
    (tmp_path / "own_of_sweep.py").write_text(CALLBACK)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / MARK).write_text("")
    words = (*SMALL[1:], "total_timesteps=256", "seed=[0,1]", "agent.callbacks=[own_of_sweep.Mine]")
    training.train(read_config((*words, f"env={task}", ROBOT, f"out={tmp_path}", "name=trial0")))
    trial = Trial(0, (), tmp_path, task, trust=True)
    (trial.folder / "seeds.json").unlink()
    shutil.rmtree(trial.folder / "seed1")
    with workers_for(None, 1) as workers:  # a process that was told of no code
        result = workers.submit(trial).result()
    assert result == Result(reward_of(trial.folder)) and result.reward is not None
