"""Names of joints and paths that YAML, logs or the command line take for something else, or that stand twice."""

from __future__ import annotations

import html
from pathlib import Path

import pytest
from sealegs.commands import new_robot
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.engine.numbers import RobotError
from sealegs.envs.new_robot import robot_yaml

ARM = """<mujoco><compiler angle="radian"/><worldbody><body><joint name="{name}" axis="0 1 0" range="-1 {high}"/>
<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="0.3"/></body></worldbody>
<actuator><position name="p" joint="{name}" kp="20"/></actuator>
<keyframe><key qpos="{start}"/></keyframe></mujoco>"""
NAMES = (
    "8",
    "on",
    "yes",
    "null",
    "007",
    "1_000",
    "12:30",
    "1e3",
    "a: b",
    "*",
    "@x",
    "x #y",
    "[a]",
    "a,b",
    "it's",
    "ü",
    "~",
)


def arm(folder: Path, name: str = "j", high: str = "1", start: str = "0", file: str = "arm.xml") -> Path:
    path = folder / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(ARM.format(name=html.escape(name), high=high, start=start), encoding="utf-8")
    return path


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_a_joint_whose_name_yaml_reads_as_something_else_stands_in_quotes(name: str, tmp_path: Path) -> None:
    new_robot.main([str(arm(tmp_path, name))])
    assert [joint.name for joint in load_robot_file(tmp_path / "arm.yaml").joints] == [name]


def test_a_small_number_of_the_model_is_a_number_in_the_yaml(tmp_path: Path) -> None:
    """-4e-05 is a word in YAML: a public humanoid got no file after a minute of work."""
    new_robot.main([str(arm(tmp_path, start="-4e-5"))])
    assert load_robot_file(tmp_path / "arm.yaml").joints[0].start == -4e-5


@pytest.mark.long
@pytest.mark.parametrize("file", ["a: b/arm.xml", "a #b/arm.xml", "8.xml"])
def test_a_path_that_yaml_reads_as_something_else_stands_in_quotes(file: str, tmp_path: Path) -> None:
    model = arm(tmp_path, file=file)
    new_robot.main([str(model), f"out={tmp_path / 'robot.yaml'}"])
    assert load_robot_file(tmp_path / "robot.yaml").model.path == model.resolve()


def test_a_file_that_cannot_be_read_after_writing_does_not_stay(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(robot_yaml, "robot_yaml", lambda *_: ("model: nothing.xml\n", ()))
    with pytest.raises(RobotError, match=r"nothing\.xml"):
        robot_yaml.write_robot_yaml(arm(tmp_path), tmp_path / "arm.yaml")
    assert not (tmp_path / "arm.yaml").exists()


def test_a_name_of_the_yaml_without_quotes_that_reads_as_a_number_is_refused_with_the_way_out(tmp_path: Path) -> None:
    arm(tmp_path, "8")
    (tmp_path / "arm.yaml").write_text("model: arm.xml\njoints: {8: {chain: sts3215}}\n")
    with pytest.raises(RobotError, match=r"reads the name 8 as a value; put it in quotes"):
        load_robot_file(tmp_path / "arm.yaml")


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "why", "other"),
    [
        ("left/waist", "has a slash, so a log of this robot cannot be read", "left_waist: {joint: left/waist, ...}"),
        ("robot0:W", "has a sign that needs quotes on the command line", "robot0_W: {joint: robot0:W, ...}"),
        ("8", "reads as a value", "joint_8: {joint: '8', ...}"),
    ],
)
def test_a_name_that_logs_or_deploy_cannot_take_is_warned_about(
    name: str, why: str, other: str, tmp_path: Path, capsys
) -> None:
    new_robot.main([str(arm(tmp_path, name))])
    said = capsys.readouterr().out
    assert f"its name {why}" in said and other in said.replace("'robot0:W'", "robot0:W")
    row = other.replace(", ...", ", chain: sts3215")
    (tmp_path / "renamed.yaml").write_text(f"model: arm.xml\njoints:\n  {row}\n")
    robot = load_robot_file(tmp_path / "renamed.yaml")
    assert [joint.joint for joint in robot.joints] == [name]
    assert "drive nothing here" not in " ".join(robot.said), "its actuator's joint is driven, by another name"


