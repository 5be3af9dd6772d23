"""deploy.py: what runs is logged, what does not fit is refused by name, a dry run has no torque."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from sealegs.commands import deploy, loop
from sealegs.common.errors import SealegsError
from sealegs.configs.compose import compose, split
from sealegs.configs.script import run as run_script
from sealegs.envs.bench.robot import BENCH
from sealegs.envs.contract import Contract, ContractError
from sealegs.gap.checks.data_set import check_set, unusable
from sealegs.gap.experiment import library
from sealegs.gap.experiment.proposal import Experiment, write_experiment
from sealegs.gap.log import JointLog, MeasuredRun, read_measured, write_run
from sealegs.hw.machine.limits import Limits
from sealegs.hw.machine.robot import build_robot, unlike_the_factory, unlike_the_file
from sealegs.hw.run import deployment
from sealegs.hw.run.commands import read_excitation, read_replay
from sealegs.hw.run.measured_log import MeasuredLog, make_sidecar, read_events
from sealegs.hw.run.policy import Policy
from sealegs.hw.run.task_reference import library_excitation

from tests.servo_runs import PATIENT, config, excitation, gentle_policy

STEPPED = ["hw.virtual.time=stepped", *PATIENT, "silence=20"]


def run(*arguments: str) -> int:
    """Exit status of deploy.py in this process."""
    return run_script(deploy.main, "deploy", "", [*STEPPED, *arguments])


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return gentle_policy(tmp_path_factory.mktemp("policy") / "policy.onnx")


def test_a_policy_runs_and_its_log_says_everything(
    policy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(f"policy={policy}", f"out={tmp_path}", "name=run", "duration=2", "command=[0.4]") == 0
    assert "100 cycles, 0 overruns" in capsys.readouterr().out
    log = read_measured(tmp_path / "run.csv").runs[0]
    joint = log.joints["joint"]
    assert len(log.time) == 100 and np.diff(log.time) == pytest.approx(0.02, abs=3e-4)
    assert joint.goal is not None and np.abs(joint.goal).max() < 0.5, "an untrained policy moves little"
    assert log.robot == "bench" and log.actuators == {"joint": "sts3215"}
    assert log.meta["registers"]["joint"]["p_gain"] == 32 and log.meta["calibration"]["joint"]["zero"] == 2048
    assert log.meta["command"]["command"] == [0.4] and log.meta["rate"] == 50.0
    assert {"read_sent", "read_done", "goal_sent", "joint_status"} <= set(log.host)
    events = [event["event"] for event in read_events(tmp_path / "run.csv")]
    assert events == ["torque on", "started", "at rest", "end"]
    assert run(f"policy={policy}", f"out={tmp_path}", "name=run", "duration=2") == 2
    assert "never overwritten" in capsys.readouterr().err


def test_a_stepped_run_on_a_machine_that_stalls_is_the_same_and_nobody_guards_simulated_servos(
    policy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """``silence`` counted real time: under load the supervisor killed `evaluate`, with CUT THE POWER."""
    words = (f"policy={policy}", f"out={tmp_path}", "duration=0.6", "hw.virtual.time=stepped", "live=false")
    assert run_script(deploy.main, "deploy", "", [*words, "name=quick"]) == 0
    passed = [0.0]

    def stalled() -> float:
        passed[0] += 5.0  # whoever asks the host for the time is told that seconds have passed
        return passed[0]

    for module in ("bus.clock", "bus.port", "guard.supervisor", "run.loop"):
        clock = SimpleNamespace(monotonic=stalled, sleep=lambda _: None, process_time=lambda: 0.0)
        monkeypatch.setattr(f"sealegs.hw.{module}.time", clock)
    monkeypatch.setattr(deployment, "Supervisor", lambda _: pytest.fail("a supervisor counts real time"))
    assert run_script(deploy.main, "deploy", "", [*words, "name=slow"]) == 0
    quick, slow = (read_measured(tmp_path / f"{name}.csv").runs[0] for name in ("quick", "slow"))
    assert np.array_equal(quick.time, slow.time)
    assert np.array_equal(quick.joints["joint"].position, slow.joints["joint"].position)


def test_a_virtual_machine_that_becomes_unstable_in_stepped_time_is_named_and_no_power_is_to_be_cut(
    policy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sealegs.hw.virtual.machine._unstable", lambda data: data.time > 1.0)
    words = (f"policy={policy}", f"out={tmp_path}", "name=run", "hw.virtual.time=stepped", "live=false")
    assert run_script(deploy.main, "deploy", "", [*words, "duration=2"]) == 2
    said = capsys.readouterr().err
    assert "became unstable at 1.0" in said and "released" in said and "CUT THE POWER" not in said


@pytest.mark.long
def test_what_a_virtual_bus_did_does_not_lie_among_what_was_measured(
    policy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(f"policy={policy}", "name=run", "duration=0.2") == 0
    assert [str(file.relative_to(tmp_path)) for file in tmp_path.rglob("run.csv")] == ["logs/bench-virtual/run.csv"]


@pytest.mark.long
def test_what_a_diagnosis_proposes_is_run_and_can_be_diagnosed(tmp_path: Path) -> None:
    proposal = tmp_path / "next_experiment.csv"
    time = np.arange(0.0, 1.0, 0.01)
    goal = 0.2 + 0.3 * np.sin(6.0 * time)
    np.savetxt(proposal, np.stack([time, goal], axis=1), "%.6f", ",", header="time,servo.goal", comments="")
    proposal.with_suffix(".yaml").write_text("robot: bench\n")  # whose logs call the servo as they like
    assert run(f"excitation={proposal}", f"out={tmp_path / 'log'}", "name=next", "robot.params={mass:0.3}") == 0
    data = read_measured(tmp_path / "log")
    log = data.runs[0]
    assert (
        log.robot_params == {**BENCH.parameters({}), "mass": 0.3, "arm_mass": 0.03, "length": 0.12}
        and unusable(check_set(data), data) is None
    )
    assert log.joints["joint"].goal == pytest.approx(goal[: len(log.time)], abs=1e-5)
    assert len(log.time) == 100
    assert abs(log.joints["joint"].position[0] - 0.2) < 0.15, "it was brought to the start slowly before"


@pytest.mark.long
def test_an_experiment_for_another_load_says_which_to_mount(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    proposal = tmp_path / "next_experiment.csv"
    proposal.write_text("time,servo.goal\n0,0\n0.1,0.1\n")
    proposal.with_suffix(".yaml").write_text("robot: bench\nrobot_params: {mass: 0.8, length: 0.12}\n")
    assert run(f"excitation={proposal}", f"out={tmp_path / 'log'}", "name=next") == 2
    said = capsys.readouterr().err
    assert "another load (mass 0.8)" in said and "robot.params.mass=0.8" in said and said.count("\n") == 1
    assert run(f"excitation={proposal}", f"out={tmp_path / 'log'}", "name=next", "robot.params={mass: 0.8}") == 0


@pytest.mark.long
def test_an_arm_that_nobody_weighed_is_no_other_load(tmp_path: Path) -> None:
    proposal = tmp_path / "next_experiment.csv"
    proposal.write_text("time,servo.goal\n0,0\n0.1,0.1\n")
    proposal.with_suffix(".yaml").write_text("robot: bench\nrobot_params: {mass: 0.5, length: 0.12, arm_mass: 0.0}\n")
    assert run(f"excitation={proposal}", f"out={tmp_path / 'log'}", "name=next") == 0


@pytest.mark.long
def test_a_dry_run_prints_goals_and_leaves_no_log(
    policy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[Any] = []
    monkeypatch.setattr("sealegs.hw.bus.servo_bus.ServoBus.torque_on", lambda *a: told.append(a))
    monkeypatch.setattr("sealegs.hw.bus.servo_bus.ServoBus.write_goals", lambda *a: told.append(a))
    assert run(f"policy={policy}", f"out={tmp_path / 'none'}", "dry_run=true") == 0
    shown = capsys.readouterr().out.splitlines()
    assert "no torque" in shown[0] and len(shown) == 2 + deployment.DRY_CYCLES
    assert not told and not (tmp_path / "none").exists()


@pytest.mark.long
@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "say what to run"),
        (["excitation=chirp", "reference=true"], "excitation and reference cannot run at once"),
        (["excitation=chrip"], "did you mean 'chirp'?"),
        (["excitation=chirp", "reach=4"], "reach is 4 rad; joint joint has"),
        (["excitation=missing.csv"], "missing.csv cannot be read"),
        (["policy=missing.onnx"], "there is no policy missing.onnx"),
        (["policy=run"], "a run's policies are in its folders: run/final"),
        (["reference=true"], "has no reference controller"),
        (["excitation=chirp", "rest=relax"], "it may be release, hold or sit"),
        (["excitation=chirp", "rest=sit"], "rest=sit needs robot.park"),
        (["excitation=chirp", "estop=button"], "it may be key, or the number"),
        (["excitation=chirp", "estop=key", "dead_man=true"], "both need the keyboard"),
        (["excitation=chirp", "rate=0"], "rate"),
        (["excitation=chirp", "duration=-1"], "duration is -1"),
        (["excitation=chirp", "silence=0.001"], "at least three periods"),
        (["excitation=chirp", "silence=1e12"], "silence must be at most 60"),
        (["excitation=chirp", "patience=-1"], "patience must be at least 0"),
        (["excitation=chirp", "hw.timeout=-1"], "hw.timeout must be more than 0"),
        (["excitation=chirp", "hw.timeout=fast"], "hw.timeout takes a number, not 'fast'"),
        (["excitation=chirp", "hw.baudrate=fast"], "hw.baudrate takes a whole number, not 'fast'"),
        (["excitation=hold", "command=[1,2]"], "leave it out with excitation="),
        (["excitation=chirp", "hw=feetech", "port=/dev/null", "calibration=none.yaml"], "none.yaml cannot be read"),
        (["excitation=chirp", "hw=feetech"], "has no calibration yet"),
        (["excitation=chirp", "robot=benhc"], "did you mean 'bench'?"),
        (["excitation=chirp", "robot.safety.speed=null"], "safety.speed takes a number"),
        (["excitation=chirp", "actuator=sts3251"], "did you mean 'sts3250'?"),
        (["excitation=chirp", "robot.params={masss:1}"], "did you mean 'mass'?"),
        (["excitation=chirp", "port=/dev/null"], "hw=virtual starts a bus of its own"),
        (["exitation=chirp"], "did you mean 'excitation'?"),
    ],
)
def test_wrong_input_is_one_sentence(
    arguments: list[str], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)  # where no calibration is
    (tmp_path / "run" / "final").mkdir(parents=True)
    assert run_script(deploy.main, "deploy", "", [*arguments, f"out={tmp_path}"]) == 2
    error = capsys.readouterr().err.strip()
    assert says in error and len(error.splitlines()) == 1 and not list(tmp_path.glob("*.csv"))


def changed(contract: Contract, **values: Any) -> Contract:
    return dataclasses.replace(contract, **values)


@pytest.mark.long
@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("robot", "hopper", "give robot=hopper"),
        ("joints", ("elbow",), "elbow"),
        ("robot_hash", "0" * 16, "the robot's numbers differ"),
        ("observation_names", ("target [rad]", "height [m]"), "train it again"),
        ("chain_hash", "0" * 16, "actuator=<name or path>"),
    ],
)
def test_a_policy_for_another_robot_is_refused_by_the_field(field: str, value: Any, says: str, policy: Path) -> None:
    robot = build_robot(config()["robot"])
    contract = Policy(policy).contract
    robot.check_contract(contract)
    with pytest.raises(ContractError) as refusal:
        robot.check_contract(changed(contract, **{field: value}))
    assert f"'{field}'" in str(refusal.value) and says in str(refusal.value)


@pytest.mark.long
def test_a_policy_at_another_rate_or_for_a_heavier_load_is_refused(policy: Path) -> None:
    contract = Policy(policy).contract
    with pytest.raises(ContractError, match="'control_rate' is 50 Hz, and here it is 100 Hz"):
        build_robot(config()["robot"]).check_contract(contract, 100.0)
    with pytest.raises(ContractError, match=r"mass 0\.5 and 0\.7"):
        build_robot(config("robot.params={mass:0.7}")["robot"]).check_contract(contract)
    other = build_robot(config()["robot"], "xl330")
    with pytest.raises(ContractError, match=r"'chain_hash'\): it was trained with \w+, and here it is xl330; say"):
        other.check_contract(contract)
    contract = changed(contract, goal_low=(8.9,), goal_high=(9.1,))
    with pytest.raises(ContractError, match=r"'goal_low' is 8\.9 rad for joint, up to 9\.1 rad"):
        build_robot(config()["robot"]).check_contract(contract)


@pytest.mark.long
@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("time,joint.goal\n0,0\n0.1,9\n", "row 3 asks joint joint for 9.000 rad"),
        ("time,joint.goal\n0,0\n0,0.1\n", "must grow"),
        ("time,aim\n0,0\n0.1,0\n", "needs the columns time and <joint>.goal"),
        ("time,wrist_roll.goal\n0,0\n0.1,0\n", "the robot has no joint 'wrist_roll'; it has joint"),
        ("time,joint.goal\n0,x\n", "no table of numbers"),
        ("", "no table of numbers"),
        ("time,joint.goal,\n0,0.1\n0.1,0.1\n", "3 columns in its header and 2 in its rows"),
        ("time,joint.goal\n0,0.1,\n0.1,0.1,\n", "no table of numbers"),
        ("time,joint.goal\n0,0.1,5\n0.1,0.1,5\n", "2 columns in its header and 3 in its rows"),
        ("time,joint.goal, joint.goal\n0,0.1,0.3\n0.1,0.1,0.3\n", "two columns 'joint.goal'"),
        ("time,a.goal,b.goal\n0,0,0\n0.1,0,0\n", "the robot has no joint 'a'"),
        ("time,joint.goal\n0,0\n0.1,nan\n", "row 3"),
    ],
)
def test_an_excitation_that_cannot_be_run_is_refused(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "goals.csv"
    path.write_text(text)
    with pytest.raises(SealegsError) as refusal:
        read_excitation(path, build_robot(config()["robot"]))
    assert says in str(refusal.value)


def test_goals_without_a_joint_are_those_of_the_only_one(tmp_path: Path) -> None:
    (tmp_path / "goals.csv").write_text("time,goal\n0,0.1\n0.1,0.2\n")
    reading: Any = None
    commands = read_excitation(tmp_path / "goals.csv", build_robot(config()["robot"]))
    assert commands.goals(0.1, reading) == pytest.approx(0.2)
    with pytest.raises(SealegsError, match=r"needs the columns time and <joint>\.goal"):
        read_excitation(tmp_path / "goals.csv", build_robot(config("robot=hopper")["robot"]))


def test_an_excitation_of_another_robot_is_refused(tmp_path: Path) -> None:
    """The goals of an arm's wrist were sent to the servo on the bench: metal moved that was not meant."""
    goals = excitation(tmp_path / "next_experiment.csv", "wrist_roll")
    for ending in (".yaml", ".yml"):
        beside = goals.with_suffix(ending)
        beside.write_text("robot: so101.yaml\n")
        with pytest.raises(SealegsError, match=r"goals are of robot 'so101\.yaml', not of 'bench': give robot=so101"):
            read_excitation(goals, build_robot(config()["robot"]))
        beside.unlink()


