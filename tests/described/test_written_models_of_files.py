"""Model files of all kinds: what is read from them moves, and what is written from them MuJoCo simulates by itself."""

from __future__ import annotations

import struct
from pathlib import Path

import mujoco
import numpy as np
import pytest
import yaml
from sealegs.actuators.chain import load_chain
from sealegs.envs.described.as_robot import as_robot
from sealegs.envs.described.model_meshes import without_meshes_that_fail
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.engine.numbers import RobotError
from sealegs.envs.extended import Extended, Mounted
from sealegs.gap.load import robot as robots
from sealegs.gap.log.reader import read_measured
from sealegs.gap.output.mjcf import native_text, not_native
from sealegs.gap.output.robot_mjcf import write_robot

SERVO = [{"ideal": {"stiffness": 100.0, "damping": 5.0}}]
ARM = '<body name="u" pos="0 0 1"><joint name="s" axis="0 1 0"/><geom name="g" {}/><site name="tip"/></body>'
ROUND, MESH = ARM.format('size=".1"'), ARM.format('type="mesh" mesh="m"')
CUBE = '<body name="cube"><freejoint/><geom name="c" size=".1"/><site name="side"/></body>'


def solid(path: Path) -> None:
    """A tetrahedron as STL."""
    corners = 0.4 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    path.parent.mkdir(parents=True, exist_ok=True)
    sides = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
    rows = [struct.pack("<12fH", 0, 0, 0, *corners[list(side)].ravel(), 0) for side in sides]
    path.write_bytes(b"\0" * 80 + struct.pack("<I", len(rows)) + b"".join(rows))


def model_file(folder: Path, world: str, rest: str = "", before: str = "") -> Path:
    path = folder / "arm.xml"
    path.write_text(f"<mujoco>{before}<worldbody>{world}</worldbody>{rest}</mujoco>")
    return path


def written(path: Path, joint: str = "s") -> mujoco.MjModel:
    """What a diagnosis of a log of the robot writes, as plain MuJoCo reads it."""
    rows = "".join(f"{0.01 * k},0,0\n" for k in range(200))
    (path.parent / "run.csv").write_text(f"time,{joint}.goal,{joint}.position\n{rows}")
    (path.parent / "run.yaml").write_text(yaml.safe_dump({"robot": path.name, "actuators": {joint: SERVO}}))
    data = read_measured(path.parent)
    robot = robots.robot_of(data.runs[0])
    assert robot is not None
    chains = {joint: (Mounted(load_chain(SERVO), f"{joint}.yaml"),)}
    (path.parent / "out").mkdir()
    extended = Extended(data.runs[0].robot, {}, chains, (), digest=robot.file.model.digest)
    staged = path.parent / "out" / "staged"
    staged.mkdir()
    file = write_robot(extended, data, staged, path.parent / "out")
    assert file is not None
    assert str(path.parent) not in file.read_text(encoding="utf-8")  # it goes where its folder goes
    file = file.rename(path.parent / "out" / file.name)
    return mujoco.MjModel.from_xml_path(str(file))


@pytest.mark.parametrize(
    ("chain", "defaults"),
    [
        (SERVO, '<position ctrlrange="-.1 .1"/>'),
        (SERVO, '<motor gear="2" forcerange="-1 1"/><default class="a"><general gear="3"/></default>'),
        ("sts3215", '<general gear="2" ctrlrange="-.1 .1" forcerange="-1 1"/>'),
        ([{"torque_command": {}}], '<general gear="2" ctrlrange="-.1 .1" forcerange="-1 1"/>'),
    ],
)
def test_a_written_actuator_has_no_limit_and_no_gear_of_the_files_own_actuators(
    chain: str | list[dict], defaults: str, tmp_path: Path
) -> None:
    """A position goal of 3 rad was clamped at 0.1 rad, and a gear of 2 doubled each torque."""
    actuators = '<actuator><position joint="s" kp="9" gear="1" ctrlrange="-3 3" forcerange="-9 9"/></actuator>'
    path = model_file(tmp_path, ROUND, actuators, f"<default>{defaults}</default>")
    drivetrain = as_robot(load_robot_file(path)).drivetrain({"s": load_chain(chain)})
    text = native_text(drivetrain.spec.to_xml(), drivetrain.chains)
    (tmp_path / "plain").mkdir()
    plain = as_robot(load_robot_file(model_file(tmp_path / "plain", ROUND, actuators))).drivetrain(
        {"s": load_chain(chain)}
    )
    models = [
        mujoco.MjModel.from_xml_string(native_text(item.spec.to_xml(), item.chains)) for item in (drivetrain, plain)
    ]
    assert "<general" not in text
    for key in [name for name in dir(models[0]) if name.startswith("actuator_")]:
        np.testing.assert_array_equal(getattr(models[0], key), getattr(models[1], key), err_msg=key)


