"""A joint that stands twice in the YAML of a robot is told, and so are joints that its rows leave without a drive."""

from __future__ import annotations

from pathlib import Path

import pytest
from sealegs.commands import new_robot
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.engine.numbers import RobotError

ARM = """<mujoco><worldbody><body><joint name="pan" axis="0 0 1"/><geom size="0.1" mass="1"/>
<body pos="0 0 0.2"><joint name="lift" axis="0 1 0"/><geom size="0.1" mass="1"/>
<body pos="0 0 0.2"><joint name="finger" type="slide" axis="0 1 0"/><geom size="0.1" mass="1"/></body>
<body pos="0 0 0.3"><joint name="follower" type="slide" axis="0 1 0"/><geom size="0.1" mass="1"/></body></body></body>
</worldbody><equality><joint joint1="follower" joint2="finger"/></equality></mujoco>"""
FREE = "arm.xml: nothing drives the hinge lift, the slide finger; such joints move freely"


def robot(folder: Path, text: str) -> Path:
    (folder / "arm.xml").write_text(ARM)
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
    (tmp_path / "arm.xml").write_text(ARM.replace("</mujoco>", drives))
    new_robot.main([str(tmp_path / "arm.xml")])
    assert capsys.readouterr().out.count(FREE) == 1
