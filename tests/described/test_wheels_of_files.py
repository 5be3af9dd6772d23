"""`sealegs new-robot` writes wheels for joints that turn without end, and positions for those that only could."""

from __future__ import annotations

from pathlib import Path

import pytest
import sealegs
import yaml
from sealegs.commands import new_robot
from sealegs.envs.any_robot.drive import rolling
from sealegs.envs.described.model_file import read_model
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.engine.numbers import RobotError
from sealegs.envs.robots import get_robot

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