def test_a_written_motor_joint_and_tendon_have_nothing_of_the_default_classes_of_the_file(tmp_path: Path) -> None:
    inner = '<joint damping="5" range="-30 30"/><tendon frictionloss="1"/>'
    main = '<joint damping="2 1" frictionloss=".5" armature=".1" stiffness="3" range="-60 60"/><tendon stiffness="4"/>'
    before = f'<default>{main}<default class="a">{inner}</default></default>'
    forearm = (
        '<body name="f"><joint name="e" axis="0 1 0" damping="0" frictionloss="0"/><geom size=".1"/></body></body>'
    )
    world = ROUND.replace('name="u"', 'name="u" childclass="a"').replace("</body>", forearm)
    springy = load_chain([{"ideal": {**SERVO[0]["ideal"], "armature": 0.05}}, {"compliance": {"stiffness": 300.0}}])
    robot = as_robot(load_robot_file(model_file(tmp_path, world, before=before)))
    drivetrain = robot.drivetrain({"s": load_chain(SERVO), "e": springy})
    plain = mujoco.MjModel.from_xml_string(native_text(drivetrain.spec.to_xml(), drivetrain.chains))
    names = [name for name in dir(plain) if name.startswith(("jnt_", "dof_", "tendon_")) and "actfrc" not in name]
    assert plain.joint("e_motor").damping[0] == 0.0 and not plain.joint("e_motor").limited
    for key in names:
        np.testing.assert_allclose(getattr(plain, key), getattr(drivetrain.model, key), rtol=1e-4, err_msg=key)


def test_a_written_model_finds_a_height_field_where_it_lies(tmp_path: Path) -> None:
    (tmp_path / "assets").mkdir()
    heights = np.linspace(0.0, 1.0, 9, dtype=np.float32)
    (tmp_path / "assets/h.bin").write_bytes(struct.pack("<2i", 3, 3) + heights.tobytes())
    before = (
        '<compiler meshdir="assets"/><asset><hfield name="h" file="h.bin" size="1 1 1 1" '
        'content_type="image/vnd.mujoco.hfield"/></asset>'
    )
    path = model_file(tmp_path, f'<geom type="hfield" hfield="h" pos="0 0 -3"/>{ROUND}', before=before)
    assert written(path).nhfield == 1


def test_a_written_model_is_found_complete_where_its_folder_and_the_models_are_moved_to(tmp_path: Path) -> None:
    before = '<compiler meshdir="meshes"/><asset><mesh name="m" file="m.stl"/></asset>'
    first = tmp_path / "first"
    solid(first / "meshes/m.stl")
    assert written(model_file(first, MESH, before=before)).nmesh == 1
    moved = first.rename(tmp_path / "moved")
    assert mujoco.MjModel.from_xml_path(str(moved / "out" / "extended.xml")).nmesh == 1


ATTACHED = '<frame pos="0 0 .2"><attach model="c" body="u" prefix="L_"/></frame>'


def attaching(folder: Path) -> Path:
    """A model with a mesh of its own, to which another one is attached that has its mesh in folders of its own."""
    solid(folder / "mm/o.stl")
    child = folder / "child/c.xml"
    child.parent.mkdir()
    asset = '<compiler meshdir="assets"/><asset><mesh name="m" file="m.stl"/></asset>'
    child.write_text(f"<mujoco>{asset}<worldbody>{MESH}</worldbody></mujoco>")
    before = (
        '<compiler meshdir="mm"/><asset><mesh name="own" file="o.stl"/><model name="c" file="child/c.xml"/></asset>'
    )
    return model_file(folder, f'<body name="base"><geom type="mesh" mesh="own"/>{ATTACHED}</body>', before=before)


