"""What a joint that leads has of those that follow it: where it starts, how far it goes, and what it moves."""

from pathlib import Path

import numpy as np
import pytest
import sealegs
from sealegs.envs.described.model_file import read_model
from sealegs.envs.described.robot_file import load_robot_file

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