def test_goals_are_held_until_the_next_and_a_log_is_replayed_with_its_own(tmp_path: Path) -> None:
    robot = build_robot(config()["robot"])
    commands = read_excitation(excitation(tmp_path / "sine.csv", seconds=2.0), robot)
    reading: Any = None
    assert commands.duration == pytest.approx(2.0)
    assert commands.goals(0.039, reading) == commands.goals(0.02, reading) != commands.goals(0.04, reading)
    time = 5.0 + np.arange(50) / 50.0
    wanted = 0.1 * np.sin(time)
    log = JointLog(goal=wanted, position=np.zeros(50))
    path = write_run(MeasuredRun("run", time, {"joint": log}, actuators={"joint": "sts3215"}), tmp_path)
    assert read_replay(path, robot).goals(0.5, reading) == pytest.approx(wanted[25])
    turned = MeasuredRun(
        "degrees", time, {"joint": JointLog(np.degrees(wanted), np.zeros(50))}, actuators={"joint": "sts3215"},
        meta={"units": {"goal": "deg", "position": "deg"}},
    )  # fmt: skip
    held = read_replay(write_run(turned, tmp_path), robot).goals(0.5, reading)
    assert held == pytest.approx(wanted[25], abs=1e-6), "goals in degrees were sent as radians"
    other = MeasuredRun("other", time, {"hip": log}, robot="hopper", actuators={"hip": "sts3215"})
    with pytest.raises(SealegsError, match="log of robot 'hopper', not of 'bench'"):
        read_replay(write_run(other, tmp_path), robot)