def test_an_attached_model_keeps_meshes_in_folders_of_its_own(tmp_path: Path) -> None:
    """It was refused: the mesh of the attached model was looked for in the folder of the other."""
    path = attaching(tmp_path)
    solid(tmp_path / "child/assets/m.stl")
    assert written(path, "L_s").nmesh == 2
    assert not any("mesh" in sentence for sentence in load_robot_file(path).said)


@pytest.mark.parametrize("text", [None, "not a solid"])
def test_of_an_attached_model_only_the_mesh_that_fails_is_named(text: str | None, tmp_path: Path) -> None:
    path = attaching(tmp_path)
    if text is not None:
        (tmp_path / "child/assets").mkdir()
        (tmp_path / "child/assets/m.stl").write_text(text)
    reason = "is not there" if text is None else "MuJoCo cannot read"
    with pytest.raises(RobotError, match=f"body 'L_u' takes its mass from m.stl, which {reason}"):
        without_meshes_that_fail(mujoco.MjSpec.from_file(str(path)), path, [], [])


@pytest.mark.parametrize(
    ("world", "rest"),
    [
        ('<camera mode="targetbody" target="cube"/><light mode="targetbodycom" target="cube"/>', ""),
        ("", '<sensor><framepos objtype="site" objname="side" reftype="body" refname="u"/></sensor>'),
        ("", '<contact><exclude body1="cube" body2="u"/><pair geom1="g" geom2="c"/></contact>'),
        ("", '<equality><connect site1="tip" site2="side"/></equality>'),
        ("", '<tendon><spatial><site site="tip"/><site site="side"/></spatial></tendon>'),
        ("", '<keyframe><key qpos="0 0 0 0 1 0 0 0"/></keyframe>'),
    ],
)
def test_what_refers_to_an_object_of_the_scene_goes_with_it(world: str, rest: str, tmp_path: Path) -> None:
    """A camera that looked at the object ended in a traceback."""
    file = load_robot_file(model_file(tmp_path, world + ROUND + CUBE, rest))
    assert robots.without_objects(file, {}).nbody == 2


def test_a_model_that_does_not_compile_without_its_objects_is_refused_in_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = load_robot_file(model_file(tmp_path, ROUND + CUBE))

    def broken(root: mujoco.MjsBody, driven: set[str]) -> bool:
        if root.name == "u":
            root.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="none")
        return root.name == "cube"

    monkeypatch.setattr(robots, "_is_object", broken)
    with pytest.raises(RobotError, match=r"arm\.xml does not compile without the objects .*\(cube\): .*none.*; take"):
        robots.without_objects(file, {})


