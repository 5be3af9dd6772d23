"""Names of an own robot and of its joints that mean something to a command line, a pattern or this project."""

from __future__ import annotations

import html
import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from sealegs.commands import cli, deploy, new_robot
from sealegs.common.errors import SealegsError
from sealegs.configs.compose import compose
from sealegs.hw.machine.limits import Limits
from sealegs.hw.machine.own_robot import READERS
from sealegs.hw.machine.robot import ServoRobot, build_robot
from sealegs.hw.run import deployment
from sealegs.hw.run.connection import opened_bus, opened_port

from tests.servo_runs import PATIENT, gentle_policy

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