def test_goals_of_another_frame_are_turned_into_the_models(tmp_path: Path) -> None:
    """An experiment that was proposed from a log with another zero was sent as it stood: to another pose."""
    robot, time = build_robot(config()["robot"]), np.arange(50) / 50.0
    reading: Any = None
    wanted = 0.2 * np.sin(6.0 * time)
    experiment = Experiment("sine", "Move it.", 1.0, time, 0.7 - wanted, {})
    frame = {"zero": 0.7, "direction": -1}
    files = write_experiment(experiment, "joint", tmp_path, "sts3215", frame=frame)
    assert read_excitation(files["experiment"], robot).goals(0.5, reading) == pytest.approx(wanted[25], abs=1e-5)
    log = JointLog(goal=0.7 - wanted, position=np.full(50, 0.7))
    run = MeasuredRun("run", time, {"joint": log}, actuators={"joint": "sts3215"}, meta={"frames": {"joint": frame}})
    assert read_replay(write_run(run, tmp_path), robot).goals(0.5, reading) == pytest.approx(wanted[25], abs=1e-5)


def test_servos_that_were_set_up_otherwise_are_named() -> None:
    servo = build_robot(config()["robot"]).servo
    factory = {name: servo[name].default for name in servo.moves}
    assert unlike_the_factory({"hip": factory}, servo) == []
    (line,) = unlike_the_factory({"hip": factory, "knee": {**factory, "p_gain": 16}}, servo)
    assert "knee" in line and "p_gain 16 (32)" in line


