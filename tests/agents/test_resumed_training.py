"""Training runs that end early: what survives a kill, a Ctrl-C and a full disk, and how a run goes on."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from safetensors.torch import load_file
from sealegs.agents.config import TrainConfig, read_config, train_config
from sealegs.agents.training import new_learner
from sealegs.common.errors import SealegsError
from sealegs.envs.any_robot.track import TrackTask
from sealegs.envs.engine.sb3 import BatchVecEnv
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.running_mean_std import RunningMeanStd

from tests.agents.training_runs import REPOSITORY, SHORT, SMALL, events, killed, run, start, steps, wait_for

SMALL_SAC = [
    *(argument for argument in SMALL if not argument.startswith(("agent.n_steps", "agent.n_epochs"))),
    *("agent=sac", "agent.learning_starts=64", "agent.buffer_size=2000"),
]


@pytest.mark.long
def test_a_run_that_is_killed_before_its_last_evaluation_makes_it_on_resume(tmp_path: Path) -> None:
    """The checkpoint's own evaluation at that step is of the policy before the update."""
    folder = killed(tmp_path / "late")
    at = steps(folder)[-1]
    assert run(f"resume={folder}", f"total_timesteps={at}") == 0
    state = json.loads((folder / "checkpoints" / f"{at:012d}" / "state.json").read_text())["evaluations"]
    assert state["timesteps"] == list(range(256, at + 1, 256))
    assert state["updates"] == PPO.load(folder / "final" / "model.zip")._n_updates


@pytest.mark.long
def test_a_killed_run_resumes_from_its_newest_complete_checkpoint(tmp_path: Path) -> None:
    folder = killed(tmp_path / "killed")
    killed_at = steps(folder)[-1]
    torn = folder / "checkpoints" / ".writing-000000999999"  # what a kill within a checkpoint leaves
    torn.mkdir()
    (torn / "policy.safetensors").write_bytes(b"torn")
    total = killed_at + 512
    assert run(f"resume={folder}", f"total_timesteps={total}") == 0
    assert steps(folder)[-1] == total and not torn.exists()
    sessions = json.loads((folder / "run.json").read_text())["sessions"]
    assert [session["from_step"] for session in sessions] == [0, killed_at]
    logged = [event.step for event in events(folder).Scalars("time/fps")]
    assert logged == list(range(128, total + 1, 128)), "TensorBoard shows one run without gaps or repeats"


@pytest.mark.long
def test_ctrl_c_saves_a_checkpoint_and_says_how_to_go_on(tmp_path: Path) -> None:
    folder = tmp_path / "stopped"
    process = start(*SMALL, f"out={tmp_path}", "name=stopped", "total_timesteps=1000000", "checkpoint.every=1000000")
    wait_for(folder, "evaluations.npz", process)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130 and "Traceback" not in stderr
    assert stderr.strip().splitlines()[-1].endswith(f"with: sealegs train resume={folder}")
    assert len(steps(folder)) == 1


@pytest.mark.long
def test_a_damaged_checkpoint_gives_way_to_the_one_before(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "damaged"
    assert run(*SMALL, f"out={tmp_path}", "name=damaged", "total_timesteps=512") == 0
    (folder / "checkpoints" / "000000000512" / "policy.safetensors").write_bytes(b"torn")
    assert run(f"resume={folder}", "total_timesteps=640") == 0
    assert "000000000512 cannot be read" in capsys.readouterr().err
    assert json.loads((folder / "run.json").read_text())["sessions"][-1]["from_step"] == 256


@pytest.mark.long
def test_a_full_disk_ends_in_one_sentence_and_keeps_the_checkpoints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from sealegs.agents import checkpoint

    save = checkpoint.save_policy

    def full(folder: Path, model: PPO, description: dict) -> None:
        if model.num_timesteps > 256:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(folder))
        save(folder, model, description)

    monkeypatch.setattr(checkpoint, "save_policy", full)
    assert run(*SMALL, f"out={tmp_path}", "name=full", "total_timesteps=1024") == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert "is full" in error and "step 256 is complete" in error
    assert steps(tmp_path / "full") == [256]


