"""Limits and excitations of a robot as new-robot writes it: its first measurements run through."""

import json
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
import sealegs
import yaml
from sealegs.commands import loop, new_robot
from sealegs.commands.new_robot import together
from sealegs.common.errors import SealegsError
from sealegs.configs.compose import compose
from sealegs.envs.any_robot.drive import rolling
from sealegs.envs.described.model_file import read_model
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.engine.numbers import RobotError
from sealegs.envs.new_robot.robot_yaml import AssumedLimits
from sealegs.envs.robots import get_robot
from sealegs.hw.machine.assumed_limits import assumed_limits
from sealegs.hw.machine.own_robot import READERS, own_robot
from sealegs.hw.run import deployment

HAND = """<mujoco><compiler angle="radian" autolimits="true"/><worldbody><body name="upper" pos="0 0 1">
<joint name="shoulder" axis="0 1 0" range="-1.5 1.5" damping="0.2" armature="0.01"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4" contype="0" conaffinity="0"/>
<body name="finger" pos="0 0 -0.2"><joint name="finger" type="slide" axis="0 1 0" range="0 0.04" armature="0.02"/>
<geom size="0.01" mass="0.03" contype="0" conaffinity="0"/></body></body></worldbody><actuator>
<position joint="shoulder" kp="40" kv="3" forcerange="-6 6"/>
<position joint="finger" kp="400" kv="6" forcerange="-20 20"/>
</actuator></mujoco>"""
URDF = """<robot name="arm"><link name="base"/><link name="link"><inertial><mass value="0.5"/>
<origin xyz="0 0 0.1"/><inertia ixx="0.002" iyy="0.002" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="link"/><axis xyz="0 1 0"/>
<limit lower="-1.5" upper="1.5" effort="10" velocity="{velocity}"/><dynamics damping="0.3"/></joint></robot>"""

TOOL = """<robot name="arm"><link name="base"/><link name="link"><inertial><mass value="0.5"/>
<origin xyz="0 0 0.1"/><inertia ixx="0.002" iyy="0.002" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tool"><inertial><mass value="0.05"/><inertia ixx="2e-5" iyy="2e-5" izz="2e-5" ixy="0" ixz="0" iyz="0"/>
</inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="link"/><axis xyz="0 1 0"/>
<limit lower="-1.5" upper="1.5" effort="30" velocity="5"/><dynamics damping="1"/></joint>
<joint name="tip" type="revolute"><parent link="link"/><child link="tool"/><axis xyz="0 1 0"/>
<limit lower="-0.6" upper="0.6" effort="{effort}" velocity="5"/><dynamics damping="{damping}"/></joint></robot>"""
"""A light tool on a joint with much damping: a step of the trial that takes it explicitly makes it ever wilder."""


@pytest.fixture
def hand(tmp_path: Path) -> Path:
    (tmp_path / "hand.xml").write_text(HAND)
    new_robot.main([str(tmp_path / "hand.xml")])
    return tmp_path / "hand.yaml"


def prepared(robot: Path, word: str, *more: str) -> deployment.Deployment:
    arguments = [f"robot={robot}", f"excitation={word}", f"out={robot.parent / 'logs'}", f"name={word}"]
    arguments += ["hw.virtual.time=stepped", "live=false", "silence=20", *more]
    return deployment.prepare(compose("deploy", dict(item.split("=", 1) for item in arguments), readers=READERS))


def halves(found: deployment.Deployment) -> dict[str, float]:
    reach = found.commands.description["reach"]
    return dict.fromkeys(found.robot.names, reach) if isinstance(reach, float) else reach


@pytest.mark.long
@pytest.mark.parametrize(("word", "seconds"), [("steps", 3), pytest.param("chirp", 12, marks=pytest.mark.long)])
def test_the_first_excitations_run_through_on_a_robot_that_new_robot_wrote(word: str, seconds: int, hand: Path) -> None:
    done = deployment.run(prepared(hand, word, f"duration={seconds}"), lambda _: None)
    assert done is not None and done.outcome.fault is None, done


def test_limits_of_ideal_servos_are_above_their_largest_force_over_their_stiffness(hand: Path) -> None:
    safety = yaml.safe_load(hand.read_text())["deploy"]["safety"]
    assert safety["following_error"]["shoulder"] > 6.0 / 40.0
    assert safety["speed"]["finger"] > 2 * 2 * np.pi / 4096 * 100.0, "two steps of the encoder in a cycle are no speed"
    assert own_robot(str(hand))["safety"] == own_robot(str(hand.with_suffix(".xml")))["safety"]