def test_the_command_that_sets_a_servo_as_the_robots_file_says_can_be_typed() -> None:
    robot = build_robot(config("robot=hopper")["robot"])
    rows = {joint.name: dict(robot.registers) for joint in robot.joints}
    assert unlike_the_file(rows, robot, {"": "/dev/ttyUSB0"}) == []
    rows["knee"]["overload_torque"] = 80
    (line,) = unlike_the_file(rows, robot, {"": "/dev/ttyUSB0"})
    assert (
        "overload_torque 80 (100); sealegs scan port=/dev/ttyUSB0 servo=sts3215 id=2 set=overload_torque:100 " in line
    )


# --- the whole loop ------------------------------------------------------------------------------------------------


def test_the_loop_goes_on_with_what_is_done_and_puts_unfinished_logs_aside(tmp_path: Path) -> None:
    sidecar = make_sidecar("bench", {}, {"joint": "sts3215"}, {})
    for name, ending in (("whole", "finished"), ("torn", None)):
        log = MeasuredLog(tmp_path / "log", name, sidecar, ["joint"], ())
        log.write(0.0, np.zeros((1, 7)), (), (0.0, 0.0, 0.0), [0])
        if ending:
            log.event(0.0, "end", ending=ending)
        log.close()
    assert loop.complete(tmp_path, "whole") and not loop.complete(tmp_path, "torn")
    assert not loop.complete(tmp_path, "never begun")
    assert {path.suffix for path in (tmp_path / "unfinished").iterdir()} == {".csv", ".yaml", ".jsonl"}
    assert {path.name for path in (tmp_path / "log").glob("*.csv")} == {"whole.csv"}


