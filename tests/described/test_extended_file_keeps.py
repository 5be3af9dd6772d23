"""The model file that a diagnosis writes for plain MuJoCo keeps names, control ranges and keyframes of the robot's."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import yaml
from sealegs.actuators.chain import load_chain
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.extended import Extended, Mounted
from sealegs.gap.log.reader import read_measured
from sealegs.gap.output.robot_mjcf import write_robot

ARM = """<mujoco model="arm"><compiler angle="degree" autolimits="true"/>
<default><geom type="capsule" size="0.012" contype="0" conaffinity="0"/>
<position kp="40" kv="2" forcerange="-8 8" ctrlrange="-1.5 1.5"/></default>
<worldbody><body name="base" pos="0 0 0.5">{base}<geom type="box" size="0.05 0.05 0.05"/>
<body name="b1"><joint name="j1" axis="0 0 1" range="-90 90"/><geom fromto="0 0 0 0 0 0.1" mass="0.2"/>
<body name="b2" pos="0 0 0.1"><joint name="j2" axis="0 1 0" range="-90 90"/><geom fromto="0 0 0 0 0 0.2" mass="0.2"/>
<body name="b3" pos="0 0 0.2"><joint name="j3" axis="0 1 0" range="-120 120"/>
<geom fromto="0 0 0 0 0 0.15" mass="0.1"/><site name="tip"/></body></body></body></body></worldbody>
<actuator><position name="a1" joint="j1"/><position name="a--2" joint="j2" gear="2"/>
<motor name="a3" joint="j3" gear="30" ctrlrange="-0.2 0.2"/>{actuators}</actuator>{rest}</mujoco>"""
KEYS = (
    """<keyframe><key name="home" qpos="0.1 0.3 -0.5" ctrl="0.1 0.15 0.1"/><key name="up" qpos="0 0 1"/></keyframe>"""
)
SERVO = [{"ideal": {"stiffness": 30.0, "damping": 2.0, "armature": 0.01}}]
TORQUE = [{"torque_command": {"armature": 0.01}}]
SPRINGY = [*SERVO, {"compliance": {"stiffness": 300.0, "damping": 1.0}}]


def written(
    folder: Path,
    chain: list[dict] = SERVO,
    base: str = "",
    actuators: str = "",
    rest: str = KEYS,
    rows: str = "",
    bare: bool = False,
) -> tuple[mujoco.MjModel, str]:
    """The model that a diagnosis writes, and its first line."""
    text = ARM.format(base=base, actuators=actuators, rest=rest)
    if bare:
        text = text[: text.index("<actuator>")] + "</mujoco>"
    (folder / "arm.xml").write_text(text)
    name = "arm.xml"
    if rows:
        name = "arm.yaml"
        (folder / name).write_text(f"model: arm.xml\njoints: {rows}\n")
    joints = [item.name for item in load_robot_file(folder / name).joints]
    columns = ",".join(f"{joint}.goal,{joint}.position" for joint in joints)
    samples = "".join(f"{0.01 * k}{',0' * 2 * len(joints)}\n" for k in range(50))
    (folder / "run.csv").write_text(f"time,{columns}\n{samples}")
    (folder / "run.yaml").write_text(yaml.safe_dump({"robot": name, "actuators": dict.fromkeys(joints, chain)}))
    data = read_measured(folder / "run.csv")
    chains = {joint: (Mounted(load_chain(chain), f"{joint}.yaml"),) for joint in joints}
    digest = load_robot_file(folder / name).model.digest
    (folder / "out").mkdir()
    path = write_robot(Extended(data.runs[0].robot, {}, chains, (), digest=digest), data, folder / "out")
    assert path is not None
    return mujoco.MjModel.from_xml_path(str(path)), path.read_text().splitlines()[0]


def test_actuators_keep_their_names_and_take_goals_as_far_as_the_files_do(tmp_path: Path) -> None:
    """Code that asked for actuator a1 or scaled by a control range broke, or commanded goals beyond 0.75 rad."""
    model, _ = written(tmp_path)
    assert [model.actuator(k).name for k in range(3)] == ["a1", "a--2", "a3"]
    assert model.actuator_ctrllimited.all()
    ends = [1.5, 0.75, np.deg2rad(120.0)]
    np.testing.assert_allclose(model.actuator_ctrlrange, [[-end, end] for end in ends], rtol=1e-6)


def test_keyframes_are_there_again_with_goals_for_controls(tmp_path: Path) -> None:
    """`home` was gone."""
    model, _ = written(tmp_path)
    assert [model.key(k).name for k in range(model.nkey)] == ["home", "up"]
    np.testing.assert_allclose(model.key("home").qpos, [0.1, 0.3, -0.5])
    np.testing.assert_allclose(model.key("home").ctrl, [0.1, 0.075, -0.5], rtol=1e-6)  # a3 holds where it stands
    np.testing.assert_allclose(model.key("up").qpos, [0.0, 0.0, 1.0])


def test_the_first_line_tells_whose_controls_mean_something_else(tmp_path: Path) -> None:
    """It said that nothing was left out, and a motor had become a position servo."""
    _, line = written(tmp_path)
    assert "Left out: nothing. Otherwise than in arm.xml: " in line and line.endswith("-->")
    assert "the control of a- -2 is a position goal of j2; the control of a3 is a position goal of j3" in line
    assert "control of a1" not in line


def test_a_model_whose_controls_are_goals_says_nothing_more(tmp_path: Path) -> None:
    _, line = written(tmp_path, rows="{j1: {chain: sts3215}}")
    assert "Left out: actuator: a- -2, a3. -->" in line


def test_motors_keep_the_range_of_the_files_as_torques(tmp_path: Path) -> None:
    model, line = written(tmp_path, TORQUE)
    assert model.actuator("a3").ctrllimited[0] and not model.actuator("a1").ctrllimited[0]
    np.testing.assert_allclose(model.actuator("a3").ctrlrange, [-6.0, 6.0])
    np.testing.assert_allclose(model.key("home").ctrl, [0.0, 0.0, 3.0])
    assert "the control of a1 is a torque of j1" in line and "the control of a3 is a torque of j3" in line


@pytest.mark.parametrize("base", ["", "<freejoint/>", '<freejoint name="root"/>'])
def test_joints_that_chains_add_and_a_free_base_stand_as_in_the_keyframe(base: str, tmp_path: Path) -> None:
    place = "1 2 3 0 1 0 0 " if base else ""
    key = f'<keyframe><key name="home" qpos="{place}0.1 0.3 -0.5"/></keyframe>'
    model, _ = written(tmp_path, SPRINGY, base, rest=key)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    plain = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    there = mujoco.MjData(plain)
    mujoco.mj_resetDataKeyframe(plain, there, 0)
    mujoco.mj_forward(plain, there)
    assert model.nq == plain.nq + 3
    for body in ("base", "b1", "b2", "b3"):
        np.testing.assert_allclose(data.body(body).xpos, there.body(body).xpos, atol=1e-6)
        np.testing.assert_allclose(data.body(body).xmat, there.body(body).xmat, atol=1e-6)


def test_what_cannot_be_kept_is_named(tmp_path: Path) -> None:
    thruster = '<general name="thrust" site="tip" gear="0 0 1 0 0 0"/>'
    rest = '<sensor><actuatorpos name="felt" actuator="a1"/></sensor>' + KEYS.replace(
        'qpos="0 0 1"', 'qpos="0 0 1" qvel="1 0 0"'
    )
    rows = "{j1: {chain: sts3215}, j2: {chain: sts3215}}"
    model, line = written(tmp_path, actuators=thruster, rest=rest, rows=rows)
    assert model.nu == 2 and model.nsensor == 0
    assert "actuator: a3, thrust; sensor of an actuator: felt; speeds of keyframe up." in line


def test_an_arm_without_actuators_has_the_range_of_its_goals(tmp_path: Path) -> None:
    rows = "{j1: {chain: sts3215, range: [-0.2, 0.4]}, j2: {chain: sts3215}, j3: {chain: sts3215}}"
    model, line = written(tmp_path, rows=rows, bare=True)
    np.testing.assert_allclose(model.actuator("j1").ctrlrange, [-0.2, 0.4])
    assert "Left out: nothing. -->" in line
