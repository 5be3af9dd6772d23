"""A robot of one's own through the commands: its YAML is written, its machine driven and logged, whatever its names."""

from __future__ import annotations

import html
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from sealegs.commands import cli, deploy, new_robot, relevant
from sealegs.common.errors import SealegsError
from sealegs.configs.compose import compose
from sealegs.envs.contract import make_contract
from sealegs.envs.described.as_robot import as_robot
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.gap.log import read_measured
from sealegs.hw.machine.calibration import write_calibration
from sealegs.hw.machine.limits import Limits
from sealegs.hw.machine.own_robot import READERS
from sealegs.hw.machine.robot import ServoRobot, build_robot
from sealegs.hw.run import deployment
from sealegs.hw.run.connection import opened_bus, opened_port
from sealegs.hw.run.measured_log import read_events
from sealegs.hw.virtual.machine import Machine

from tests.servo_runs import PATIENT, gentle_policy

ROBOTS = Path(__file__).parents[1] / "robots"


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    (tmp_path / "arm.xml").write_text((ROBOTS / "arm.xml").read_text())
    return tmp_path / "arm.xml"


@pytest.mark.long
def test_new_robot_writes_what_a_bare_model_means_and_never_over_a_file(arm: Path, capsys) -> None:
    new_robot.main([str(arm)])
    said = capsys.readouterr().out
    assert "an ideal servo of 12 N.m/rad drives it" in said
    written, bare = load_robot_file(arm.with_suffix(".yaml")), load_robot_file(arm)
    assert written.said == ()
    for ours, theirs in zip(written.joints, bare.joints, strict=True):
        assert ours.chain.to_list() == theirs.chain.to_list()
        assert (ours.range, ours.owners, ours.start) == (theirs.range, theirs.owners, theirs.start)
    assert written.digest == bare.digest
    with pytest.raises(SealegsError, match=r"arm\.yaml exists, and is not overwritten; give another out="):
        new_robot.main([str(arm)])


def test_new_robot_says_that_a_chain_of_hinges_counts_otherwise_at_slides(tmp_path: Path, capsys) -> None:
    """The rail of a gantry got a servo's gain as N per metre, and nobody said so."""
    for kind, said in (("hinge", True), ("slide", False)):
        model = tmp_path / f"{kind}.xml"
        arm = f'<body><joint name="arm" type="{kind}" axis="0 1 0"/><geom size="0.1" mass="1"/></body>'
        rail = f'<body><joint name="rail" type="slide" axis="1 0 0"/><geom size="0.1" mass="1"/>{arm}</body>'
        model.write_text(f"<mujoco><worldbody>{rail}</worldbody></mujoco>")
        new_robot.main([str(model), "chain=sts3215"])
        assert ("a joint is a slide (rail), numbers of 'sts3215' count as N and m" in capsys.readouterr().out) == said


def test_new_robot_takes_a_chain_for_all_joints_and_says_whose_numbers_it_leaves_out(arm: Path, capsys) -> None:
    new_robot.main([str(arm), "chain=sts3215", f"out={arm.parent / 'robots' / 'mine.yaml'}"])
    assert "the chain's counts (armature: chain), the other is left out" in capsys.readouterr().out
    robot = load_robot_file(arm.parent / "robots" / "mine.yaml")
    assert robot.name == "mine" and set(robot.joint("elbow").owners.values()) == {"chain"}
    with pytest.raises(SealegsError, match=r"there is no key 'chian' \(did you mean 'chain'\?\)"):
        new_robot.main([str(arm), "chian=sts3215"])