def test_a_robot_with_chains_of_real_servos_keeps_the_limits_of_the_bench(tmp_path: Path) -> None:
    (tmp_path / "hand.xml").write_text(HAND)
    new_robot.main([str(tmp_path / "hand.xml"), "chain=sts3215"])
    safety = own_robot(str(tmp_path / "hand.yaml"))["safety"]
    assert safety["following_error"] is None and safety["speed"] == {"finger": 0.2, "*": 15.0}


@pytest.mark.parametrize(
    ("chain", "servo", "told"),
    [
        ("xl330", "xl330_m288   # model of its servos, which the chain xl330 describes", False),
        pytest.param("sts3215_wheel", "sts3215   # model of its servos, which", False, marks=pytest.mark.long),
        pytest.param("sts3250", "sts3250   # model of its servos, which", False, marks=pytest.mark.long),
        ("mx64", "sts3215   # model of its servos, such as sts3250, scs0009, xl330_m288; assumed", True),
    ],
)
def test_the_servo_of_a_robot_is_the_one_that_its_chain_describes(
    chain: str, servo: str, told: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "arm.urdf").write_text(URDF.format(velocity=5))
    new_robot.main([str(tmp_path / "arm.urdf"), f"chain={chain}"])
    assert f"\n  servo: {servo}" in (tmp_path / "arm.yaml").read_text()
    assert ("arm.urdf: deploy: servo is sts3215, assumed, as no register table" in capsys.readouterr().out) == told


@pytest.mark.long
def test_a_stop_names_the_key_that_a_person_may_change(hand: Path) -> None:
    for key in ("speed", "following_error"):
        low = f'robot.safety.{key}={{"*": 0.0001}}'
        done = deployment.run(prepared(hand, "steps", "duration=2", low), lambda _: None)
        assert done is not None and done.outcome.fault is not None
        assert f"(robot.safety.{key}; a smaller reach= slows an excitation)" in done.outcome.fault.sentence


@pytest.mark.long
def test_reach_is_a_number_for_hinges_or_numbers_by_pattern_of_names(hand: Path) -> None:
    assert halves(prepared(hand, "chirp", "reach=0.3")) == {"shoulder": 0.3, "finger": 0.016}
    given = 'reach={"finger": 0.01, "*": 0.3}'
    assert halves(prepared(hand, "chirp", given)) == {"shoulder": 0.3, "finger": 0.01}
    assert halves(prepared(hand, "chirp", "reach={finger: 0.01}")) == {"shoulder": 0.9, "finger": 0.01}
    with pytest.raises(SealegsError, match=r"reach.fingre fits no joint; there are shoulder, finger"):
        prepared(hand, "chirp", "reach={fingre: 0.01}")
    with pytest.raises(SealegsError, match=r"reach is 0.03 m; joint finger has 0.02 m to either side"):
        prepared(hand, "chirp", "reach={finger: 0.03}")
    with pytest.raises(SealegsError, match=r"reach is 2 rad; joint shoulder has 1.50 rad"):
        prepared(hand, "chirp", "reach=2")


def test_the_loop_takes_the_same_reach(hand: Path) -> None:
    config = dict(compose("loop", {"robot": str(hand), "reach": '{"finger": 0.01, "*": 0.3}'}, readers=READERS))
    assert loop.checked_settings(config)["reach"] == {"finger": 0.01, "*": 0.3}
    with pytest.raises(SealegsError, match="reach=far must be a number above 0, numbers by pattern of names"):
        loop.checked_settings({**config, "reach": "far"})


