"""Training runs: what a run holds and says, and policies that are watched."""

from __future__ import annotations

import contextlib
import json
import pickle
import re
import shutil
import subprocess
import warnings
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
import pytest
import torch
import yaml
from sealegs.actuators import load_chain
from sealegs.agents import export, run_folder
from sealegs.agents.algorithms import build
from sealegs.agents.make_env import make_single_env, stream_seed
from sealegs.agents.policy_files import mean_reward
from sealegs.agents.training import beside_reference
from sealegs.agents.video import record_video
from sealegs.commands import train, watch
from sealegs.configs.script import run as run_script
from sealegs.envs.engine.sb3 import BatchVecEnv
from sealegs.envs.extended import Change, Extended, Mounted
from sealegs.gap.output.extension import write_extended
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

from tests.agents.training_runs import REPOSITORY, SMALL, contents, events, run, steps


def test_run_folder_holds_what_reproduces_the_run(finished: Path) -> None:
    config = yaml.safe_load((finished / "config.yaml").read_text())
    assert config["agent"]["n_steps"] == 64 and config["total_timesteps"] == 512
    assert yaml.safe_load((finished / "actuators.yaml").read_text())["joint"]
    session = json.loads((finished / "run.json").read_text())["sessions"][0]
    assert session["from_step"] == 0 and "mujoco" in session["packages"] and "command" in session
    git = subprocess.run(["git", "rev-parse", "HEAD"], cwd=REPOSITORY, capture_output=True, text=True)
    assert session["git"]["revision"] == (git.stdout.strip() or None)


def test_run_folder_holds_best_final_and_evaluated_policies(finished: Path) -> None:
    for policy in ("best", "final"):
        names = {path.name for path in (finished / policy).iterdir()}
        assert names == {"policy.safetensors", "policy.json", "policy.onnx", "model.zip", "vecnormalize.pkl"}
    evaluations = np.load(finished / "evaluations.npz")
    assert list(evaluations["timesteps"]) == [256, 512]
    best = json.loads((finished / "best" / "policy.json").read_text())
    assert best["mean_reward"] == pytest.approx(evaluations["results"].mean(axis=1).max())