def test_an_excitation_runs_on_the_robot_that_lies_beside_it(
    arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As documented, without robot=, the experiment of an arm ran on the servo of the bench."""
    new_robot.main([str(arm), "chain=sts3215"])
    goals = tmp_path / "a diagnosis" / "next_experiment.csv"
    goals.parent.mkdir()
    goals.write_text("time,elbow.goal\n0,0\n0.1,0.1\n")
    goals.with_suffix(".yaml").write_text("robot: ../arm.yaml\nactuators: {elbow: sts3215}\n")
    ran: list[deployment.Deployment] = []
    monkeypatch.setattr(deployment, "run", ran.append)
    deploy.main([f"excitation={goals}"])
    assert ran[0].robot.names == ["shoulder", "elbow"] and "arm.yaml" in capsys.readouterr().out
    deploy.main([f"excitation={goals}", f"robot={arm.with_suffix('.yaml')}"])
    with pytest.raises(SealegsError, match=r"not of 'bench': give robot=.*arm\.yaml"):
        deploy.main([f"excitation={goals}", "robot=bench"])


def config(*arguments: str, **keys: str) -> dict:
    pairs = {key: str(value) for key, value in keys.items()}
    pairs |= dict(argument.split("=", 1) for argument in arguments)
    return compose("deploy", pairs, readers=READERS)


def test_servos_are_mounted_as_the_file_says(arm: Path) -> None:
    path = arm.with_suffix(".yaml")
    path.write_text(
        "model: arm.xml\njoints:\n  shoulder: {chain: sts3215, servo: {id: 7, zero: 1900, direction: -1}}\n"
        "  elbow: {chain: xl330}\ndeploy: {safety: {current: 1.5}}\n"
    )
    chosen = config(robot=str(path))
    assert chosen["robot"]["safety"]["current"] == 1.5 and chosen["robot"]["safety"]["temperature"] == 65.0
    shoulder, elbow = build_robot(chosen["robot"]).joints
    assert (shoulder.id, shoulder.zero, shoulder.direction) == (7, 1900, -1)
    assert (elbow.id, elbow.zero, elbow.direction) == (2, 2048, 1)
    assert (shoulder.low, shoulder.high) == (-1.5, 1.5)
    path.write_text("model: arm.xml\njoints: {elbow: {chain: sts3215}}\ndeploy: {safty: {}}\n")
    with pytest.raises(SealegsError, match=r"deploy.safty is unknown \(did you mean 'safety'\?\)"):
        config(robot=str(path))


@pytest.mark.long
def test_no_servo_is_sent_torques(arm: Path) -> None:
    """An excitation moved the virtual machine by its angles as N.m; a servo would have turned by torques as rad."""
    path, goals = arm.with_suffix(".yaml"), arm.parent / "goals.csv"
    path.write_text("model: arm.xml\njoints: {elbow: {chain: [{torque_command: {}}]}}\n")
    goals.write_text("time,elbow.goal\n0.0,0.1\n1.0,0.2\n")
    says = r"the chain of joint 'elbow' takes a torque \[N\.m\] .*, and a servo takes position goals; name a chain"
    for given in ("excitation=multisine", f"excitation={goals}"):
        with pytest.raises(SealegsError, match=says):
            deploy.main([given, f"robot={path}"])
    with pytest.raises(SealegsError, match=says):
        Machine(as_robot(load_robot_file(path)))
    servo = build_robot(config(robot=str(path))["robot"], "sts3215")
    chains = {name: chain.to_list() for name, chain in servo.chains.items()}
    contract = make_contract({"id": "SeaLegs/Track-v0", "robot": str(path)}, chains, 50.0)
    servo.check_contract(contract)
    with pytest.raises(SealegsError, match="trained with torques as commands of elbow, which a servo would take for"):
        servo.check_contract(replace(contract, chains={"elbow": [{"torque_command": {}}]}))


def test_a_robot_of_ones_own_finds_the_calibration_that_was_made_for_it(
    arm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(arm.parent)
    new_robot.main([str(arm), "chain=sts3215"])
    chosen = config(robot="arm.yaml", hw="feetech", port="/dev/ttyUSB0")
    with pytest.raises(SealegsError, match=r"has no calibration yet: make one with sealegs calibrate robot="):
        deployment.calibration_of(chosen)
    robot = build_robot(chosen["robot"])
    path = Path("calibrations/arm-20260101-000000.yaml")  # as `sealegs calibrate robot=arm.yaml` calls it
    write_calibration(path, robot.robot, robot.servo, robot.joints)
    assert deployment.calibration_of(chosen) == path
    assert build_robot(chosen["robot"], None, path).joints == robot.joints


@pytest.mark.long
def test_its_virtual_machine_is_its_own_model_with_its_chains_and_the_log_names_it(arm: Path) -> None:
    new_robot.main([str(arm), "chain=sts3215"])
    chosen = config(
        "hw.virtual.time=stepped", robot=str(arm.with_suffix(".yaml")), excitation="multisine", duration="1.5",
        live="false", out=str(arm.parent / "logs"), name="run",
    )  # fmt: skip
    done = deployment.run(deployment.prepare(chosen), lambda _: None)
    assert done is not None and done.outcome.fault is None
    sidecar = yaml.safe_load((arm.parent / "logs" / "run.yaml").read_text())
    assert sidecar["robot"] == "../arm.yaml"
    run = read_measured(done.log).runs[0]
    assert list(run.joints) == ["shoulder", "elbow"]
    goal, position = run.joints["elbow"].goal, run.joints["elbow"].position
    assert goal is not None and position is not None
    assert np.abs(position - goal)[50:].max() < 0.4 and np.ptp(position) > 0.5


@pytest.mark.long
def test_twenty_lines_of_yaml_take_an_arm_from_its_model_over_a_log_to_a_verdict_and_a_tracking_policy(
    arm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(arm.parent)
    text = (ROBOTS / "arm.yaml").read_text()
    assert text.count("\n") <= 20
    Path("arm.yaml").write_text(text)
    Path("hidden.yaml").write_text("elbow: {friction.coulomb: 0.2}\n")
    stepped = ["hw.virtual.time=stepped", "hw.timeout=1", "silence=20", "live=false"]
    machine = ["robot=arm.yaml", "hw.virtual.hidden=hidden.yaml", *stepped]
    for number, word in enumerate(("multisine", "steps", "slow_triangle", "multisine")):
        run = [f"excitation={word}", "duration=8", f"seed={number}", "out=logs", f"name={word}{number}"]
        assert cli.main(["deploy", *machine, *run]) == 0
    assert cli.main(["diagnose", "log=logs", "out=found", "causes=[friction.coulomb,drive.delay]"]) == 0
    verdicts = {joint["joint"]: joint for joint in json.loads(Path("found/diagnosis.json").read_text())["joints"]}
    assert verdicts["elbow"]["causes"][0]["name"] == "friction.coulomb"
    assert verdicts["shoulder"]["causes"] == [], "nothing is hidden there"
    short = ["total_timesteps=60000", "evaluate.every=0", "video.seconds=0", "seed=1"]
    assert cli.main(["train", "robot=arm.yaml", "extended=found", "name=policy", *short]) == 0
    compared = ["policy=runs/policy/final", "extended=found", "seconds=5", "out=compared"]
    assert cli.main(["evaluate", *machine, *compared]) == 0
    figures = json.loads(Path("compared/comparison.json").read_text())["figures"]
    assert figures["extended"]["same_goals"] < figures["nominal"]["same_goals"]
    assert figures["machine"]["reward"] > 20.0  # of 50 a second; standing still at mid-range earns less than 10


LIFT = """<mujoco><compiler angle="radian" autolimits="true"/><worldbody><body name="cart" pos="0 0 0.5">
<joint name="rail" type="slide" axis="1 0 0" range="-0.3 0.3"/><geom size="0.05" mass="1"/>
<body name="arm"><joint name="shoulder" axis="0 1 0" range="-0.6 0.6"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.01" mass="0.2" contype="0" conaffinity="0"/></body>
</body></worldbody>
<actuator><position joint="rail" kp="800" kv="60"/><position joint="shoulder" kp="10" kv="0.3"/></actuator></mujoco>"""


@pytest.mark.long
@pytest.mark.parametrize("word", ["lift.xml", "lift.yaml"])
def test_a_robot_with_a_slide_can_be_deployed_as_new_robot_writes_it_and_as_its_model_stands(
    word: str, tmp_path: Path
) -> None:
    (tmp_path / "lift.xml").write_text(LIFT)
    new_robot.main([str(tmp_path / "lift.xml")])
    assert "range_margin: {rail: 0.012, '*': 0.15}" in (tmp_path / "lift.yaml").read_text()
    given = {"robot": str(tmp_path / word), "excitation": "multisine", "out": str(tmp_path / "logs"), "name": "run"}
    found = deployment.prepare(config("hw.virtual.time=stepped", **given))
    standing: Any = None  # a trajectory reads nothing
    goals = [found.commands.goals(time, standing)[0] for time in np.arange(0.0, found.commands.duration, 0.02)]
    assert 0.1 < np.ptp(goals) / 2.0 <= 0.24 + 1e-9
    with pytest.raises(SealegsError, match=r"reach is 0.7 rad; joint shoulder has 0.60 rad to either side"):
        deployment.prepare(config("reach=0.7", **given))
    wrong = {**given, "robot.safety.range_margin": "0.1", "robot.safety.speed": "9"}
    with pytest.raises(
        SealegsError,
        match=r"range_margin is 0.1 rad, safety.speed is 9 rad/s, but joint rail is in m; .*"
        r"'robot.safety.range_margin=.\"rail\": 0.005, \"\*\": 0.1.' 'robot.safety.speed=.\"rail\": 0.5, ",
    ):
        deployment.prepare(config(**wrong))


@pytest.mark.long
def test_relevant_dynamics_of_a_robot_of_ones_own(tmp_path: Path, capsys) -> None:
    (tmp_path / "lift.xml").write_text(LIFT)
    model = str(tmp_path / "lift.xml")
    relevant.main([f"robot={model}", "tempos=[1.0]", "seconds=1", f"out={tmp_path / 'found'}"])
    assert "rail" in capsys.readouterr().out
    assert json.loads((tmp_path / "found" / "relevant.json").read_text())["robot"] == model


@pytest.mark.long
def test_a_robot_that_leans_on_the_way_to_the_start_leaves_its_way_and_is_told_of_a_stand(tmp_path: Path) -> None:
    floating = LIFT.replace('kp="800" kv="60"', 'kp="20" kv="0.5"').replace(
        "<joint name", "<freejoint/><geom size='0.01'/><body><joint name", 1
    )
    (tmp_path / "lift.xml").write_text(floating.replace("</worldbody>", "</body></worldbody>"))
    new_robot.main([str(tmp_path / "lift.xml")])
    given = {"robot": str(tmp_path / "lift.yaml"), "excitation": "steps", "out": str(tmp_path / "logs"), "name": "run"}
    prepared = deployment.prepare(
        config("hw.virtual.time=stepped", "live=false", 'robot.safety.speed={"*": 0.0001}', **given)
    )
    done = deployment.run(prepared, lambda _: None)
    assert done is not None and done.outcome.fault is not None
    said = (
        r"on the way to the start.*what happened until then is in .*run\.events\.jsonl.*"
        r"`base: fixed` in its YAML puts it on a stand"
    )
    with pytest.raises(SealegsError, match=said):
        deployment.report(prepared, done, lambda _: None)
    events = [event for event in read_events(done.log) if event["event"] == "approach"]
    assert events[0]["joints"] == ["rail", "shoulder"] and len(events[0]["rows"][0]) == 5


SIGNS = ("left/hip", "gelenk_ä", "a: b", "a,b", "j[0]", "(a)", "it's", "~", "8", "null")
"""Names of model files; those of prefixed models have slashes."""
STEPPED = ["hw.virtual.time=stepped", "live=false", "silence=20", *PATIENT]


def robot_file(folder: Path, driven: tuple[str, ...], free: tuple[str, ...] = (), name: str = "dog") -> Path:
    """The YAML that new-robot writes of a model with joints of these names, side by side."""
    folder.mkdir(parents=True, exist_ok=True)
    bodies = "".join(
        f'<body pos="0 {0.2 * k:g} 1"><joint name="{html.escape(joint)}" axis="0 1 0" range="-1 1" damping="0.01"/>'
        '<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="0.3"/></body>'
        for k, joint in enumerate((*driven, *free))
    )
    actuators = "".join(
        f'<position joint="{html.escape(joint)}" kp="20" kv="0.4" forcerange="-5 5"/>' for joint in driven
    )
    (folder / f"{name}.xml").write_text(
        f'<mujoco><compiler angle="radian"/><worldbody>{bodies}</worldbody><actuator>{actuators}</actuator></mujoco>',
        encoding="utf-8",
    )
    new_robot.main([str(folder / f"{name}.xml")])
    return folder / f"{name}.yaml"


def rename(robot: Path, joint: str, name: str) -> None:
    """As new-robot says of a name that something cannot take."""
    robot.write_text(robot.read_text().replace(f"  {joint}:   # hinge", f"  {name}:\n    joint: {joint}   # hinge"))


def composed(robot: Path, **keys: str) -> dict:
    return compose("deploy", {"robot": str(robot), "hw.virtual.time": "stepped", **keys}, readers=READERS)


@pytest.mark.long
def test_a_virtual_machine_stands_in_its_pose_whatever_signs_are_in_the_names_of_joints_and_folders(
    tmp_path: Path,
) -> None:
    """A policy was refused for `pose={left/hip:0.0,...} cannot be read`, which nobody had typed."""
    config = composed(robot_file(tmp_path / "a, b (ü)", SIGNS, tuple(f"free {name}" for name in SIGNS)))
    robot = build_robot(config["robot"])
    places = np.linspace(-0.4, 0.5, len(SIGNS))
    pose = dict(zip(SIGNS, places.tolist(), strict=True)) | {f"free {name}": 0.1 for name in SIGNS}
    with opened_port(config["hw"], None, robot, None, pose=pose) as opened:
        bus = opened_bus(config["hw"], opened.within or opened.ports, robot, 0.01)
        position = robot.reading(bus.read_state(robot.all_ids)).position
        bus.close()
    assert position == pytest.approx(places, abs=2e-3)


def test_a_list_may_be_given_as_json_whose_words_have_any_sign() -> None:
    """Stages of a chain, as a virtual machine is told them, may name a file in any folder."""
    stages = [{"net": {"file": "/my, nets (ü)/net.yaml"}}]
    assert compose("virtual", {"actuator": json.dumps(stages)})["actuator"] == stages
    assert compose("virtual", {"actuator": "[{net: {file: net.yaml}}]"})["actuator"] == [{"net": {"file": "net.yaml"}}]


@pytest.mark.long
def test_a_policy_runs_on_a_robot_whose_model_has_signs_in_its_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Renamed as new-robot said, its excitations ran and its policies did not."""
    robot = robot_file(tmp_path, SIGNS[:3], ("free,joint",))
    rename(robot, "left/hip", "left_hip")
    rename(robot, "gelenk_ä", "gelenk")
    policy = gentle_policy(tmp_path / "policy.onnx", "SeaLegs/Track-v0", robot=str(robot))
    monkeypatch.chdir(tmp_path)
    given = [f"policy={policy}", "robot=dog.yaml", "duration=1", "out=logs", "name=run"]
    assert cli.main(["deploy", *given, *STEPPED]) == 0
    assert (tmp_path / "logs" / "run.csv").is_file()


def limits(robot: Path) -> tuple[ServoRobot, np.ndarray]:
    config = composed(robot)["robot"]
    servos = build_robot(config)
    return servos, np.stack(
        [Limits.from_config(config["safety"]).by_joint(k, servos) for k in ("speed", "range_margin")]
    )


@pytest.mark.long
def test_a_joint_that_got_another_name_keeps_the_limits_that_were_written_under_the_old_one(tmp_path: Path) -> None:
    """Renamed as new-robot said, the next command ended with `safety.speed.left/hip fits no joint`."""
    robot = robot_file(tmp_path, ("left/hip", "knee"))
    before = limits(robot)[1]
    assert "left/hip: " in robot.read_text().partition("safety:")[2], "new-robot wrote a limit under the model's name"
    rename(robot, "left/hip", "left_hip")
    servos, after = limits(robot)
    assert servos.names == ["left_hip", "knee"] and np.array_equal(before, after)
    prepared = deployment.prepare(composed(robot, reach='{"left/hip": 0.1}', excitation="steps"))
    assert prepared.commands.description["reach"]["left_hip"] == 0.1, "new-robot may have named a reach too"


@pytest.mark.long
def test_a_name_of_a_joint_counts_before_what_the_model_calls_another(tmp_path: Path) -> None:
    """Left and right were swapped in the model, and the file of the robot swaps them back."""
    robot = robot_file(tmp_path, ("left", "right"))
    head, _, deployed = robot.read_text().partition("deploy:")
    swapped = head.replace("  left:", "  RIGHT:\n    joint: left").replace("  right:", "  left:\n    joint: right")
    swapped = swapped.replace("RIGHT:", "right:") + "deploy:" + deployed.partition("  safety:")[0]
    robot.write_text(swapped + "  safety: {speed: {left: 3.0, right: 5.0}, range_margin: 0.1}\n")
    servos, found = limits(robot)
    assert dict(zip(servos.names, found[0], strict=True)) == {"left": 3.0, "right": 5.0}


@pytest.mark.long
def test_new_robot_says_where_else_a_belt_must_be_renamed_of_which_the_model_has_no_joint(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = robot_file(tmp_path, ("a", "b")).with_name("dog.xml")
    belt = '<tendon><fixed name="left/belt"><joint joint="a" coef="1"/><joint joint="b" coef="0.5"/></fixed></tendon>'
    head = model.read_text().partition("<actuator>")[0]
    model.write_text(f'{head}{belt}<actuator><position tendon="left/belt" kp="20" kv="1"/></actuator></mujoco>')
    new_robot.main([str(model), f"out={tmp_path / 'belt.yaml'}"])
    assert "give it another name here, such as left_belt, and under deploy: safety as well." in capsys.readouterr().out


@pytest.mark.long
def test_a_joint_whose_name_looks_like_a_pattern_is_meant_by_its_name(tmp_path: Path) -> None:
    """`safety.speed.j[0] fits no joint; there are j[0]`, of a file that new-robot had just written."""
    robot = robot_file(tmp_path, ("j[0]", "j[1]"))
    assert limits(robot)[0].names == ["j[0]", "j[1]"]
    head = robot.read_text().partition("  safety:")[0]
    robot.write_text(head + "  safety: {speed: {'j[1]': 3.0, 'j[[]0]': 4.0}, range_margin: 0.1}\n")
    assert limits(robot)[1][0].tolist() == [4.0, 3.0]


@pytest.mark.long
def test_an_own_robot_that_is_called_hopper_has_no_reference_controller(tmp_path: Path) -> None:
    robot = robot_file(tmp_path, ("hip", "knee"), name="hopper")
    with pytest.raises(SealegsError, match=r"hopper\.yaml' has no reference controller; robot=hopper has one"):
        deploy.main(["reference=true", f"robot={robot}", *STEPPED])


@pytest.mark.long
def test_the_log_of_an_own_robot_that_is_called_bench_holds_no_numbers_as_its_load(tmp_path: Path) -> None:
    """All its numbers stood in the sidecar as what somebody had said of its load."""
    robot = robot_file(tmp_path, ("hip",), name="bench")
    given = ["excitation=steps", "duration=0.5", f"out={tmp_path / 'logs'}", "name=run"]
    deploy.main([f"robot={robot}", *given, *STEPPED])
    sidecar = yaml.safe_load((tmp_path / "logs" / "run.yaml").read_text())
    assert sidecar["robot"] == "../bench.yaml" and not sidecar.get("robot_params")


@pytest.mark.long
def test_a_dry_run_names_the_unit_of_each_joint(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Goals of slides stood under [rad]."""
    robot = robot_file(tmp_path, ("rail", "arm"), name="lift")
    model = tmp_path / "lift.xml"
    model.write_text(model.read_text().replace('name="rail" axis="0 1 0"', 'name="rail" type="slide" axis="1 0 0"'))
    robot.unlink()
    new_robot.main([str(model)])
    capsys.readouterr()
    deploy.main([f"robot={robot}", "excitation=steps", "dry_run=true", *STEPPED])
    head = capsys.readouterr().out.splitlines()[1]
    assert head.split() == ["time", "[s]", "rail", "[m]", "arm", "[rad]"]


def test_a_robot_of_ours_that_files_alone_describe_is_known_by_its_name() -> None:
    config = compose("deploy", {"robot": "quadruped"}, readers=READERS)["robot"]
    assert config["name"].endswith("quadruped.yaml") and config["imu"]["site"] == "imu"
    with pytest.raises(SealegsError, match=r"robot=quadrupd is not known .did you mean 'quadruped'"):
        compose("deploy", {"robot": "quadrupd"}, readers=READERS)