def test_a_start_at_the_end_of_the_range_lies_in_the_range_as_written(tmp_path: Path) -> None:
    new_robot.main([str(arm(tmp_path, high="1.23456789", start="1.23456789"))])
    joint = load_robot_file(tmp_path / "arm.yaml").joint("j")
    assert joint.start == joint.range[1]


def test_a_robot_without_named_joints_is_told_to_name_them(tmp_path: Path) -> None:
    model = arm(tmp_path)
    model.write_text(model.read_text().replace('name="j" ', "").partition("<actuator>")[0] + "</mujoco>")
    with pytest.raises(
        RobotError, match=r'the hinge without a name on .*; give hinges and slides a name: <joint name="'
    ):
        new_robot.main([str(model)])


@pytest.mark.parametrize("file", ["arm.urdf.xacro", "arm.sdf"])
def test_a_file_of_macros_is_refused_with_the_command_that_expands_it(file: str, tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=r"xacro arm\.xacro > arm\.urdf"):
        new_robot.main([str(arm(tmp_path, file=file))])


PAN_AND_TILT = """<mujoco><worldbody><body><joint name="pan" axis="0 0 1"/><geom size="0.1" mass="1"/>
<body pos="0 0 0.2"><joint name="lift" axis="0 1 0"/><geom size="0.1" mass="1"/>
<body pos="0 0 0.2"><joint name="finger" type="slide" axis="0 1 0"/><geom size="0.1" mass="1"/></body>
<body pos="0 0 0.3"><joint name="follower" type="slide" axis="0 1 0"/><geom size="0.1" mass="1"/></body></body></body>
</worldbody><equality><joint joint1="follower" joint2="finger"/></equality></mujoco>"""
FREE = "arm.xml: nothing drives the hinge lift, the slide finger; such joints move freely"


def robot(folder: Path, text: str) -> Path:
    (folder / "arm.xml").write_text(PAN_AND_TILT)
    path = folder / "arm.yaml"
    path.write_text(f"model: arm.xml\n{text}\n")
    return path


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("joints:\n  pan: {chain: sts3215}\n  pan: {chain: sts3215}", "'pan' stands twice, in lines 3 and 4; keep one"),
        ("joints:\n  pan: {}\n  'pan': {}", "'pan' stands twice, in lines 3 and 4"),
        ("joints: {pan: {damping: file, damping: chain}}", "'damping' stands twice, in line 2"),
        ("joints: {pan: {}}\njoints: {lift: {}}", "'joints' stands twice, in lines 2 and 3"),
        ("joints: {pan: {chain: [{ideal: {stiffness: 1, stiffness: 2}}]}}", "'stiffness' stands twice"),
    ],
)
def test_a_key_that_stands_twice_is_refused(text: str, sentence: str, tmp_path: Path) -> None:
    """The first of two joints was dropped without a word, and only one was driven."""
    with pytest.raises(RobotError, match=sentence):
        load_robot_file(robot(tmp_path, text))


def test_what_joints_have_in_common_may_stand_once_for_all_and_otherwise_at_one(tmp_path: Path) -> None:
    rows = "joints:\n  pan: &all {chain: sts3215, range: [-1, 1]}\n  lift: {<<: *all, range: [-2, 2]}"
    pan, lift = load_robot_file(robot(tmp_path, rows)).joints
    assert (pan.range, lift.range) == ((-1.0, 1.0), (-2.0, 2.0))


def test_joints_that_no_row_drives_are_told(tmp_path: Path) -> None:
    file = load_robot_file(robot(tmp_path, "joints: {pan: {chain: sts3215}}"))
    assert sum(FREE in sentence for sentence in file.said) == 1
    all_driven = "joints: {pan: {chain: sts3215}, lift: {chain: sts3215}, finger: {chain: sts3215}}"
    assert not any("nothing drives" in said for said in load_robot_file(robot(tmp_path, all_driven)).said)
    bare = load_robot_file(robot(tmp_path, ""))
    assert not any("nothing drives" in said for said in bare.said)


def test_new_robot_tells_them_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = robot(tmp_path, "")
    path.unlink()
    drives = '<actuator><motor joint="pan"/></actuator></mujoco>'
    (tmp_path / "arm.xml").write_text(PAN_AND_TILT.replace("</mujoco>", drives))
    new_robot.main([str(tmp_path / "arm.xml")])
    assert capsys.readouterr().out.count(FREE) == 1
