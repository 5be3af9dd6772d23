"""What a person asks a policy for: files, keys, a gamepad and functions reach it over the virtual bus."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import sealegs
import torch
from sealegs.commands import deploy
from sealegs.common.errors import SealegsError
from sealegs.configs.script import run as run_script
from sealegs.envs.any_robot.track import TrackTask
from sealegs.envs.any_robot.walk import WalkTask
from sealegs.envs.contract import Contract
from sealegs.envs.engine.sb3 import BatchVecEnv
from sealegs.envs.hopper.env import HopperTask
from sealegs.hw.run import asked as module
from sealegs.hw.run.asked import AskedKeys, AskedPad, asked_for
from sealegs.hw.run.policy import Policy
from stable_baselines3 import PPO

STEPPED = {"hw.virtual.time": "stepped", "live": False, "hw.timeout": 1, "silence": 20}
MACHINE = {"robot.safety.late": 5, "robot.safety.silent": 1}


@pytest.fixture(scope="module")
def tracker(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A policy that tracks on the bench and corrects nothing: its goals are its reference."""
    env = BatchVecEnv("SeaLegs/Track-v1", 2, seed=0, robot="bench", lead=0.05)
    model = PPO("MlpPolicy", env, device="cpu")
    network: Any = model.policy
    with torch.no_grad():
        network.action_net.weight.zero_()
    return sealegs.export(model, tmp_path_factory.mktemp("policy") / "track.onnx")


def goals(log: Path) -> tuple[np.ndarray, np.ndarray]:
    """Time [s] and goals of the bench [rad] of a log."""
    run = sealegs.read_log(log).runs[0]
    return run.time, np.asarray(run.joints["joint"].goal)


def deployed(policy: Path, tmp_path: Path, command: Any, **more: Any) -> tuple[np.ndarray, np.ndarray]:
    """Time and goals of two seconds on the virtual bench."""
    settings = {**STEPPED, **MACHINE, "duration": 2.0, "out": str(tmp_path / "logs"), **more}
    return goals(sealegs.deploy(policy, "bench", command, say=lambda _: None, **settings).log)


def motion(time: Any) -> Any:
    """A trajectory of one's own [rad]: no sum of two sines."""
    return 0.3 * np.tanh(3.0 * (np.asarray(time) - 1.0)) + 0.1 * np.square(np.sin(2.0 * np.asarray(time)))


def test_the_commands_of_a_policy_have_names_in_its_contract(tracker: Path) -> None:
    assert Policy(tracker).contract.asked == ("joint [rad]",)
    document = json.loads(Policy(tracker).contract.to_json())
    document.pop("asked"), document.pop("policy_memory")
    assert Contract.from_json(json.dumps(document), "x").asked == (), "contracts of before are read"
    assert WalkTask().asked_names() == ("forward [m/s]", "sideways [m/s]", "turn [rad/s]")
    assert HopperTask().asked_names() == ("speed [m/s]",)


@pytest.mark.parametrize("lead", [0.0, 0.03, 0.06, 0.2])
def test_a_tracking_task_asks_for_any_trajectory_at_the_places_that_it_looks_at(lead: float) -> None:
    task = TrackTask(lead=lead)
    for time in (0.0, 0.37, 5.2, 400.0):
        command = task.command_at(time, lambda at: np.array([motion(at)]))[None]
        for ahead in (0.0, task.preview, lead):
            assert task.target(np.array([time + ahead]), command)[0, 0] == pytest.approx(motion(time + ahead), abs=1e-9)


def test_a_trajectory_of_a_file_is_what_the_servo_is_led_along(tracker: Path, tmp_path: Path) -> None:
    time = np.arange(0.0, 3.0, 0.01)
    rows = "\n".join(f"{t:.3f},{value:.6f}" for t, value in zip(time, motion(time), strict=True))
    (tmp_path / "motion.csv").write_text(f"time,joint\n{rows}\n")
    at, sent = deployed(tracker, tmp_path, str(tmp_path / "motion.csv"))
    cycles = np.round((at - at[0]) * 50.0) / 50.0
    assert sent == pytest.approx(motion(cycles + 0.05), abs=2e-3), "goals lead what is asked for by 50 ms"
    assert np.ptp(sent) > 0.5


