"""A policy, a run folder and what lies in them are data: no code runs because a file names or holds it."""

from __future__ import annotations

import base64
import json
import pickle
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import torch
import yaml
from safetensors.torch import load_file, save_file
from sealegs.agents import export
from sealegs.agents.policy_files import load_policy, mean_reward
from sealegs.commands import deploy, evaluate, train, watch
from sealegs.common.errors import SealegsError
from sealegs.configs.script import run
from sealegs.envs import known_id, registered_id
from sealegs.envs.contract import KEY
from sealegs.hw.run.policy import Policy

from tests.agents.test_resumed_training import SMALL_SAC
from tests.agents.training_runs import SMALL
from tests.made_once import folder_made_once

ROBOTS = Path(__file__).parents[1] / "robots"
TASK = """
from dataclasses import dataclass
from sealegs.envs.any_robot.reach import ReachTask
{first}
@dataclass(frozen=True)
class Mine(ReachTask):
    episode_steps = 50
"""
COMMANDS: dict[str, Callable[[list[str]], None]] = {
    "deploy": deploy.main, "evaluate": evaluate.main, "export": export.main, "train": train.main, "watch": watch.main,
}  # fmt: skip


def trained(out: Path) -> None:
    """A run of an arm in a task of its own, a short one, and one of SAC on the bench."""
    for name in ("arm.xml", "arm.yaml"):
        shutil.copy(ROBOTS / name, out / name)
    (out / "mine.py").write_text(TASK.format(first=""))
    small = [word for word in SMALL if word != "env=bench"]
    own = [f"env={out / 'mine.py'}:Mine", f"robot={out / 'arm.yaml'}"]
    assert run(train.main, "train", "", [*small, *own, f"out={out}", "name=run", "total_timesteps=256"]) == 0
    assert run(train.main, "train", "", [*SMALL_SAC, f"out={out}", "name=sac", "total_timesteps=256"]) == 0


class Machine:
    """A stranger's run on this machine, whose files name code that leaves a mark where it runs."""

    def __init__(self, folder: Path) -> None:
        made = folder_made_once("data-is-no-code", trained)
        shutil.copytree(made, folder, dirs_exist_ok=True)
        self.folder, self.run, self.sac, self.mark = folder, folder / "run", folder / "sac", folder / "mark"
        self.task = f"{folder / 'mine.py'}:Mine"
        (folder / "mine.py").write_text(TASK.format(first=f"open({str(self.mark)!r}, 'w').close()"))
        for file in (self.run / "config.yaml", *self.run.rglob("policy.json")):
            file.write_text(file.read_text().replace(str(made), str(folder)))
        (self.run / "sources.json").unlink()
        for file in self.run.rglob("policy.onnx"):
            model = onnx.load(file)
            for entry in model.metadata_props:
                entry.value = entry.value.replace(str(made), str(folder))
            onnx.save(model, file)

    def commands(self) -> dict[str, list[str]]:
        """What a person types to use the run; how the task is named, they say themselves."""
        robot, policy = f"robot={self.folder / 'arm.yaml'}", f"policy={self.run / 'final'}"
        virtual = ["hw.virtual.time=stepped", "live=false"]
        return {
            "deploy": [policy, robot, *virtual, "dry_run=true"],
            "evaluate": [policy, robot, *virtual, "seconds=1", f"out={self.folder / 'comparison'}"],
            "export": [str(self.run / "final"), str(self.folder / "again.onnx")],
            "watch": [policy, f"out={self.folder / 'film.mp4'}", "seconds=0.1", "width=64", "height=48"],
            "train": [f"resume={self.run}", "total_timesteps=384"],
        }

    def payload(self) -> object:
        """An object that leaves the mark when it is unpickled."""
        mark = str(self.mark)

        class Payload:
            def __reduce__(self) -> Any:
                return open, (mark, "w")

        return Payload()


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