@pytest.mark.long
@pytest.mark.parametrize(("velocity", "slow"), [(3.0, True), (60.0, False)])
def test_a_velocity_limit_of_a_urdf_is_written_with_a_reach_that_keeps_to_it(
    velocity: float, slow: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One of 3 rad/s was given up for 26, since excitations of the usual reach needed that."""
    (tmp_path / "arm.urdf").write_text(URDF.format(velocity=velocity))
    new_robot.main([str(tmp_path / "arm.urdf")])
    said, text = capsys.readouterr().out, (tmp_path / "arm.yaml").read_text()
    assert yaml.safe_load(text)["deploy"]["safety"]["speed"]["turn"] == velocity
    assert (
        "joint turn: its velocity limit of 3 rad/s in arm.urdf is written as deploy: safety: speed, but" in said
    ) == slow
    found = re.search(r"keep to the velocity limits of the model with reach='(.*)'", text)
    assert (found is not None) == slow
    if found is not None:
        assert 0.01 < json.loads(found[1])["turn"] < 0.5 and found[1] in said


def test_a_velocity_limit_that_an_encoder_at_rest_reaches_is_written_with_its_steps(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(URDF.format(velocity=0.1))
    found = assumed_limits(load_robot_file(tmp_path / "arm.urdf"), advised=False)
    assert found.limits["speed"]["turn"] == 0.56
    assert "limit of 0.1 rad/s in arm.urdf, with 0.46 rad/s for the steps of an encoder, is" in found.said[0]


def limits_of_a_tool(folder: Path, effort: float, damping: float) -> AssumedLimits:
    (folder / "arm.urdf").write_text(TOOL.format(effort=effort, damping=damping))
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of numpy, which a person would see
        return assumed_limits(load_robot_file(folder / "arm.urdf"))


@pytest.mark.long
def test_limits_of_a_light_tool_on_a_damped_joint_are_within_its_range(tmp_path: Path) -> None:
    """They were 1e250 rad: the trial took the damping explicitly."""
    found = limits_of_a_tool(tmp_path, effort=0.5, damping=0.1)
    assert set(found.limits["following_error"]) == {"turn", "tip"}
    assert all(0.1 <= value <= 3.0 for value in found.limits["following_error"].values()), found.limits
    assert not any("e+" in sentence for sentence in found.said), found.said


@pytest.mark.long
def test_a_servo_that_stays_behind_by_more_than_the_range_gets_no_limit_and_a_warning(tmp_path: Path) -> None:
    found = limits_of_a_tool(tmp_path, effort=0.02, damping=5.0)
    assert set(found.limits["following_error"]) == {"turn"}
    assert any(
        re.match(r"Warning: joint tip: .* more than its range of 1.2 rad; no following_error is written", sentence)
        for sentence in found.said
    ), found.said


@pytest.mark.parametrize("key", ["following_error", "range_margin"])
def test_a_limit_that_would_never_stop_a_joint_is_refused_wherever_the_robot_is_read(key: str, hand: Path) -> None:
    """Training and deployment took 1e35 rad."""
    text = hand.read_text()
    document = yaml.safe_load(text)
    document["deploy"]["safety"][key] = {"shoulder": 1e35, "*": 0.02}
    hand.write_text(yaml.safe_dump(document, sort_keys=False))
    said = f"deploy.safety.{key} of joint shoulder is 1e\\+35 rad, but the range of the joint is 3 rad: it would never"
    with pytest.raises(SealegsError, match=said):
        load_robot_file(hand)
    hand.write_text(text)
    with pytest.raises(SealegsError, match=f"safety.{key} of joint finger is 1e\\+35 m, but the range of the joint is"):
        prepared(hand, "steps", f'robot.safety.{key}={{"finger": 1.0e+35, "*": 0.2}}')


# --- `sealegs new-robot` writes wheels for joints that turn without end, and positions for those that only could -----

LINK = """<link name="{name}"><inertial><mass value="{mass}"/>
<inertia ixx="0.002" iyy="0.002" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="{at}"/><geometry>{shape}</geometry></collision></link>"""
JOINT = """<joint name="{name}" type="continuous"><parent link="body"/><child link="{child}"/>
<origin xyz="{place}" rpy="{turn} 0 0"/><axis xyz="0 0 1"/>{limit}</joint>"""
LIMIT = '<limit effort="1.5" velocity="5"/>'


def link(name: str, shape: str, mass: float = 0.1, at: str = "0 0 0") -> str:
    return LINK.format(name=name, shape=shape, mass=mass, at=at)


def cart(path: Path, left: str = "axle_a") -> Path:
    """Two rims that are round about their axles, and a pan that is not."""
    rim, turn = '<cylinder radius="0.05" length="0.02"/>', "-1.5707963"
    path.write_text(
        '<robot name="cart">'
        + link("body", '<box size="0.2 0.1 0.04"/>', 1.0)
        + link("rim_a", rim)
        + link("rim_b", rim)
        + link("head", '<box size="0.02 0.02 0.1"/>', at="0.03 0 0.06")
        + JOINT.format(name=left, child="rim_a", place="0 0.08 0", turn=turn, limit=LIMIT)
        + JOINT.format(name="axle_b", child="rim_b", place="0 -0.08 0", turn=turn, limit=LIMIT)
        + JOINT.format(name="pan", child="head", place="0 0 0.04", turn="0", limit="")
        + "</robot>"
    )
    return path


def test_joints_that_turn_without_end_become_wheels_on_a_floor(tmp_path: Path) -> None:
    model, out = cart(tmp_path / "cart.urdf"), tmp_path / "cart.yaml"
    assert dict(read_model(model).wheels) == {"axle_a": 0.05, "axle_b": 0.05}
    new_robot.main([str(model), f"out={out}"])
    written = yaml.safe_load(out.read_text())
    assert written["base"] == "free" and written["height"] == pytest.approx(0.05)
    assert written["joints"]["axle_a"]["range"] == [-5.0, 5.0]
    assert list(written["joints"]["axle_a"]["chain"][0]) == ["ideal_velocity"]
    assert list(written["joints"]["pan"]["chain"][0]) == ["ideal"]
    assert rolling(get_robot(out)).per_forward == pytest.approx([20.0, 20.0, 0.0])
    sealegs.make_env("drive", robot=str(out)).reset(seed=0)


def test_a_servo_of_the_library_gets_its_wheel_mode_where_it_drives_a_wheel(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, out = cart(tmp_path / "cart.urdf"), tmp_path / "cart.yaml"
    new_robot.main([str(model), f"out={out}", "chain=sts3215"])
    robot = load_robot_file(out)
    assert [joint.by_speed for joint in robot.joints] == [True, True, False]
    assert robot.joint("axle_a").chain.value("velocity_pi.gain") > 0.0
    assert robot.joint("axle_a").range == pytest.approx((-5.0, 5.0))
    assert "pan turns without end and is told positions" in capsys.readouterr().out


def test_a_chain_without_a_wheel_mode_is_told_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    new_robot.main([str(cart(tmp_path / "cart.urdf")), f"out={tmp_path / 'cart.yaml'}", "chain=sts3250"])
    assert "there is no chain 'sts3250_wheel', so an ideal speed drive takes its place" in capsys.readouterr().out


def test_velocity_actuators_of_a_file_are_wheels_with_their_numbers(tmp_path: Path) -> None:
    model = tmp_path / "spun.xml"
    model.write_text("""<mujoco><compiler angle="radian"/><worldbody><body name="disc"><joint name="spin" axis="0 0 1"/>
    <geom type="box" size="0.1 0.02 0.02" mass="0.5"/></body></worldbody>
    <actuator><velocity name="drive" joint="spin" kv="0.2" ctrlrange="-8 8" ctrllimited="true"/></actuator></mujoco>""")
    joint = load_robot_file(model).joint("spin")
    assert joint.range == pytest.approx((-8.0, 8.0)) and joint.goal_unit == "rad/s"
    assert joint.chain.value("ideal_velocity.damping") == pytest.approx(0.2)


def test_a_chain_of_speeds_drives_one_joint_only(tmp_path: Path) -> None:
    robot = tmp_path / "cart.yaml"
    cart(tmp_path / "cart.urdf")
    robot.write_text("model: cart.urdf\njoints:\n  both: {chain: sts3215_wheel, belt: {axle_a: 1, axle_b: 1}}\n")
    with pytest.raises(RobotError, match="a chain of speed goals drives one joint"):
        load_robot_file(robot)


# --- what `sealegs new-robot` says fits a screen ---------------------------------------------------------------------


def test_what_is_said_of_many_joints_alike_is_one_sentence_with_the_range_of_its_numbers() -> None:
    """Of a public quadruped 36 lines were said, of three kinds."""
    said = [
        f"joint {name}: an ideal servo of {size} N.m/rad drives it (a1.urdf)."
        for name, size in zip("abc", (8, 9.5, 7e-5), strict=True)
    ]
    told = together([*said, "the floor is level.", "Warning: joint d: it is weak."])
    assert told == [
        "joints a, b, c: an ideal servo of 7e-05 to 9.5 N.m/rad drives it (a1.urdf).",
        "the floor is level.",
        "Warning: joint d: it is weak.",
    ]


def test_what_is_said_of_few_joints_stays_as_it_is() -> None:
    said = ["joint a: weak {so}.", "joint b: weak {so}.", "joint a: of 3 N.m.", "other."]
    assert together(said) == said


def test_names_and_signs_in_a_sentence_stay() -> None:
    said = [f"joint {k}: write {{joint: x, ...}} of 2 in 1.urdf." for k in (7, 8, 9)]
    assert together(said) == ["joints 7, 8, 9: write {joint: x, ...} of 2 in 1.urdf."]