@pytest.mark.parametrize("robot", ["bench", "hexapod"])
def test_the_loop_gives_its_steps_the_safety_limits_that_it_was_given(robot: str, tmp_path: Path) -> None:
    """It ended at its first step, with 'safety.goal_speed takes a number or null, not None'."""
    asked = {"robot": robot, "robot.safety.log_only": "[following]"}
    settings = compose("loop", asked)
    arguments = loop.machine_arguments(settings, asked, tmp_path)
    given = compose("deploy", split(arguments, deploy.PLAIN))["robot"]["safety"]
    assert given == settings["robot"]["safety"] and given["log_only"] == ["following"]
    Limits.from_config(given)


def test_the_loop_needs_a_person_where_loads_change(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def closed(_: str) -> str:
        raise EOFError

    monkeypatch.setattr("builtins.input", closed)
    settings = {"loads": [{"mass": 0.3}], "excitations": ["chirp"], "hw": {"virtual": None}}
    with pytest.raises(SealegsError, match="there is no terminal"):
        loop.measure(settings, tmp_path, [], 0)


def test_the_loop_refuses_to_go_on_with_other_settings(tmp_path: Path) -> None:
    loop.keep(tmp_path / "loop.yaml", {"seed": 0, "reach": 0.9})
    loop.keep(tmp_path / "loop.yaml", {"seed": 0, "reach": 0.9})
    with pytest.raises(SealegsError, match=r"begun with reach=0\.9"):
        loop.keep(tmp_path / "loop.yaml", {"seed": 0, "reach": 0.5})
    assert yaml.safe_load((tmp_path / "loop.yaml").read_text()) == {"seed": 0, "reach": 0.9}


@pytest.mark.parametrize("word", ["multisine", "steps", "fast_steps"])
def test_no_joint_repeats_under_a_neighbouring_seed_what_another_does(word: str) -> None:
    robot = build_robot(compose("deploy", {"robot": "hopper"})["robot"])
    middles = [0.5 * (joint.low + joint.high) for joint in robot.joints]
    motions = [
        column - middle
        for seed in range(3)
        for column, middle in zip(library_excitation(word, robot, 0.3, seed)._goals.T, middles, strict=True)
    ]
    for k, one in enumerate(motions):
        assert not any(np.allclose(one, other) for other in motions[:k])
    first = library(0.0, 0.3, 2)[word.replace("_", " ")]
    assert motions[4] == pytest.approx(first), "the first joint moves as on a bench with that seed"