def said(word: str, arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Exit status of a command, and the last line that it printed on standard error."""
    status = run(COMMANDS[word], word, "", arguments)
    lines = capsys.readouterr().err.strip().splitlines()
    return status, lines[-1] if lines else ""


# --- tasks -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("word", COMMANDS)
def test_a_task_that_only_a_file_names_is_not_run(
    word: str, machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    status, sentence = said(word, machine.commands()[word], capsys)
    key = "env" if word == "train" else "task"
    assert status == 2 and not machine.mark.exists()
    assert f"was trained in {machine.task}" in sentence and f"give {key}={machine.task}" in sentence


@pytest.mark.parametrize("word", COMMANDS)
def test_another_task_than_the_policys_is_refused_and_not_run(
    word: str, machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    other = machine.folder / "other.py"
    shutil.copy(machine.folder / "mine.py", other)
    key = "env" if word == "train" else "task"
    status, sentence = said(word, [*machine.commands()[word], f"{key}={other}:Mine"], capsys)
    assert status == 2 and not machine.mark.exists()
    assert f"was trained in mine.py:Mine, and {key}={other}:Mine is another task" in sentence


@pytest.mark.long
@pytest.mark.parametrize("word", [word for word in COMMANDS if word != "watch"])  # which draws
def test_a_task_that_the_person_names_is_run_wherever_its_file_lies(
    word: str, machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    (machine.folder / "tasks").mkdir()
    (machine.folder / "mine.py").rename(machine.folder / "tasks" / "mine.py")
    key = "env" if word == "train" else "task"
    named = f"{key}={machine.folder / 'tasks' / 'mine.py'}:Mine"
    assert said(word, [*machine.commands()[word], named], capsys)[0] == 0
    assert machine.mark.exists()


def test_a_task_is_known_to_a_process_that_was_told_of_it(machine: Machine) -> None:
    with pytest.raises(SealegsError, match="code, which is not run because a file names it"):
        known_id(machine.task)
    found = registered_id(machine.task)
    machine.mark.unlink()
    assert known_id(machine.task) == found
    assert Policy(machine.run / "final").contract.env["id"] == machine.task
    (machine.folder / "mine.py").write_text("raise SystemExit")
    assert known_id(machine.task) == found, "a training goes on with the task that it began with"
    assert not machine.mark.exists()


@pytest.mark.parametrize("name", ["CartPole-v1", "nowhere:Env-v0", "os:system", ""])
def test_other_names_of_environments_import_nothing(name: str, machine: Machine) -> None:
    path = machine.run / "final" / "policy.onnx"
    model = onnx.load(path)
    entry = next(entry for entry in model.metadata_props if entry.key == KEY)
    contract = json.loads(entry.value)
    contract["env"]["id"] = name
    entry.value = json.dumps(contract)
    onnx.save(model, path)
    policy = Policy(path)
    with pytest.raises(SealegsError, match=r"no environment|none of this project's"):
        policy.contract.task_on(None)  # type: ignore[arg-type]  it comes to no robot


def test_a_policy_of_the_project_takes_no_task(machine: Machine) -> None:
    with pytest.raises(SealegsError, match=r"comes with sealegs: leave task= out"):
        mean_reward(machine.sac / "final", "ideal", task=machine.task)
    assert not machine.mark.exists()


def test_a_config_of_a_run_fills_in_nothing_of_the_person(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    path = machine.sac / "config.yaml"
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | {"extended": "${oc.env:HOME}"}))
    status, sentence = said("train", [f"resume={machine.sac}", "total_timesteps=384"], capsys)
    assert status == 2 and "holds '${'" in sentence


# --- pickles ---------------------------------------------------------------------------------------------------------


def hostile_zip(path: Path, payload: object) -> None:
    """A model of Stable-Baselines3 whose data and whose weights are the payload."""
    serialized = base64.b64encode(pickle.dumps(payload)).decode()
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("data", json.dumps({"policy_class": {":type:": "x", ":serialized:": serialized}}))
        file.writestr("policy.pth", pickle.dumps(payload))


def only_pickles(folder: Path, payload: object) -> None:
    """What an earlier version wrote, but hostile."""
    for file in folder.rglob("*.safetensors"):
        file.unlink()
    for path in (folder, *folder.glob("checkpoints/*"), *folder.glob("final")):
        if (path / "policy.json").exists():
            hostile_zip(path / "model.zip", payload)
            for name in ("vecnormalize.pkl", "replay_buffer.pkl"):
                (path / name).write_bytes(pickle.dumps(payload))


@pytest.mark.parametrize("word", ["export", "watch", "train"])
def test_a_pickle_is_loaded_only_with_trust(word: str, machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    only_pickles(machine.sac, machine.payload())
    arguments = [argument.replace(str(machine.run), str(machine.sac)) for argument in machine.commands()[word]]
    status, sentence = said(word, arguments, capsys)
    assert status == 2 and not machine.mark.exists()
    assert "is a pickle, which can run any code" in sentence and "give trust=true if you trust" in sentence
    status, sentence = said(word, [*arguments, "trust=true"], capsys)
    assert machine.mark.exists(), "so it was a payload"
    assert status == 2 and len(sentence.splitlines()) == 1


def test_a_policy_is_evaluated_without_its_pickles(machine: Machine) -> None:
    before = mean_reward(machine.sac / "final", "ideal", 2)
    hostile_zip(machine.sac / "final" / "model.zip", machine.payload())
    (machine.sac / "final" / "vecnormalize.pkl").write_bytes(pickle.dumps(machine.payload()))
    assert mean_reward(machine.sac / "final", "ideal", 2) == before and not machine.mark.exists()


def test_a_run_folder_holds_no_pickle_but_what_it_has_for_sb3(machine: Machine) -> None:
    for file in (path for path in machine.folder.rglob("*") if path.is_file()):
        if file.name in ("model.zip", "vecnormalize.pkl"):
            assert file.parent.name in ("best", "final")
            continue
        assert not zipfile.is_zipfile(file) or file.suffix == ".npz", file
        assert file.read_bytes()[:1] != b"\x80", f"{file} begins as a pickle does"
        if file.suffix == ".npz":
            with np.load(file, allow_pickle=False) as arrays:
                assert all(arrays[name].dtype != object for name in arrays.files)


@pytest.mark.long
@pytest.mark.parametrize("name", ["run", "sac"])
def test_a_run_is_used_without_the_files_for_sb3(
    name: str, machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = machine.folder / name
    for file in (*folder.rglob("model.zip"), *folder.rglob("*.pkl")):
        file.unlink()
    registered_id(machine.task)
    (folder / "final" / "policy.onnx").unlink()
    assert said("export", [str(folder / "final")], capsys)[0] == 0
    assert np.isfinite(mean_reward(folder / "final", "ideal", 2))
    own = [f"env={machine.task}"] if name == "run" else []
    assert said("train", [f"resume={folder}", "total_timesteps=512", *own], capsys)[0] == 0


# --- exactness -------------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("name", ["run", "sac"])
def test_a_resumed_run_learns_bit_for_bit_what_the_one_resumed_by_sb3_learns(
    name: str, machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    from sealegs.agents.config import with_overrides
    from sealegs.agents.run_folder import RunFolder
    from sealegs.agents.training import Session

    registered_id(machine.task)
    first = machine.folder / name
    run_folder = RunFolder.open(first)
    config = with_overrides(run_folder.read_config(), {"total_timesteps": "640"}, str(first))
    session = Session.resumed(run_folder, config)
    checkpoint = sorted((first / "checkpoints").iterdir())[-1]
    # the same learner as Stable-Baselines3 keeps it
    session.model.save(checkpoint / "model.zip")
    normalizer = session.model.get_vec_normalize_env()
    assert normalizer is not None
    normalizer.save(str(checkpoint / "vecnormalize.pkl"))
    if name == "sac":
        session.model.save_replay_buffer(checkpoint / "replay_buffer.pkl")  # type: ignore[attr-defined]
    run_folder.close()
    second = machine.folder / "second"
    shutil.copytree(first, second)
    for file in second.glob("checkpoints/*/*.safetensors"):
        file.unlink()
    assert said("train", [f"resume={first}", "total_timesteps=640"], capsys)[0] == 0
    assert said("train", [f"resume={second}", "total_timesteps=640", "trust=true"], capsys)[0] == 0
    for kind in ("policy", "learner", *(["replay_buffer"] if name == "sac" else [])):
        ours, theirs = (
            load_file(folder / "checkpoints" / "000000000640" / f"{kind}.safetensors") for folder in (first, second)
        )
        assert ours.keys() == theirs.keys()
        assert all(torch.equal(ours[key], theirs[key]) for key in ours), kind


# --- hostile numbers -------------------------------------------------------------------------------------------------


def about_of(path: Path) -> dict[str, str]:
    """Metadata of a file of tensors."""
    size = int.from_bytes(path.read_bytes()[:8], "little")
    return json.loads(path.read_bytes()[8 : 8 + size])["__metadata__"]


def changed(path: Path, tensors: Callable[[dict[str, torch.Tensor]], Any], **network: Any) -> None:
    """Change the tensors of a file, and what it says of its network."""
    held, about = load_file(path), json.loads(about_of(path)["sealegs"])
    tensors(held)
    if network:
        about["policy_kwargs"] |= network
    save_file(held, path, {"sealegs": json.dumps(about)})


WEIGHT = "action_net.weight"


@pytest.mark.parametrize(
    ("change", "network", "sentence"),
    [
        (lambda held: held.pop(WEIGHT), {}, f"'{WEIGHT}' is missing"),
        (lambda held: held.update(more=torch.zeros(2)), {}, "'more' is not known"),
        (
            lambda held: held.update({WEIGHT: torch.zeros(3, 8)}),
            {},
            r"float32 \[3, 8\], and float32 \[2, 8\] is needed",
        ),
        (lambda held: held.update({WEIGHT: held[WEIGHT].double()}), {}, "float64"),
        (lambda held: held[WEIGHT].fill_(np.nan), {}, "not finite"),
        (lambda held: None, {"net_arch": [10**9, 10**9]}, "more weights than it holds"),
        (lambda held: None, {"net_arch": [8] * 10**5}, "more weights than it holds"),
        (lambda held: None, {"net_arch": [-8]}, "'net_arch' is"),
        (lambda held: None, {"net_arch": "os.system"}, "'net_arch' is"),
        (lambda held: None, {"activation_fn": "os.system"}, "'activation_fn' is"),
        (lambda held: None, {"features_extractor_class": "x"}, "'features_extractor_class' is"),
    ],
)
def test_weights_that_do_not_fit_are_refused_in_a_sentence(
    change: Callable[[dict[str, torch.Tensor]], Any], network: dict[str, Any], sentence: str, machine: Machine
) -> None:
    folder = machine.run / "final"
    changed(folder / "policy.safetensors", change, **network)
    with pytest.raises(SealegsError, match=sentence) as refused:
        load_policy(folder)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("content", [b"", b"\xff" * 64, b"\x08\0\0\0\0\0\0\0{}      ", b"\x00\0\0\0\0\0\0\x7f{"])
def test_files_that_hold_no_numbers_are_refused_in_a_sentence(content: bytes, machine: Machine) -> None:
    (machine.run / "final" / "policy.safetensors").write_bytes(content)
    with pytest.raises(SealegsError, match=r"cannot be read") as refused:
        load_policy(machine.run / "final")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "described",
    [
        {"observation": {"shape": [10**12]}},
        {"observation": {"shape": [-1]}},
        {"observation": {"shape": "many"}},
        {"observation": {}},
        {"action": {"shape": [2], "low": [1.0, 1.0], "high": [0.0, 0.0]}},
        {"action": {"shape": [2], "low": [0.0], "high": [1.0]}},
        {"action": None},
    ],
)
def test_a_description_that_is_none_is_refused_in_a_sentence(described: dict[str, Any], machine: Machine) -> None:
    path = machine.run / "final" / "policy.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | described))
    with pytest.raises(SealegsError, match="holds no policy that can be read"):
        load_policy(path.parent)


@pytest.mark.parametrize(
    ("file", "change"),
    [
        ("learner", lambda held: held.update({"actor.optimizer.0.exp_avg": torch.zeros(3)})),
        ("learner", lambda held: held.pop("actor.optimizer.0.step")),
        ("learner", lambda held: held.update({"actor.optimizer.99.step": torch.zeros(())})),
        ("learner", lambda held: held.update({"normalizer.observation.mean": torch.zeros(1, dtype=torch.float64)})),
        ("learner", lambda held: held.update({"log_ent_coef": torch.full((1,), np.inf)})),
        ("replay_buffer", lambda held: held.update(rewards=torch.zeros(10**6))),
        ("replay_buffer", lambda held: held.pop("dones")),
    ],
)
def test_a_learner_that_does_not_fit_gives_way_to_the_checkpoint_before(
    file: str, change: Callable[[dict[str, torch.Tensor]], Any], machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    for path in machine.sac.glob(f"checkpoints/*/{file}.safetensors"):
        changed(path, change)
    assert run(train.main, "train", "", [f"resume={machine.sac}", "total_timesteps=384"]) == 2
    first, *_, last = capsys.readouterr().err.strip().splitlines()
    assert "cannot be read (" in first and "No checkpoint" in last


# --- what is said, read, and decides the limits of servos -----------------------------------------------------------


def test_a_name_in_a_file_says_nothing_to_the_terminal_or_the_shell(
    machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    path = machine.run / "final" / "policy.json"
    path.write_text(path.read_text().replace(str(machine.folder / "mine.py"), "/x/\\u001b[2J$(touch y) mine.py"))
    status, sentence = said("export", [str(path.parent), str(machine.folder / "out.onnx")], capsys)
    assert status == 2 and "\x1b" not in sentence and "'task=/x/\\x1b[2J$(touch y) mine.py:Mine'" in sentence


def test_a_file_beside_an_excitation_does_not_choose_the_limits_of_real_servos(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("arm.xml", "arm.yaml"):
        shutil.copy(ROBOTS / name, tmp_path / name)
    (tmp_path / "next.csv").write_text("time,shoulder.goal,elbow.goal\n0,0,0\n1,0,0\n")
    (tmp_path / "next.yaml").write_text("robot: arm.yaml\n")
    status, sentence = said("deploy", [f"excitation={tmp_path / 'next.csv'}", "hw=feetech", "port=/dev/null"], capsys)
    assert status == 2 and f"give robot={tmp_path / 'arm.yaml'} yourself" in sentence


def test_an_onnx_file_reads_no_file_outside_its_folder(machine: Machine) -> None:
    path = machine.run / "final" / "policy.onnx"
    model = onnx.load(path)
    weights = next(item for item in model.graph.initializer if item.raw_data and len(item.dims) == 2)
    secret = machine.folder / "secret"
    secret.write_bytes(weights.raw_data)
    for location in (str(secret), "../../secret"):
        weights.ClearField("raw_data")
        weights.ClearField("external_data")
        weights.data_location = onnx.TensorProto.EXTERNAL
        weights.external_data.add(key="location", value=location)
        path.write_bytes(model.SerializeToString())
        with pytest.raises(SealegsError, match="has weights in another file, and none is read beside it"):
            Policy(path)