MOTOR_ARM = """<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody>
<body name="u"><joint name="s" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.5"/></body></worldbody></mujoco>"""
FAULTS = {
    "a weak motor": [{"scale": {"factor": 0.8}}, {"torque_command": {"armature": 0.02}}],
    "a late command": [{"delay": {"seconds": 0.02}}, {"torque_command": {"armature": 0.02}}],
    "a bias": [{"torque_command": {"armature": 0.02}}, {"offset": {"value": 0.05}}],
    "a limit before a factor": [
        {"torque_command": {"armature": 0.02}}, {"torque_limit": {"limit": 0.3}}, {"scale": {"factor": 0.5}}
    ],
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_plain_mujoco_moves_as_the_chain_does(fault: str, tmp_path: Path) -> None:
    """The motor was written bare: the weak slide that had been named moved as a strong one."""
    path = tmp_path / "arm.xml"
    path.write_text(MOTOR_ARM)
    chain = load_chain(FAULTS[fault])
    drivetrain = as_robot(load_robot_file(path)).drivetrain({"s": chain})
    assert not_native(chain) == []
    plain = mujoco.MjModel.from_xml_string(native_text(drivetrain.spec.to_xml(), drivetrain.chains))
    ends = []
    for model in (drivetrain.model, plain):
        data = mujoco.MjData(model)
        for k in range(400):
            data.ctrl[:] = 0.4 * (k > 50) * np.sign(np.sin(2.0 * np.pi * 5.0 * k * 1e-3) + 0.2)
            mujoco.mj_step(model, data)
        ends.append([data.qpos[0], data.qvel[0]])
    np.testing.assert_allclose(*ends, rtol=0.01)
    assert np.abs(ends[0]).max() > 0.04


KEYED_ARM = """<mujoco model="arm"><compiler angle="degree" autolimits="true"/>
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
KEYED_SERVO = [{"ideal": {"stiffness": 30.0, "damping": 2.0, "armature": 0.01}}]
TORQUE = [{"torque_command": {"armature": 0.01}}]
SPRINGY = [*KEYED_SERVO, {"compliance": {"stiffness": 300.0, "damping": 1.0}}]


def extended(
    folder: Path,
    chain: list[dict] = KEYED_SERVO,
    base: str = "",
    actuators: str = "",
    rest: str = KEYS,
    rows: str = "",
    bare: bool = False,
) -> tuple[mujoco.MjModel, str]:
    """The model that a diagnosis writes, and its first line."""
    text = KEYED_ARM.format(base=base, actuators=actuators, rest=rest)
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
    model, _ = extended(tmp_path)
    assert [model.actuator(k).name for k in range(3)] == ["a1", "a--2", "a3"]
    assert model.actuator_ctrllimited.all()
    ends = [1.5, 0.75, np.deg2rad(120.0)]
    np.testing.assert_allclose(model.actuator_ctrlrange, [[-end, end] for end in ends], rtol=1e-6)


def test_keyframes_are_there_again_with_goals_for_controls(tmp_path: Path) -> None:
    """`home` was gone."""
    model, _ = extended(tmp_path)
    assert [model.key(k).name for k in range(model.nkey)] == ["home", "up"]
    np.testing.assert_allclose(model.key("home").qpos, [0.1, 0.3, -0.5])
    np.testing.assert_allclose(model.key("home").ctrl, [0.1, 0.075, -0.5], rtol=1e-6)  # a3 holds where it stands
    np.testing.assert_allclose(model.key("up").qpos, [0.0, 0.0, 1.0])


def test_the_first_line_tells_whose_controls_mean_something_else(tmp_path: Path) -> None:
    """It said that nothing was left out, and a motor had become a position servo."""
    _, line = extended(tmp_path)
    assert "Left out: nothing. Otherwise than in arm.xml: " in line and line.endswith("-->")
    assert "the control of a- -2 is a position goal of j2; the control of a3 is a position goal of j3" in line
    assert "control of a1" not in line


def test_a_model_whose_controls_are_goals_says_nothing_more(tmp_path: Path) -> None:
    _, line = extended(tmp_path, rows="{j1: {chain: sts3215}}")
    assert "Left out: actuator: a- -2, a3. -->" in line


def test_motors_keep_the_range_of_the_files_as_torques(tmp_path: Path) -> None:
    model, line = extended(tmp_path, TORQUE)
    assert model.actuator("a3").ctrllimited[0] and not model.actuator("a1").ctrllimited[0]
    np.testing.assert_allclose(model.actuator("a3").ctrlrange, [-6.0, 6.0])
    np.testing.assert_allclose(model.key("home").ctrl, [0.0, 0.0, 3.0])
    assert "the control of a1 is a torque of j1" in line and "the control of a3 is a torque of j3" in line


@pytest.mark.parametrize("base", ["", "<freejoint/>", '<freejoint name="root"/>'])
def test_joints_that_chains_add_and_a_free_base_stand_as_in_the_keyframe(base: str, tmp_path: Path) -> None:
    place = "1 2 3 0 1 0 0 " if base else ""
    key = f'<keyframe><key name="home" qpos="{place}0.1 0.3 -0.5"/></keyframe>'
    model, _ = extended(tmp_path, SPRINGY, base, rest=key)
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
    model, line = extended(tmp_path, actuators=thruster, rest=rest, rows=rows)
    assert model.nu == 2 and model.nsensor == 0
    assert "actuator: a3, thrust; sensor of an actuator: felt; speeds of keyframe up." in line


def test_an_arm_without_actuators_has_the_range_of_its_goals(tmp_path: Path) -> None:
    rows = "{j1: {chain: sts3215, range: [-0.2, 0.4]}, j2: {chain: sts3215}, j3: {chain: sts3215}}"
    model, line = extended(tmp_path, rows=rows, bare=True)
    np.testing.assert_allclose(model.actuator("j1").ctrlrange, [-0.2, 0.4])
    assert "Left out: nothing. -->" in line