@pytest.mark.long
def test_the_last_evaluation_is_of_the_final_policy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An update follows the last step, and the evaluation at that step had been of the policy before it."""
    folder = tmp_path / "last"
    quick = [*SMALL, "agent.learning_rate=0.01", f"out={tmp_path}", "name=last", "total_timesteps=256"]
    assert run(*quick) == 0
    said = re.search(r"Mean evaluation reward (\S+)( \(.*\))?\.\n", capsys.readouterr().out)
    best, final = (
        torch.cat([value.flatten() for value in PPO.load(folder / kind / "model.zip").policy.state_dict().values()])
        for kind in ("best", "final")
    )
    assert torch.equal(best, final), "the only evaluation is of the policy at the end"
    evaluations = np.load(folder / "evaluations.npz")
    assert said is not None and float(said[1]) == pytest.approx(evaluations["results"].mean(), rel=1e-3)
    assert [event.step for event in events(folder).Scalars("eval/mean_reward")] == [256]


def test_a_longer_run_says_what_rises_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = [*SMALL, "agent.learning_rate=lin_0.002", f"out={tmp_path}", "name=longer", "total_timesteps=256"]
    assert run(*words) == 0
    assert "rises again" not in capsys.readouterr().out
    assert run(f"resume={tmp_path / 'longer'}", "total_timesteps=512") == 0
    assert "rises again: learning_rate from 0 to 0.001;" in capsys.readouterr().out


def test_a_policy_that_does_not_beat_its_reference_says_so() -> None:
    reference = np.array([4.0, 5.0, 6.0, 7.0])
    better = beside_reference(reference + np.array([1.0, 1.1, 0.9, 1.0]), reference)
    assert better.endswith("; the policy adds 1 (+-0.13, 4 episodes).")
    assert "does NOT beat it (-1)" in beside_reference(reference - 1.0, reference)


def test_a_policy_that_is_better_by_chance_is_not_said_to_do_worse_than_its_reference() -> None:
    reference = np.array([4.0, 5.0, 6.0, 7.0])
    said = beside_reference(reference + np.array([3.0, -2.0, 2.0, -2.0]), reference)
    assert "the policy adds 0.25 (+-4.2, 4 episodes), which may be chance" in said


@pytest.mark.long
def test_a_training_that_corrects_a_reference_compares_both_in_the_same_episodes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [word for word in SMALL if not word.startswith("env=")]
    words += ["env=track", "robot=bench", "agent.learning_rate=0.0", "agent.normalize=false"]
    assert run(*words, f"out={tmp_path}", "name=track", "total_timesteps=512") == 0
    said = capsys.readouterr().out
    assert "Its reference alone (actions of 0) gets " in said
    off = re.findall(r"joints from their targets (\S+) rad", said)
    assert len(off) == 2 and all(0.0 < float(each) < 0.1 for each in off)
    kept = yaml.safe_load((tmp_path / "track" / "config.yaml").read_text())["env"]
    assert kept["id"] == "SeaLegs/Track-v1" and 0.03 < kept["lead"] < 0.07
    results = np.load(tmp_path / "track" / "evaluations.npz")["results"]
    again = BatchVecEnv(kept.pop("id"), 1, robot="bench", **{k: v for k, v in kept.items() if k != "robot"})
    assert len(results) == 2 and (results[0] == results[1]).all(), "the same policy in the same episodes"
    assert again.engine.fitted == {}, "the lead is kept, not measured anew"


def test_policy_json_normalises_like_the_training(finished: Path) -> None:
    description = json.loads((finished / "final" / "policy.json").read_text())
    model = PPO.load(finished / "final" / "model.zip")
    with open(finished / "final" / "vecnormalize.pkl", "rb") as file:
        normalizer: VecNormalize = pickle.load(file)
    observation = np.random.default_rng(0).normal(size=description["observation"]["shape"])
    values = {key: np.asarray(value) for key, value in description["observation"].items()}
    ours = (observation - values["mean"]) / np.sqrt(values["variance"] + values["epsilon"])
    assert np.clip(ours, -values["clip"], values["clip"]) == pytest.approx(
        normalizer.normalize_obs(observation), rel=1e-6
    )
    assert description["action"]["shape"] == list(model.action_space.shape or ())


def test_tensorboard_reads_the_keys_people_look_for(finished: Path) -> None:
    reader = events(finished)
    keys = set(reader.Tags()["scalars"])
    assert {"rollout/ep_rew_mean", "eval/mean_reward", "time/fps", "train/value_loss", "train/learning_rate"} <= keys
    assert [event.step for event in reader.Scalars("eval/mean_reward")] == [256, 512]


def test_short_runs_are_not_met_by_a_librarys_warning(caplog: pytest.LogCaptureFixture) -> None:
    """Stable-Baselines3 spoke of a RolloutBuffer and of keys that no config has."""
    env = BatchVecEnv("SeaLegs/Bench-v0", 2, seed=0)
    agent = {"algorithm": "ppo", "policy": "MlpPolicy", "n_steps": 64}
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        assert getattr(build({**agent, "batch_size": 1024}, env, 0), "batch_size") == 128  # noqa: B009
        assert not caplog.messages, "a minibatch of all that was collected is nothing to tell"
        build({**agent, "batch_size": 100}, env, 0)
    assert len(caplog.messages) == 1 and "agent.batch_size=64 divides them" in caplog.messages[0]


@pytest.mark.long
def test_reward_terms_add_up_to_the_episode_reward(tmp_path: Path) -> None:
    assert run(*SMALL, f"out={tmp_path}", "name=terms", "total_timesteps=640") == 0
    reader = events(tmp_path / "terms")
    last = {key: reader.Scalars(key)[-1] for key in reader.Tags()["scalars"] if key.startswith(("reward/", "rollout/"))}
    terms = [event.value for key, event in last.items() if key.startswith("reward/")]
    assert len(terms) > 1 and sum(terms) == pytest.approx(last["rollout/ep_rew_mean"].value, rel=1e-4)
    assert "actuator/net_out_of_range" in reader.Tags()["scalars"]


@pytest.mark.long
@pytest.mark.rendering
def test_the_trained_policy_is_filmed(tmp_path: Path) -> None:
    small = [argument for argument in SMALL if not argument.startswith("video")]
    film = ["video.seconds=0.4", "video.width=64", "video.height=48"]
    assert run(*small, *film, f"out={tmp_path}", "name=film", "total_timesteps=128") == 0
    pictures = imageio.mimread(tmp_path / "film" / "video.mp4")
    assert len(pictures) == 10 and pictures[0].shape == (48, 64, 3)
    assert any(not np.array_equal(pictures[0], picture) for picture in pictures)


@pytest.mark.long
def test_a_film_that_cannot_be_drawn_fails_no_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*arguments: object) -> None:
        raise RuntimeError("no OpenGL")

    monkeypatch.setattr("sealegs.agents.training.record_video", fail)
    small = [argument for argument in SMALL if not argument.startswith("video")]
    assert run(*small, f"out={tmp_path}", "name=blind", "total_timesteps=128") == 0
    assert capsys.readouterr().err.strip().endswith("No film: no OpenGL.")
    assert not list((tmp_path / "blind").glob("*video*"))


def test_policy_json_says_what_the_numbers_mean(finished: Path) -> None:
    description = json.loads((finished / "final" / "policy.json").read_text())
    assert len(description["observation_names"]) == description["observation"]["shape"][0]
    assert description["action_names"] == ["joint"] and description["control_rate"] == pytest.approx(50.0)
    assert description["goal_per_action"] == pytest.approx([np.pi])
    assert list(description["actuators"]) == ["joint"]


@pytest.mark.long
def test_a_policy_can_be_tried_on_another_actuator(finished: Path) -> None:
    trained_with = mean_reward(finished / "final", "sts3215")
    assert trained_with == mean_reward(finished / "final", "sts3215")
    assert trained_with != mean_reward(finished / "final", [{"ideal": {"stiffness": 2.0}}])


def test_runs_with_neighbouring_seeds_share_no_randomness() -> None:
    seeds = [stream_seed(seed, stream) for seed in range(8) for stream in range(3)]
    assert min(abs(a - b) for a in seeds for b in seeds if a is not b) > 1024


def test_linear_schedule_falls_to_zero(finished: Path) -> None:
    rates = [event.value for event in events(finished).Scalars("train/learning_rate")]
    assert rates == sorted(rates, reverse=True) and rates[0] <= 2e-3 and rates[-1] < 1e-3


@pytest.mark.long
def test_equal_seeds_give_equal_policies(finished: Path, tmp_path: Path) -> None:
    for name, seed in (("same", 0), ("other", 1)):
        assert run(*SMALL, f"out={tmp_path}", f"name={name}", f"seed={seed}", "total_timesteps=512") == 0
    first, same, other = (
        np.concatenate(
            [p.detach().numpy().ravel() for p in PPO.load(folder / "final" / "model.zip").policy.parameters()]
        )
        for folder in (finished, tmp_path / "same", tmp_path / "other")
    )
    assert np.array_equal(first, same)
    assert not np.allclose(first, other)


def test_an_existing_run_is_never_overwritten(finished: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = contents(finished)
    assert run(*SMALL, f"out={finished.parent}", f"name={finished.name}") == 2
    assert f"resume={finished}" in capsys.readouterr().err
    assert contents(finished) == before


@pytest.mark.long
def test_a_run_without_a_name_is_called_after_its_choices(tmp_path: Path) -> None:
    for _ in range(2):  # within one second
        assert run(*SMALL, f"out={tmp_path}", "total_timesteps=128", "evaluate.every=0") == 0
    names = [path.name for path in tmp_path.iterdir()]
    assert len(names) == 2 and all(name.startswith("bench-sts3215-ppo-") for name in names)


@pytest.mark.long
def test_a_finished_run_goes_on_when_given_more_steps(finished: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(f"resume={finished}") == 2
    assert "larger total_timesteps" in capsys.readouterr().err
    assert run(f"resume={finished}", "total_timesteps=768") == 0
    assert steps(finished)[-1] == 768
    assert list(np.load(finished / "evaluations.npz")["timesteps"]) == [256, 512, 768]


@pytest.mark.long
def test_a_randomisation_given_by_path_stays_with_the_run(tmp_path: Path) -> None:
    file = tmp_path / "random.yaml"
    file.write_text("joint: {friction.load: [0.0, 0.2], friction.viscous: {times: [0.8, 1.2]}}\n")
    arguments = [f"env.randomization={file}", f"out={tmp_path}", "name=random", "total_timesteps=256"]
    assert run(*SMALL, *arguments) == 0
    file.unlink()
    folder = tmp_path / "random"
    kept = yaml.safe_load((folder / "config.yaml").read_text())["env"]["randomization"]
    assert kept == {"joint": {"friction.load": [0.0, 0.2], "friction.viscous": {"times": [0.8, 1.2]}}}
    friction = [stage["friction"] for stage in yaml.safe_load((folder / "actuators.yaml").read_text())["joint"][5:6]]
    assert friction == [{"coulomb": 0.052, "viscous": 0.059}], "the chain that was asked for"
    assert run(f"resume={folder}", "total_timesteps=384") == 0


@pytest.mark.long
def test_an_actuator_net_stays_with_the_run(tmp_path: Path) -> None:
    net = tmp_path / "mine.npz"
    net.write_bytes((REPOSITORY / "configs" / "actuator" / "sts3215_net.npz").read_bytes())
    chain = yaml.safe_load((REPOSITORY / "configs" / "actuator" / "net.yaml").read_text())
    chain[0]["net"]["file"] = str(net)
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(chain))
    arguments = [f"actuator={tmp_path / 'mine.yaml'}", f"out={tmp_path}", "name=net", "total_timesteps=256"]
    assert run(*SMALL, *arguments) == 0
    net.unlink()
    (tmp_path / "net").rename(tmp_path / "moved")
    assert run(f"resume={tmp_path / 'moved'}", "total_timesteps=384") == 0


@pytest.mark.long
@pytest.mark.parametrize(
    ("argument", "says"),
    [
        ("n_env=3", "did you mean 'n_envs'?"),
        ("agent.learning_rat=1e-3", "did you mean 'agent.learning_rate'?"),
        ("learning_rate=1e-3", "did you mean 'agent.learning_rate'?"),
        ("checkpoint.evry=3", "did you mean 'checkpoint.every'?"),
        ("env.gamma=3", "There is no key 'env.gamma'; --help"),
        ("agent=pppo", "did you mean 'ppo'?"),
        ("env=hoper", "did you mean 'hopper'?"),
        ("env.id=SeaLegs/Hoper-v0", "did you mean 'SeaLegs/Hopper-v0'?"),
        ("env.no_such=1", "no key 'env.no_such'"),
        ("actuator=idea", "did you mean 'ideal'?"),
        ("actuator=missing/extended.yaml", "missing/extended.yaml"),
        ("n_envs=abc", "n_envs takes a whole number, not 'abc'"),
        ("n_envs=0", "n_envs must be at least 1"),
        ("seed=null", "seed takes a whole number"),
        ("seed=-1", "seed must be at least 0"),
        ("agent.gamma=nan", "agent.gamma takes a number, not nan"),
        ("agent.gamma=1.5", "agent.gamma must be at most 1, not 1.5"),
        ("agent.gae_lambda=-0.1", "agent.gae_lambda must be at least 0"),
        ("agent.n_epochs=0", "agent.n_epochs must be at least 1, not 0"),
        ("agent.n_steps=0", "agent.n_steps must be at least 1"),
        ("agent.batch_size=0", "agent.batch_size must be at least 1"),
        ("agent.learning_rate=-1", "agent.learning_rate must be at least 0"),
        ("agent.learning_rate=lin_-1", "agent.learning_rate must be at least 0"),
        ("agent.clip_range=-0.1", "agent.clip_range must be more than 0"),
        ("agent.normalize.epsilon=-1", "agent.normalize.epsilon must be more than 0"),
        ("total_timesteps=0", "total_timesteps must be at least 1"),
        ("video.seconds=inf", "video.seconds takes a number, not inf"),
        ("agent.learning_rate=fast", "schedule such as lin_3e-4"),
        ("agent.target_kl=abc", "agent.target_kl takes a number or null"),
        ("agent.normalize.clip_ob=1", "did you mean 'clip_obs'?"),
        ("agent.policy_kwargs.activation_fn=tan", "there are tanh, relu, elu"),
        ("agent.algorithm=td4", "did you mean 'td3'?): there are a2c, "),
        ("agent.gamma=1,2", "is a sweep"),
        ("agent.n_steps=[1", "cannot be read"),
        ("name=a/b", "one word without '/'"),
        ("resume=nowhere/run", "is not a run folder"),
        ("env.randomization=nowhere.yaml", "the randomisation nowhere.yaml cannot be read"),
        ("verbose", "form key=value"),
        ("--verbose", "form key=value"),
    ],
)
def test_wrong_input_is_one_sentence_and_leaves_no_folder(
    argument: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [argument] if argument.startswith("resume") else [*SMALL, f"out={tmp_path / 'runs'}", argument]
    assert run(*arguments) == 2
    error = capsys.readouterr().err.strip()
    assert says in error and len(error.splitlines()) == 1
    assert not (tmp_path / "runs").exists()


@pytest.mark.long
def test_progress_never_tells_more_than_the_whole_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(*SMALL, f"out={tmp_path}", "name=short", "total_timesteps=200") == 0
    told = re.findall(r"^ *(\d+) %  step (\d+) of (\d+)", capsys.readouterr().out, re.MULTILINE)
    assert told[-1] == ("100", "256", "256"), "two simulations of 64 steps a rollout"
    assert all(int(step) <= int(total) for _, step, total in told)


def test_the_repository_around_an_environment_is_not_that_of_the_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed = tmp_path / "venv" / "site-packages" / "sealegs"
    installed.mkdir(parents=True)
    (tmp_path / "file").touch()
    commands = ["init -q", "add file", "-c user.name=A -c user.email=a@b.c commit -q -m strange"]
    for command in commands:
        subprocess.run(["git", "-C", str(tmp_path), *command.split()], check=True)
    monkeypatch.setattr(run_folder, "REPOSITORY", installed)
    assert run_folder.git_revision() == {"revision": None, "changed": None}


@pytest.mark.long
def test_additional_arguments_of_the_algorithm_are_accepted(tmp_path: Path) -> None:
    assert run(*SMALL, f"out={tmp_path}", "name=kl", "agent.target_kl=0.02", "total_timesteps=128") == 0
    assert yaml.safe_load((tmp_path / "kl" / "config.yaml").read_text())["agent"]["target_kl"] == 0.02


def test_how_hard_the_servos_are_driven_is_in_curves_and_in_a_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An untrained policy on short sides of a wide range is hard on its servo, and that is said."""
    quick = [*SMALL, "agent.policy_kwargs.log_std_init=1.0", "env.servo={heat: 0.5}", "env.start_noise=1.5"]
    assert run(*quick, f"out={tmp_path}", "name=hard", "total_timesteps=2048", "evaluate.every=0") == 0
    table = (tmp_path / "hard" / "servo.md").read_text()
    assert "| heat, i2t [share of a stalled servo's] |" in table and "env.servo.heat: 0.5" in table
    assert {"servo/goal_rate", "servo/saturation", "servo/reversals", "servo/heat", "reward/servo_heat"} <= set(
        events(tmp_path / "hard").Tags()["scalars"]
    )


