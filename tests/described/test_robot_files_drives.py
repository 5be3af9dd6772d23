"""Drives that no chain can have, tendons with a coefficient of 0, and joints that lead or follow others."""

import html
from pathlib import Path

import mujoco
import numpy as np
import pytest
import sealegs
from sealegs.commands import new_robot
from sealegs.common.errors import SealegsError
from sealegs.envs.described.as_robot import as_robot
from sealegs.envs.described.model_file import read_model
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.engine.numbers import RobotError
from sealegs.envs.new_robot import robot_yaml

PAIR = """<mujoco><compiler angle="radian"/><worldbody><body><joint name="a" axis="0 1 0" range="-1 1" {a}/>
<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="0.3"/><body pos="0 0 -0.2">
<joint name="b" axis="0 1 0" range="-2 2" {b}/><geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="0.3"/>
</body></body></worldbody>{more}</mujoco>"""
TIED = '<equality><joint joint1="b" joint2="a" polycoef="0 {ratio} 0 0 0" active="{active}"/></equality>'
SERVOS = """<actuator><position name="A" joint="a" kp="12" kv="0.2" forcerange="-3 3" ctrlrange="-0.5 0.5"/>
<position name="B" joint="b" kp="10" kv="0.1" forcerange="-2 2" ctrlrange="-2 2"/></actuator>"""


def pair(folder: Path, more: str = "", a: str = "", b: str = "") -> Path:
    path = folder / "pair.xml"
    path.write_text(PAIR.format(a=a, b=b, more=more))
    return path


