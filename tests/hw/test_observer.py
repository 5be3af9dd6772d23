"""What a policy sees on servos, and what it is asked for."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import sealegs
import torch
from sealegs.commands import deploy
from sealegs.common.errors import SealegsError
from sealegs.configs.compose import compose
from sealegs.configs.script import run as run_script
from sealegs.envs import ENVIRONMENTS
from sealegs.envs.any_robot.track import TrackTask
from sealegs.envs.any_robot.walk import WalkTask
from sealegs.envs.contract import Contract, make_contract, start_pose
from sealegs.envs.engine.sb3 import BatchVecEnv
from sealegs.envs.hopper.env import HopperTask
from sealegs.gap.log import read_measured
from sealegs.hw.guard.safety import Limits, Safety
from sealegs.hw.machine.own_robot import READERS
from sealegs.hw.machine.robot import Reading, build_robot
from sealegs.hw.run import asked as module
from sealegs.hw.run.asked import AskedKeys, AskedPad, asked_for
from sealegs.hw.run.observer import Observer
from sealegs.hw.run.policy import Policy
from sealegs.hw.run.task_reference import TaskReference
from sealegs.hw.virtual.__main__ import build
from sealegs.hw.virtual.in_process import bus_in_process
from stable_baselines3 import PPO

from benchmarks.policies_on_the_bus import on_the_bus
from tests.servo_runs import POLICIES, committed, config, gentle_policy

PERIOD = 0.02


def reading(time: float, position: np.ndarray, link: np.ndarray, base: np.ndarray, base_speed: np.ndarray) -> Reading:
    nothing = np.zeros(len(position))
    return Reading(
        before=time,
        after=time,
        position=position.copy(),
        velocity=nothing,
        duty=nothing,
        current=nothing,
        voltage=nothing,
        temperature=nothing,
        link=link.copy(),
        base_position=base.copy(),
        base_velocity=base_speed.copy(),
        state=None,
    )


@pytest.mark.long
@pytest.mark.parametrize("name", ["bench", "hopper"])
def test_on_servos_a_policy_sees_what_it_saw_in_training(
    name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    env_id = f"SeaLegs/{name.capitalize()}-v0"
    contract = Policy(gentle_policy(tmp_path / "policy.onnx", env_id)).contract
    env = BatchVecEnv(env_id, 1, seed=0, control_rate=1.0 / PERIOD)
    task, motions = type(env.engine.task), list[Any]()
    observe = task.observe
    monkeypatch.setattr(task, "observe", lambda self, motion: motions.append(motion) or observe(self, motion))
    robot = build_robot(config(f"robot={name}")["robot"])
    seen_in_training: Any = env.reset()
    observer = Observer(contract, robot, motions[-1].command[0].copy())
    random, base = np.random.default_rng(0), len(robot.base_names)
    for cycle in range(40):
        motion = motions[-1]
        measured = reading(
            5.0 + cycle * PERIOD, motion.reading[0], motion.link[0], motion.qpos[0, :base], motion.qvel[0, :base]
        )
        seen = observer.see(measured)
        assert seen.observation == pytest.approx(seen_in_training[0], abs=2e-3 if cycle == 0 else 2e-5)
        action = random.uniform(-0.4, 0.4, len(robot.joints))
        observer.acted(action)
        seen_in_training, _, done, _ = env.step(action[None])
        assert not done.any()


@pytest.mark.long
def test_a_missed_reading_makes_no_speed(tmp_path: Path) -> None:
    robot = build_robot(config()["robot"])
    observer = Observer(Policy(gentle_policy(tmp_path / "policy.onnx")).contract, robot)
    nothing = np.zeros(0)
    for time in (1.0, 1.02, 1.0401, 1.0995, 1.12):  # some jitter, and two readings that never came
        angle = np.array([0.5 * round(time / PERIOD) * PERIOD])
        seen = observer.see(reading(time, angle, angle, nothing, nothing))
        if time > 1.0:
            assert seen.observation[[3, 4]] == pytest.approx([0.5, 0.5], abs=1e-5), "link and motor speed"


@pytest.mark.long
def test_the_speed_of_a_base_is_half_a_control_step_late_on_servos() -> None:
    """What docs/limits.md says of it; training observes the speed of the moment."""
    robot = build_robot(config("robot=hopper")["robot"])
    chains = {name: chain.to_list() for name, chain in robot.chains.items()}
    contract = make_contract({"id": "SeaLegs/Hopper-v0"}, chains, 1.0 / PERIOD)
    bus, rig = bus_in_process(robot, pose=start_pose(contract))
    observer, place = Observer(contract, robot), contract.observation_names.index("upward speed [m/s]")
    bus.torque_on(robot.ids)
    bus.clock.sleep(0.5)
    rig.held = None
    begin, last, rows = bus.clock.now(), None, []
    for cycle in range(250):
        bus.clock.sleep(begin + PERIOD * (cycle + 1) - bus.clock.now())
        of_the_moment, height = rig.machine.base()[1]["base_z"], rig.machine.base()[0]["base_z"]
        last = robot.reading(bus.read_cycle(robot.all_ids, False, bus.clock.now() + 0.01), last)
        rows.append((observer.see(last).observation[place], of_the_moment, height))
        side = np.sign(np.sin(2.0 * np.pi * 3.0 * cycle * PERIOD))
        hop = np.array([-0.61, 0.61]) + 0.35 * side * np.array([-0.5, 1.0])
        bus.write_goals(robot.ids, robot.to_servo(np.clip(hop, robot.low, robot.high)))
    seen, of_the_moment, height = np.array(rows[20:]).T
    mean = np.diff(height) / PERIOD

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean(values**2)))

    assert rms(of_the_moment) == pytest.approx(0.47, abs=0.05)
    assert rms(seen - of_the_moment) == pytest.approx(0.08, abs=0.02)
    assert rms(seen[1:] - mean) < 0.02


def test_a_lost_reply_makes_neither_a_standstill_nor_a_jump() -> None:
    robot = build_robot(config("robot=hopper")["robot"])
    chains = {name: chain.to_list() for name, chain in robot.chains.items()}
    contract = make_contract({"id": "SeaLegs/Hopper-v0"}, chains, 1.0 / PERIOD)
    observer, bus = Observer(contract, robot), bus_in_process(robot)[0]
    lost, where = robot.all_ids[::2], list(contract.observation_names)
    places, last, seen = np.zeros(len(robot.all_ids)), None, []
    for cycle in range(5):
        gone = [cycle == 3 and servo in lost for servo in robot.all_ids]
        places = np.where(gone, places, 0.01 * cycle)  # what did not answer is read as it was
        missing = tuple(lost) if any(gone) else ()
        state = bus.read_state(robot.all_ids)
        state = replace(state, before=PERIOD * cycle, after=PERIOD * cycle, position=places, missing=missing)
        last = robot.reading(state, last)
        seen.append((observer.see(last).observation, last.base_velocity))
    speeds = [k for k, name in enumerate(where) if "speed" in name and "commanded" not in name]
    for observation, base in seen[3:]:
        assert observation[speeds] == pytest.approx(seen[2][0][speeds], rel=1e-5)
        assert base == pytest.approx(seen[2][1], rel=1e-5)
    assert np.abs(seen[2][0][speeds]).min() > 0.01


@pytest.mark.parametrize(
    ("speed", "wrong", "says"),
    [
        ([0.1, 0.4], 100.0, "is 100, but the policy was trained with 0.1 to 0.4"),
        (0.3, -0.3, "is -0.3, but .* with 0.3;"),
    ],
)
def test_a_command_that_the_policy_was_not_trained_on_is_refused(speed: Any, wrong: float, says: str) -> None:
    robot = build_robot(config("robot=hopper")["robot"])
    chains = {name: chain.to_list() for name, chain in robot.chains.items()}
    contract = make_contract({"id": "SeaLegs/Hopper-v0", "speed": speed}, chains, 1.0 / PERIOD)
    for allowed in np.atleast_1d(speed):
        assert Observer(contract, robot, np.array([allowed])).command == [allowed]
    with pytest.raises(SealegsError, match=says):
        Observer(contract, robot, np.array([wrong]))


KINDS = sorted(path.parent.name for path in POLICIES.glob("*/seed0"))


@pytest.mark.parametrize("name", sorted(item.lower() for item in ENVIRONMENTS))
def test_every_robot_of_the_collection_is_known_to_deploy(name: str) -> None:
    config = compose("deploy", {"robot": name})["robot"]
    robot = build_robot(config)
    assert robot.robot.name == name and len(robot.chains) == len(robot.joints)
    Safety(robot, Limits.from_config(config["safety"]), 0.01)


def test_a_virtual_bus_takes_the_robots_own_words_for_its_chains() -> None:
    with build(compose("virtual", {"robot": "leg", "actuator": "silo4_pd"})) as server:
        assert len(server.wire.servos) == 3


def test_no_committed_policy_is_for_another_robot() -> None:
    rows = [json.loads((POLICIES / kind / "seed0" / "policy.json").read_text()) for kind in KINDS]
    robots = {row["env"]["id"].removeprefix("SeaLegs/").removesuffix("-v0") for row in rows}
    assert robots and robots <= set(ENVIRONMENTS)


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_a_committed_policy_runs_on_the_virtual_bus_of_its_robot(kind: str) -> None:
    policy = committed(kind)
    found = on_the_bus(policy.contract.robot, policy, 2.0)
    assert found["ending"] == "finished" and found["seconds"] > 0.9, found


# --- the reference of a task on virtual servos, without a policy: a gait is tried before anything is trained ---------

STEPPED = ["hw.virtual.time=stepped", "live=false"]


def test_a_quadruped_walks_on_its_gait_under_the_guard_and_into_a_log(tmp_path: Path) -> None:
    words = ["reference={walk: {cadence: 2.0, lift: 0.02}}", "robot=quadruped", "command={forward: 0.2}"]
    deploy.main([*words, *STEPPED, "duration=1.0", f"out={tmp_path}", "name=gait"])
    run = read_measured(tmp_path / "gait.csv").runs[0]
    said = run.meta["command"]
    assert said["reference"] == {"walk": {"cadence": 2.0, "lift": 0.02}} and said["command"] == [0.2, 0.0, 0.0]
    assert {"forward_stride", "turn_trim", "forward"} <= said["fitted"].keys() and "lift" not in said["fitted"]
    goals = np.stack([joint.goal for joint in run.joints.values() if joint.goal is not None], axis=1)
    assert goals.shape == (50, 12) and np.ptp(goals, axis=0).max() > 0.2, "its legs swing"
    np.testing.assert_allclose(goals[:24], goals[25:49], atol=2e-2)  # twice in a second
    assert {"imu.w", "imu.turn_x", "switch.front_left", "switch.rear_right"} <= set(run.base)


def test_a_trajectory_of_track_leads_by_what_the_servos_are_late() -> None:
    robot = build_robot(compose("deploy", {"robot": "bench"}, readers=READERS)["robot"])
    reference = TaskReference("track", robot)
    assert isinstance(reference.task, TrackTask) and reference.task.lead is not None
    assert reference.task.lead > 0.02 and reference.rate == 50.0
    assert reference.pose["joint"] == pytest.approx(reference.start()[0])


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["reference=wlak"], r"no task 'wlak' .did you mean 'walk'"),
        (["reference=reach"], r"'reach' has no reference; walk and track have one"),
        (["reference=hexapod"], r"'hexapod' has a robot of its own"),
        (["reference=walk"], r"robot 'bench' has no free base, and cannot walk"),
        (["reference={track: {correctoin: 1}}"], r"'correctoin' .did you mean 'correction'"),
        (["reference=[walk]"], r"reference is \['walk'\]; it is a word such as walk"),
        (["reference=track", "command={knee: 1}"], r"names 'knee'; the task asks for joint"),
        (["reference=true", "robot=hopper", "command=[1]"], r"what a policy or a task's reference is asked for"),
    ],
)
def test_what_is_no_reference_is_refused_in_a_sentence(words: list[str], sentence: str) -> None:
    with pytest.raises(SealegsError, match=sentence):
        deploy.main([*words, *STEPPED])


# --- what is asked for ----------------------------------------------------------------------------------------------


SIMULATED = {"hw.virtual.time": "stepped", "live": False, "hw.timeout": 1, "silence": 20}
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
    settings = {**SIMULATED, **MACHINE, "duration": 2.0, "out": str(tmp_path / "logs"), **more}
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