# --- policies that are watched --------------------------------------------------------------------------------------


LITTLE = ("env=bench", "total_timesteps=64", "n_envs=2", "agent.n_steps=16", "agent.batch_size=16", "evaluate.every=0")
SIZE = ("width=64", "height=48", "seconds=0.5")


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs")
    assert run_script(train.main, "train", "", [*LITTLE, f"out={out}", "name=small", "video.seconds=0"]) == 0
    return out / "small" / "final"


@pytest.mark.long
def test_a_policy_is_filmed_and_its_episodes_are_told(policy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    film = policy.parent / "film.mp4"
    assert run_script(watch.main, "watch", "", [f"policy={policy}", f"out={film}", *SIZE]) == 0
    assert "Episode 1: 0.5 s, reward" in capsys.readouterr().out
    pictures = imageio.mimread(film)
    assert pictures[0].shape == (48, 64, 3) and 10 <= len(pictures) <= 15
    size = film.stat().st_size
    assert run_script(watch.main, "watch", "", [f"policy={policy}", f"out={film}", *SIZE]) == 2
    assert "nothing is overwritten" in capsys.readouterr().err and film.stat().st_size == size


@pytest.mark.long
def test_other_actuators_and_arguments_change_what_it_earns(policy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = []
    for k, change in enumerate(([], ["actuator=ideal"], ["env.params.mass=0.3"])):
        assert (
            run_script(
                watch.main, "watch", "", [f"policy={policy}", f"out={policy.parent / str(k)}.mp4", *SIZE, *change]
            )
            == 0
        )
        said.append(capsys.readouterr().out.splitlines()[0])
    assert len(set(said)) == 3


def test_a_policy_is_watched_on_the_machine_that_a_diagnosis_found(
    policy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Only the chain could be given: a load that was found stayed away from the film."""
    late = Mounted(load_chain("sts3215").with_value("delay.seconds", 0.03), "extended.yaml")
    heavier = Change("servo", "load.mass_factor", 1.0, 1.5, "load.mass", "robot")
    write_extended(Extended("bench", {"mass": 0.4}, {"servo": [late]}, (heavier,)), tmp_path)
    seen = []
    monkeypatch.setattr("sealegs.agents.video.record_video", lambda file, act, env, *_: seen.append(env) or [])
    monkeypatch.setattr("sealegs.commands.watch.written", contextlib.nullcontext)
    arguments = [f"policy={policy}", f"out={tmp_path / 'film.mp4'}", f"extended={tmp_path}", *SIZE]
    for more in ([], ["env.params.mass=0.2"]):
        assert run_script(watch.main, "watch", "", [*arguments, *more]) == 0, capsys.readouterr().err
    engines = [env.unwrapped.engine for env in seen]
    assert [engine.numbers["mass"] for engine in engines] == pytest.approx([0.6, 0.3])
    assert all(engine.chains["joint"].find("delay").seconds == 0.03 for engine in engines)
    assert run_script(watch.main, "watch", "", [*arguments, "actuator=ideal"]) == 2
    assert "give one of them" in capsys.readouterr().err


@pytest.mark.long
def test_a_gait_that_is_told_once_a_second_is_filmed_in_between(tmp_path: Path) -> None:
    env = make_single_env({"id": "SeaLegs/Hexapod-v0"}, None, 64, 48)
    episodes = record_video(tmp_path / "film.mp4", lambda *_: np.zeros((1, 6)), env, 1.0, 0)
    env.close()
    assert [episode.seconds for episode in episodes] == [1.0]
    assert len(imageio.mimread(tmp_path / "film.mp4")) > 20


def test_a_machine_that_cannot_draw_is_told_what_films_need(
    policy: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*arguments: object, **options: object) -> None:
        raise RuntimeError("no display\nand a long story")

    monkeypatch.setattr("mujoco.Renderer", fail)
    film = policy.parent / "blind.mp4"
    assert run_script(watch.main, "watch", "", [f"policy={policy}", f"out={film}", *SIZE]) == 2
    errors = capsys.readouterr().err
    assert "no display. Films need OpenGL" in errors and errors.count("\n") == 1
    assert not list(policy.parent.glob("*blind*"))


def test_an_argument_that_the_saved_environment_does_not_have_is_told_with_its_file(
    policy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It said that there is no argument 'sped', and not where."""
    folder = tmp_path / "policy"
    shutil.copytree(policy, folder)
    description = json.loads((folder / "policy.json").read_text())
    description["env"]["sped"] = 1
    (folder / "policy.json").write_text(json.dumps(description))
    (folder / "policy.onnx").unlink(missing_ok=True)
    for main, argument in ((watch.main, f"policy={folder}"), (export.main, str(folder))):
        assert run_script(main, "watch", "", [argument]) == 2
        errors = capsys.readouterr().err
        assert f"{folder / 'policy.json'}: env.sped is not an argument of" in errors and errors.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "say which policy"),
        (["policy=nowhere"], "holds no policy that can be read (it has no policy.json); give a run's best/ or final/."),
        (["policy={policy}", "env.sped=1"], "env.sped is not an argument"),
        (["policy={policy}", "actuator=idael"], "did you mean 'ideal'"),
        (["policy={policy}", "env.params=fast"], "env.params"),
        (["policy={policy}", "seconds=0"], "seconds must be more than 0"),
        (["policy={policy}", "second=1"], "no key 'second'"),
    ],
)
def test_wrong_arguments_are_answered_in_one_sentence(
    arguments: list[str], words: str, policy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_script(watch.main, "watch", "", [argument.format(policy=policy) for argument in arguments]) == 2
    errors = capsys.readouterr().err
    assert words in errors and errors.count("\n") == 1