def told(model: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """What the terminal says."""
    new_robot.main([str(model)])
    return capsys.readouterr().out


def test_an_assumed_gain_ends_where_a_chain_does(tmp_path: Path, capsys) -> None:
    said = told(pair(tmp_path, a='armature="990" actuatorfrcrange="-9e5 9e5"', b='actuatorfrcrange="-3 3"'), capsys)
    assert "an ideal servo of 1e+06 N.m/rad drives it (assumed, the most that a chain takes; " in said
    assert load_robot_file(tmp_path / "pair.yaml").joint("a").chain.value("ideal.stiffness") == 1e6


def test_a_range_without_an_end_counts_as_none(tmp_path: Path, capsys) -> None:
    model = pair(tmp_path)
    model.write_text(model.read_text().replace('range="-1 1"', 'range="-1e16 1e16"'))
    assert "joint a: its range (-1e+16 to 1e+16 rad) counts as none; -3.142 to 3.142 rad is assumed" in told(
        model, capsys
    )


def test_a_joint_that_its_damping_holds_in_place_is_not_driven_and_named(tmp_path: Path, capsys) -> None:
    model = pair(tmp_path, a='damping="1e11"')
    sentence = "joint 'a' has a damping of 1e+11 N.m.s/rad in pair.xml, which holds it in place; correct it there if it"
    assert sentence in told(model, capsys) and f"# Left out: {sentence}" in (tmp_path / "pair.yaml").read_text()
    assert [joint.name for joint in load_robot_file(tmp_path / "pair.yaml").joints] == ["b"]
    assert sentence in " ".join(load_robot_file(model).said)
    (tmp_path / "pair.yaml").write_text("model: pair.xml\njoints: {a: {chain: ideal}}\n")
    with pytest.raises(RobotError, match=r"pair\.xml: joint 'a' has a damping of 1e\+11: .* Correct it there, give"):
        load_robot_file(tmp_path / "pair.yaml")


def test_terms_of_0_in_a_tendon_are_left_out(tmp_path: Path) -> None:
    terms = '<fixed name="{}"><joint joint="a" coef="{}"/><joint joint="b" coef="{}"/></fixed>'
    tendons = terms.format("t1", 1, 0) + terms.format("t2", 0, 1)
    motors = '<actuator><motor name="t1" tendon="t1"/><motor name="t2" tendon="t2"/></actuator>'
    new_robot.main([str(pair(tmp_path, f"<tendon>{tendons}</tendon>{motors}"))])
    robot = load_robot_file(tmp_path / "pair.yaml")
    assert [joint.terms for joint in robot.joints] == [(("a", 1.0),), (("b", 1.0),)]
    assert not robot.coupled


def test_a_sentence_names_no_file_that_was_not_written(tmp_path: Path) -> None:
    with pytest.raises(RobotError) as caught:
        new_robot.main([str(pair(tmp_path)), "chain=stz3215"])
    assert "pair.yaml" not in str(caught.value) and "pair.xml: joints.a.chain: " in str(caught.value)


def test_an_equality_that_is_switched_off_ties_nothing(tmp_path: Path) -> None:
    robot = load_robot_file(pair(tmp_path, TIED.format(ratio=1, active="false") + SERVOS))
    assert [joint.name for joint in robot.joints] == ["a", "b"] and not robot.coupled


@pytest.mark.long
@pytest.mark.parametrize(("ratio", "reach"), [(1.0, 1.0), (-2.0, 46.0 / 52.0)])
@pytest.mark.parametrize("swapped", [False, True])
def test_two_servos_on_tied_joints_become_one_that_moves_both_as_the_model_does(
    ratio: float, reach: float, swapped: bool, tmp_path: Path, capsys
) -> None:
    servos = SERVOS
    if swapped:
        first, _, second = SERVOS.removeprefix("<actuator>").removesuffix("</actuator>").partition("\n")
        servos = f"<actuator>{second}{first}</actuator>"
    model = pair(tmp_path, TIED.format(ratio=ratio, active="true") + servos)
    assert "since an equality of the model ties b to it; their gains and forces are added" in told(model, capsys)
    (joint,) = load_robot_file(tmp_path / "pair.yaml").joints
    assert joint.terms == (("a", 1.0),) and joint.range == pytest.approx((-reach, reach), abs=1e-6)
    assert joint.chain.value("ideal.stiffness") == pytest.approx(12.0 + 10.0 * ratio**2)
    assert joint.chain.value("ideal.damping") == pytest.approx(0.2 + 0.1 * ratio**2)
    assert joint.chain.value("ideal.torque_limit") == pytest.approx(3.0 + 2.0 * abs(ratio))
    plain = mujoco.MjModel.from_xml_path(str(model))
    both = mujoco.MjData(plain)
    both.ctrl[:] = [0.3 * ratio, 0.3] if swapped else [0.3, 0.3 * ratio]
    mujoco.mj_step(plain, both, 3000)
    drivetrain = as_robot(load_robot_file(tmp_path / "pair.yaml")).drivetrain()
    one = mujoco.MjData(drivetrain.model)
    one.ctrl[0] = 0.3
    mujoco.mj_step(drivetrain.model, one, 3000)
    np.testing.assert_allclose(one.qpos, both.qpos, atol=6e-3)  # the equality is soft


def test_the_step_that_is_assumed_is_short_enough_for_the_drives(tmp_path: Path, capsys) -> None:
    """A gripper with a stiff servo had 2 ms from new-robot, which deploy then refused."""
    stiff = SERVOS.replace('kp="10" kv="0.1"', 'kp="100" kv="2"')
    told(pair(tmp_path, stiff), capsys)
    robot = load_robot_file(tmp_path / "pair.yaml")
    assert 0.0002 < robot.timestep < 0.002
    as_robot(robot).drivetrain()
    (tmp_path / "pair.yaml").write_text((tmp_path / "pair.yaml").read_text().replace(f"{robot.timestep:g} ", "0.002 "))
    with pytest.raises(SealegsError, match=r"unstable at a step of 0\.002 s"):
        as_robot(load_robot_file(tmp_path / "pair.yaml")).drivetrain()


DEGREES = """<mujoco><compiler angle="degree"/><worldbody><body><joint name="arm" axis="0 1 0" range="-90 90"/>
<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="0.3"/><body pos="0 0 -0.2">
<joint name="wheel" axis="0 1 0"/><geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="0.3"/>
<body pos="0 0 -0.2"><joint name="grip" type="slide" axis="1 0 0" range="0 0.04"/><geom size="0.02" mass="0.1"/>
</body></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("joint", "sentence"),
    [
        (
            "arm: {range: [-90, 90]}",
            r"arm\.range is -90 to 90 rad, far outside the range of its joint \(-1\.571 to 1\.571 rad\) in degrees"
            r"\.xml; angles in a robot's YAML are in radians, whatever the compiler's angle \(-90 to 90 degrees are -1",
        ),
        ("arm: {range: [-20, 20]}", r"arm\.range is -20 to 20 rad, far outside"),
        ("arm: {start: 45}", r"arm\.start is 45 rad, far outside .*; angles .* \(45 degrees are 0\.7854\)"),
        ("arm: {start: -5}", r"arm\.start is -5 rad, far outside"),
        ("arm: {belt: {arm: 2}, range: [-180, 180]}", r"arm\.range is .* \(-3\.142 to 3\.142 rad\)"),
        (
            "grip: {range: [0, 40]}",
            r"grip\.range is 0 to 40 m, far outside the range of its joint \(0 to 0\.04 m\) .*; positions of a slide "
            "are in metres",
        ),
    ],
)
def test_degrees_and_millimetres_in_a_yaml_are_told(joint: str, sentence: str, tmp_path: Path) -> None:
    """A range and a start in degrees were taken as rad, without a word."""
    (tmp_path / "degrees.xml").write_text(DEGREES)
    (tmp_path / "arm.yaml").write_text(f"model: degrees.xml\njoints: {{{joint}}}\n")
    with pytest.raises(RobotError, match=sentence):
        load_robot_file(tmp_path / "arm.yaml")


@pytest.mark.parametrize(
    ("joint", "limits"),
    [
        ("arm: {range: [-1.8, 1.8], start: 1.6}", (-1.8, 1.8)),  # a servo presses against its stops
        ("arm: {range: [-3.14, 3.14]}", (-3.14, 3.14)),
        ("wheel: {range: [-90, 90], start: 45}", (-90.0, 90.0)),  # it has no stops
        ("grip: {range: [-0.05, 0.04]}", (-0.05, 0.04)),
    ],
)
def test_goals_somewhat_beyond_a_stop_are_allowed(joint: str, limits: tuple[float, float], tmp_path: Path) -> None:
    (tmp_path / "degrees.xml").write_text(DEGREES)
    (tmp_path / "arm.yaml").write_text(f"model: degrees.xml\njoints: {{{joint}}}\n")
    assert load_robot_file(tmp_path / "arm.yaml").joints[0].range == limits


def test_what_an_actuator_has_that_no_ideal_servo_has_is_said(tmp_path: Path) -> None:
    """A lag and a delay of the file were dropped without a word; a diagnosis would have found them missing."""
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><worldbody><body><joint name="a" type="hinge" range="-90 90"/><geom size=".1" pos="0 0 .2"/></body>'
        '</worldbody><actuator><position name="servo" joint="a" kp="5" timeconst="0.1" delay="0.03" nsample="20" '
        'damping="0.7" armature="0.02"/></actuator></mujoco>',
        encoding="utf-8",
    )
    (said,) = [sentence for sentence in load_robot_file(path).said if "lacks" in sentence]
    assert "a lag of 0.1 s" in said and "a delay of 0.03 s" in said
    assert "an armature of 0.02" in said and "a damping of 0.7" in said


LINK = """<link name="{name}"><inertial><mass value="1"/><origin xyz=".1 0 0"/>
<inertia ixx=".01" iyy=".02" izz=".02" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
TURN = """<joint name="{name}" type="revolute"><parent link="base"/><child link="{name}"/><axis xyz="0 1 0"/>
<limit lower="{low}" upper="{high}" effort="5" velocity="2"/>{more}</joint>"""
MIMIC = '<mimic joint="{leader}" multiplier="{ratio}" offset="{offset}"/>'
FINGERS = """<mujoco><worldbody><body name="left"><joint name="left" type="slide" axis="0 1 0" range="0 .04"/>
<geom size=".01" mass=".2"/></body><body name="right"><joint name="right" type="slide" axis="0 -1 0" range="0 .04"/>
<geom size=".01" mass=".2"/></body></worldbody><equality><joint joint1="right" joint2="left"/></equality></mujoco>"""
REFERENCE = """<mujoco><worldbody><body><joint name="lift" type="slide" axis="0 0 1" ref=".3" range="0 1"/>
<geom size=".1" mass="1"/></body></worldbody></mujoco>"""


def urdf(folder: Path, *joints: str) -> Path:
    links = "".join(LINK.format(name=name) for name in ("p", "q", "r")[: len(joints)])
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="arm"><link name="base"/>{links}{"".join(joints)}</robot>')
    return path


def leader_and_follower(folder: Path) -> Path:
    follows = MIMIC.format(leader="p", ratio=-2, offset=0.3)
    return urdf(
        folder,
        TURN.format(name="p", low=-1, high=1, more=""),
        TURN.format(name="q", low=-1, high=1, more=follows),
    )


def test_episodes_start_with_followers_where_their_ties_hold_them(tmp_path: Path) -> None:
    """A follower that started elsewhere threw its leader to 1.9 rad/s in the first step."""
    engine = sealegs.make_env("track", robot=str(leader_and_follower(tmp_path))).unwrapped
    engine.reset(seed=0)
    leader, follower = engine.data.qpos
    assert leader != 0.0 and follower == pytest.approx(0.3 - 2.0 * leader, abs=1e-12)


def test_goals_of_a_leader_end_where_its_follower_does(tmp_path: Path) -> None:
    robot = load_robot_file(leader_and_follower(tmp_path))
    assert robot.joints[0].range == pytest.approx((-0.35, 0.65))
    said = "joint p: 'q', which follows it, has a range of -1 to 1 rad, so it goes from -0.35 to 0.65 rad only."
    assert said in robot.said


def test_ties_in_a_row_are_followed_to_the_first_leader(tmp_path: Path) -> None:
    first = MIMIC.format(leader="p", ratio=2, offset=0.1)
    second = MIMIC.format(leader="q", ratio=-1, offset=0.2)
    path = urdf(
        tmp_path,
        TURN.format(name="p", low=-1, high=1, more=""),
        TURN.format(name="q", low=-3, high=3, more=first),
        TURN.format(name="r", low=-0.9, high=2.1, more=second),
    )
    assert load_robot_file(path).joints[0].range == pytest.approx((-1.0, 0.5))
    ways = {name: (offset, ratio) for name, offset, ratio in read_model(path).carried["p"]}
    assert ways["q"] == pytest.approx((0.1, 2.0)) and ways["r"] == pytest.approx((0.1, -2.0))


def test_a_leader_moves_the_inertia_of_its_followers(tmp_path: Path) -> None:
    """Followers that gave way made a gripper seem half as heavy, and its assumed servo too weak."""
    (tmp_path / "fingers.xml").write_text(FINGERS)
    robot = load_robot_file(tmp_path / "fingers.xml")
    assert robot.model.mobility_of((("left", 1.0),)) == pytest.approx(1.0 / 0.4)
    assert robot.model.joints["left"].inertia == pytest.approx(0.4)
    rate = np.sqrt(robot.joints[0].chain.value("ideal.stiffness") / 0.4) / (2.0 * np.pi)
    assert rate == pytest.approx(4.0, rel=1e-3)


def test_a_joint_starts_where_the_file_describes_it_without_a_keyframe(tmp_path: Path) -> None:
    (tmp_path / "lift.xml").write_text(REFERENCE)
    assert load_robot_file(tmp_path / "lift.xml").joints[0].start == pytest.approx(0.3)


# --- names of joints and paths that YAML, logs or the command line take for something else, or that stand twice ------

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
