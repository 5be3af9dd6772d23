"""Films of trained policies."""

from __future__ import annotations

import contextlib
import json
import shutil
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.agents import export
from sealegs.agents.make_env import make_single_env
from sealegs.agents.video import record_video
from sealegs.commands import train, watch
from sealegs.configs.script import run
from sealegs.envs.extended import Change, Extended, Mounted
from sealegs.gap.output.extension import write_extended

SMALL = ("env=bench", "total_timesteps=64", "n_envs=2", "agent.n_steps=16", "agent.batch_size=16", "evaluate.every=0")
SIZE = ("width=64", "height=48", "seconds=0.5")


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs")
    assert run(train.main, "train", "", [*SMALL, f"out={out}", "name=small", "video.seconds=0"]) == 0
    return out / "small" / "final"


@pytest.mark.long
def test_a_policy_is_filmed_and_its_episodes_are_told(policy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    film = policy.parent / "film.mp4"
    assert run(watch.main, "watch", "", [f"policy={policy}", f"out={film}", *SIZE]) == 0
    assert "Episode 1: 0.5 s, reward" in capsys.readouterr().out
    pictures = imageio.mimread(film)
    assert pictures[0].shape == (48, 64, 3) and 10 <= len(pictures) <= 15
    size = film.stat().st_size
    assert run(watch.main, "watch", "", [f"policy={policy}", f"out={film}", *SIZE]) == 2
    assert "nothing is overwritten" in capsys.readouterr().err and film.stat().st_size == size


@pytest.mark.long
def test_other_actuators_and_arguments_change_what_it_earns(policy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = []
    for k, change in enumerate(([], ["actuator=ideal"], ["env.params.mass=0.3"])):
        assert (
            run(watch.main, "watch", "", [f"policy={policy}", f"out={policy.parent / str(k)}.mp4", *SIZE, *change]) == 0
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
        assert run(watch.main, "watch", "", [*arguments, *more]) == 0, capsys.readouterr().err
    engines = [env.unwrapped.engine for env in seen]
    assert [engine.numbers["mass"] for engine in engines] == pytest.approx([0.6, 0.3])
    assert all(engine.chains["joint"].find("delay").seconds == 0.03 for engine in engines)
    assert run(watch.main, "watch", "", [*arguments, "actuator=ideal"]) == 2
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
    assert run(watch.main, "watch", "", [f"policy={policy}", f"out={film}", *SIZE]) == 2
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
        assert run(main, "watch", "", [argument]) == 2
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
    assert run(watch.main, "watch", "", [argument.format(policy=policy) for argument in arguments]) == 2
    errors = capsys.readouterr().err
    assert words in errors and errors.count("\n") == 1