@pytest.mark.long
def test_ctrl_c_in_the_final_evaluation_costs_none_of_the_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "late"
    with monkeypatch.context() as patch:
        patch.setattr("sealegs.agents.training.Evaluation.evaluate", lambda *_: os.kill(os.getpid(), signal.SIGINT))
        assert run(*SMALL, f"out={tmp_path}", "name=late", "total_timesteps=384") == 130
    error = capsys.readouterr().err.strip()
    assert "checkpoint at step 384" in error and "Traceback" not in error
    assert not (folder / "final").exists()
    assert run(f"resume={folder}") == 0
    assert json.loads((folder / "final" / "policy.json").read_text())["step"] == 384
    assert list(np.load(folder / "evaluations.npz")["timesteps"]) == [256, 384]
    assert run(f"resume={folder}") == 2, "nothing is left to do"


@pytest.mark.long
def test_a_disk_that_is_full_at_the_final_policy_is_made_up_for_by_a_resume(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from sealegs.agents import training

    save, folder = training.save_policy, tmp_path / "full"

    def full(target: Path, *arguments: Any) -> None:
        if "final" in target.name:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(target))
        save(target, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(training, "save_policy", full)
        assert run(*SMALL, f"out={tmp_path}", "name=full", "total_timesteps=256") == 2
    assert "step 256 is complete" in capsys.readouterr().err
    assert run(f"resume={folder}") == 0
    assert json.loads((folder / "final" / "policy.json").read_text())["step"] == 256


@pytest.mark.long
def test_a_film_that_is_missing_is_made_by_a_resume(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def film(file: Path, *_: object) -> None:
        file.write_bytes(b"film")

    monkeypatch.setattr("sealegs.agents.training.record_video", film)
    monkeypatch.setattr("sealegs.agents.training.make_single_env", lambda *_: SimpleNamespace(close=lambda: None))
    folder = tmp_path / "film"
    assert run(*SMALL, f"out={tmp_path}", "name=film", "total_timesteps=128") == 0
    assert run(f"resume={folder}", "video.seconds=1") == 0
    assert (folder / "video.mp4").read_bytes() == b"film"
    assert run(f"resume={folder}") == 2, "nothing is left to do"
    os.utime(folder / "video.mp4", (0, 0))  # as if the policy had been trained on since
    assert run(f"resume={folder}") == 0


@pytest.mark.long
def test_a_damaged_history_is_set_aside_and_the_run_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "history"
    assert run(*SMALL, f"out={tmp_path}", "name=history", "total_timesteps=128") == 0
    for number, damaged in enumerate(('{"sessions": [', "[1]"), 1):
        (folder / "run.json").write_text(damaged)
        assert run(f"resume={folder}", f"total_timesteps={128 + 128 * number}") == 0
        assert f"kept as run.damaged-{number}.json" in capsys.readouterr().err
        assert (folder / f"run.damaged-{number}.json").read_text() == damaged
    assert len(json.loads((folder / "run.json").read_text())["sessions"]) == 1


@pytest.mark.long
def test_a_best_policy_saved_after_the_last_checkpoint_stays(tmp_path: Path) -> None:
    folder = tmp_path / "best"
    assert run(*SMALL, f"out={tmp_path}", "name=best", "total_timesteps=256") == 0
    description = json.loads((folder / "best" / "policy.json").read_text())
    saved = json.dumps(description | {"mean_reward": 1e9})  # by a session that was killed
    (folder / "best" / "policy.json").write_text(saved)
    assert run(f"resume={folder}", "total_timesteps=512") == 0
    assert (folder / "best" / "policy.json").read_text() == saved


def test_two_processes_cannot_train_in_one_folder(finished: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from sealegs.agents.run_folder import RunFolder

    held = RunFolder.open(finished)
    assert run(f"resume={finished}", "total_timesteps=4096") == 2
    assert "Another process" in capsys.readouterr().err
    held.close()


def test_rewards_that_are_normalised_without_observations_resume_with_their_normaliser(tmp_path: Path) -> None:
    small = [argument for argument in SMALL if not argument.startswith("evaluate.every")]
    ran = [*small, "evaluate.every=0", "agent.normalize.norm_obs=false", f"out={tmp_path}", "name=run"]
    assert run(*ran, "total_timesteps=128") == 0
    kept = load_file(tmp_path / "run" / "checkpoints" / f"{128:012d}" / "learner.safetensors")
    assert {name for name in kept if name.startswith("normalizer")} == {
        f"normalizer.return.{key}" for key in ("mean", "var", "count")
    }
    assert run(f"resume={tmp_path / 'run'}", "total_timesteps=256") == 0


@pytest.mark.long
def test_sac_resumes_with_its_replay_buffer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "sac"
    assert run(*SMALL_SAC, "total_timesteps=768", f"out={tmp_path}", "name=sac") == 0
    buffers = sorted(int(path.parent.name) for path in folder.glob("checkpoints/*/replay_buffer.safetensors"))
    assert len(steps(folder)) > 2 and buffers == steps(folder)[-2:], "the newest two checkpoints keep the buffer"
    assert run(f"resume={folder}", "total_timesteps=832") == 0
    assert "buffer" not in capsys.readouterr().err
    assert "train/actor_loss" in events(folder).Tags()["scalars"]


@pytest.mark.long
def test_sac_goes_back_to_older_checkpoints_with_and_without_their_buffer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "sac"
    assert run(*SMALL_SAC, "total_timesteps=768", f"out={tmp_path}", "name=sac") == 0
    oldest, before, newest = (folder / "checkpoints" / f"{step:012d}" for step in steps(folder)[-3:])
    weights = newest / "policy.safetensors"
    weights.write_bytes(weights.read_bytes()[:1000])
    shutil.copytree(folder, tmp_path / "again")
    assert run(f"resume={folder}", "total_timesteps=640") == 0
    errors = capsys.readouterr().err
    assert f"{newest.name} cannot be read" in errors and "no replay buffer" not in errors
    assert (before / "replay_buffer.safetensors").is_file(), "stands by, whatever lies damaged ahead"
    again = tmp_path / "again" / "checkpoints"
    (again / before.name / "replay_buffer.safetensors").write_bytes(b"torn")
    assert run(f"resume={tmp_path / 'again'}", "total_timesteps=640") == 0
    assert f"{oldest.name} has no replay buffer any more" in capsys.readouterr().err
    sessions = json.loads((tmp_path / "again" / "run.json").read_text())["sessions"]
    assert sessions[-1]["from_step"] == int(oldest.name)


@pytest.mark.long
def test_a_chain_given_by_path_stays_with_the_run(tmp_path: Path) -> None:
    chain = tmp_path / "extended.yaml"
    chain.write_text((REPOSITORY / "configs" / "actuator" / "ideal.yaml").read_text())
    assert run(*SMALL, f"actuator={chain}", f"out={tmp_path}", "name=own", "total_timesteps=256") == 0
    chain.unlink()
    assert run(f"resume={tmp_path / 'own'}", "total_timesteps=384") == 0


def test_a_resumed_run_refuses_another_experiment(finished: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(f"resume={finished}", "seed=3") == 2
    assert "keeps its config" in capsys.readouterr().err


# --- A new run that begins with what another one learnt: which numbers it takes, which model it has, what is refused.

TRACK = ["env=track", "robot=bench", *(word for word in SHORT if word != "env=bench")]


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run of the task track, whose lead is measured on its model."""
    out = tmp_path_factory.mktemp("runs")
    assert run(*TRACK, f"out={out}", "name=first", "seed=3") == 0
    return out / "first"


def begun(*arguments: str) -> tuple[TrainConfig, BaseAlgorithm, BatchVecEnv]:
    config = read_config(list(arguments)).config
    assert config is not None
    return config, *new_learner(config, config.actuator)


def lead_of(env: BatchVecEnv) -> float:
    task = env.engine.task
    assert isinstance(task, TrackTask) and task.lead is not None
    return task.lead


@pytest.mark.parametrize("part", ["", "best", "final"])
def test_a_run_begins_with_weights_and_normaliser_of_another(first: Path, part: str) -> None:
    config, model, _ = begun(f"from={first / part}")
    assert config.env["id"] == "SeaLegs/Track-v1" and config.agent["n_steps"] == 32, "task and config are that run's"
    kept = load_file(first / (part or "final") / "policy.safetensors")
    own = model.policy.state_dict()
    assert all(np.array_equal(value, kept[name]) for name, value in own.items() if name != "log_std")
    assert own["log_std"].unique().tolist() == [config.agent["policy_kwargs"]["log_std_init"]], "it explores anew"
    described = json.loads((first / (part or "final") / "policy.json").read_text())["observation"]
    normalizer = model.get_vec_normalize_env()
    assert normalizer is not None and isinstance(normalizer.obs_rms, RunningMeanStd)
    assert normalizer.obs_rms.mean.tolist() == described["mean"]
    assert normalizer.obs_rms.var.tolist() == described["variance"]
    assert model.num_timesteps == 0, "its steps count anew"


def test_another_model_is_given_its_own_lead(first: Path, tmp_path: Path) -> None:
    chain = yaml.safe_load((first / "actuators.yaml").read_text())["joint"]
    late = [{"delay": {"seconds": 0.06}}, *(stage for stage in chain if "delay" not in stage)]
    (tmp_path / "late.yaml").write_text(yaml.safe_dump(late))
    lead = yaml.safe_load((first / "config.yaml").read_text())["env"]["lead"]
    _, _, same = begun(f"from={first}")
    _, _, other = begun(f"from={first}", f"actuator={tmp_path / 'late.yaml'}")
    assert lead_of(same) == pytest.approx(lead, abs=1e-3)
    assert lead_of(other) > lead + 0.03
    _, _, asked = begun(f"from={first}", f"actuator={tmp_path / 'late.yaml'}", "env.lead=0.01")
    assert lead_of(asked) == 0.01


def test_what_followed_from_the_size_of_a_robot_does_so_again(tmp_path: Path) -> None:
    """A walking run that began with another was refused: its cadence was that of no gait."""
    walking = read_config(["env=walk"]).config
    assert walking is not None
    env = walking.env | {"cadence": 2.5, "lift": 0.02}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump({**walking.as_dict(), "env": env, "measured": ["cadence"]}))
    config = read_config([f"from={tmp_path}"]).config
    assert config is not None and config.env["cadence"] is None and config.env["lift"] == 0.02


def test_a_run_that_began_from_another_says_so_and_is_a_run_as_any(first: Path) -> None:
    out = first.parent
    assert run(f"from={first}", f"out={out}", "name=second", "total_timesteps=64") == 0
    config = yaml.safe_load((out / "second" / "config.yaml").read_text())
    assert config["begun_from"] == str(first) and config["total_timesteps"] == 64 and config["seed"] == 0
    assert run(f"resume={out / 'second'}", "total_timesteps=128") == 0
    assert json.loads((out / "second" / "final" / "policy.json").read_text())["step"] == 128


def test_each_of_several_seeds_begins_with_the_other_run(first: Path) -> None:
    config = read_config([f"from={first}", "seeds=2"]).config
    assert config is not None
    stored = config.as_dict() | {"seed": 1}  # as the folder of a further seed has it
    config = train_config(stored)
    model, _ = new_learner(config, config.actuator)
    kept = load_file(first / "final" / "policy.safetensors")
    assert np.array_equal(model.policy.state_dict()["action_net.bias"], kept["action_net.bias"])


def test_what_does_not_fit_is_refused_in_a_sentence(first: Path, tmp_path: Path) -> None:
    with pytest.raises(SealegsError, match="holds no config"):
        begun(f"from={tmp_path}")
    with pytest.raises(SealegsError, match="leave agent= out"):
        begun(f"from={first}", "agent=sac")
    with pytest.raises(SealegsError, match="no task of your own"):
        begun(f"from={first}", "env=hopper")
    with pytest.raises(SealegsError, match="from cannot be given with resume"):
        begun(f"from={first}", f"resume={first}")
    with pytest.raises(SealegsError, match="does not fit"):
        begun(f"from={first}", "agent.policy_kwargs.net_arch=[9]")
    other = shutil.copytree(first / "final", tmp_path / "other")
    shutil.copy(first / "config.yaml", other)
    description = json.loads((other / "policy.json").read_text())
    description["observation_names"][0] = "something else"
    (other / "policy.json").write_text(json.dumps(description))
    with pytest.raises(SealegsError, match="a policy of another task"):
        begun(f"from={other}")