def test_a_function_of_the_callers_asks_in_each_cycle(tracker: Path, tmp_path: Path) -> None:
    times: list[float] = []

    def ask(time: float) -> dict[str, float]:
        times.append(time)
        return {"joint": 5.0 if time > 1.5 else 0.3 * math.sin(2.0 * time)}

    at, sent = deployed(tracker, tmp_path, ask)
    assert len(set(times)) > 100
    early, most = at - at[0] < 1.3, TrackTask(lead=0.05).asked_range()[1][0]
    assert sent[early] == pytest.approx(
        0.3 * np.sin(2.0 * (np.round((at - at[0])[early] * 50.0) / 50.0 + 0.05)), abs=2e-3
    )
    assert sent[-1] == pytest.approx(most), "what is beyond training is held within"


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        ("{knee: 0.1}", "names 'knee'; the task asks for joint [rad]"),
        ("{joint: 9.0}", "asks for joint [rad] 9, but the policy was trained with"),
        ("[0.1,0.2]", "the task takes 1 command value(s), not 2: joint [rad]"),
        ("no.csv", "command=no.csv cannot be read"),
        ("gamepad", "command=gamepad needs a gamepad, and none is connected"),
        ("keyboard dead_man=true", "dead_man=true and command=keyboard both need the keyboard"),
    ],
)
def test_what_does_not_fit_is_one_sentence(
    command: str, sentence: str, tracker: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [f"policy={tracker}", *f"command={command}".replace("} ", "}\n").split(" d")[:1]]
    words += ["dead_man=true"] if "dead_man" in command else []
    assert run_script(deploy.main, "deploy", "", words) == 2
    said = capsys.readouterr().err
    assert sentence in said and said.count("\n") == 1


@pytest.mark.parametrize("text", ["joint\n0.1\n", "time,joint\n0,0\n0,0.1\n", "time,joint\n0,x\n", "time\n0\n", ""])
def test_a_table_that_is_no_trajectory_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "motion.csv").write_text(text)
    with pytest.raises(SealegsError, match=r"motion\.csv"):
        asked_for(str(tmp_path / "motion.csv"), TrackTask(lead=0.0))


def test_keys_move_the_numbers_between_the_ends_of_training(monkeypatch: pytest.MonkeyPatch) -> None:
    reader, writer = os.pipe()
    keys: Callable[[float], np.ndarray] = AskedKeys(WalkTask())

    class Terminal:
        def __enter__(self) -> int:
            return reader

        def __exit__(self, *_: object) -> None: ...

    monkeypatch.setattr(module, "pressed_key", lambda _: Terminal())
    with keys.opened():  # pyright: ignore[reportFunctionMemberAccess]
        assert keys(0.0).tolist() == [0.0, 0.0, 0.0]
        os.write(writer, b"\x1b[A\x1b[Aw" + b"\x1b[C" + b"q")
        assert keys(0.1) == pytest.approx([3 * 0.5 / 20, -0.2 / 20, 1.2 / 20])
        os.write(writer, b"w" * 50 + b"d" * 50)
        assert keys(0.2)[:2] == pytest.approx([0.3, -0.1])
        os.write(writer, b" ")
        assert keys(0.3).tolist() == [0.0, 0.0, 0.0]
        os.write(writer, b"w")
        keys(0.4)
        os.close(writer)
        assert keys(0.5).tolist() == [0.0, 0.0, 0.0], "a terminal that closes steers nobody"


def test_a_gamepad_moves_the_numbers_and_one_that_is_gone_lets_go(monkeypatch: pytest.MonkeyPatch) -> None:
    pygame = pytest.importorskip("pygame")
    sticks, events = [0.0, 0.0, 0.0, 0.0], []
    pad = SimpleNamespace(get_init=lambda: True, get_numaxes=lambda: 4, get_axis=lambda axis: sticks[axis])
    monkeypatch.setattr(pygame.joystick, "get_count", lambda: 1)
    monkeypatch.setattr(pygame.joystick, "Joystick", lambda _: pad)
    monkeypatch.setattr(pygame.event, "get", lambda: events)
    asked = AskedPad(WalkTask())
    sticks[:] = [0.05, -1.0, 0.55, 0.0]  # a stick that does not rest at 0; up; right
    assert asked(0.0) == pytest.approx([0.3, 0.0, -0.3])
    sticks[1] = 1.0
    assert asked(0.1)[0] == pytest.approx(-0.2)
    events.append(SimpleNamespace(type=pygame.JOYDEVICEREMOVED))
    assert asked(0.2).tolist() == [0.0, 0.0, 0.0]
    assert asked.still()(0.0).tolist() == [0.0, 0.0, 0.0]


def test_without_pygame_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(SealegsError, match=r"pip install 'sealegs\[gamepad\]'"):
        AskedPad(WalkTask())


def test_a_policy_that_remembers_runs_on_the_virtual_bus(tmp_path: Path) -> None:
    """The loop carries earlier observations and the LSTM's state from call to call, as it does a gait's memory."""
    from sb3_contrib import RecurrentPPO
    from stable_baselines3.common.vec_env import VecFrameStack

    torch.manual_seed(0)
    env = VecFrameStack(BatchVecEnv("SeaLegs/Track-v1", 2, seed=0, robot="bench", lead=0.05), 2)
    model = RecurrentPPO("MlpLstmPolicy", env, policy_kwargs={"lstm_hidden_size": 8}, device="cpu")
    network: Any = model.policy
    with torch.no_grad():
        network.action_net.weight.mul_(300.0)
    policy = sealegs.export(model, tmp_path / "lstm.onnx")
    assert Policy(policy).contract.policy_memory == 5 + 16
    _, sent = deployed(policy, tmp_path, {"joint": 0.2})
    correction = sent - 0.2
    assert len(sent) == 100 and np.ptp(correction) > 0.005, "it corrects, and what it remembers changes that"
