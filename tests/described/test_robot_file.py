"""A robot as data: what a YAML and a model file say becomes one machine in which no number counts twice."""

import textwrap
from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.common.errors import SealegsError
from sealegs.envs.contract import robot_hash
from sealegs.envs.described.as_robot import as_robot, bare_model
from sealegs.envs.described.model_sources import files_read
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.engine.numbers import RobotError
from sealegs.envs.new_robot.robot_yaml import robot_yaml
from sealegs.envs.robots import get_robot

ROBOTS = Path(__file__).parents[1] / "robots"
ARM = ROBOTS / "arm.yaml"

URDF = """
<robot name="lift">
  <joint name="weld" type="fixed"><parent link="world"/><child link="base"/></joint>
  <link name="base">{visual}</link>
  <link name="column">{inertial}{visual}</link>
  <link name="jaw">{inertial}</link>
  <link name="twin">{inertial}</link>
  <joint name="rise" type="prismatic"><parent link="base"/><child link="column"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.3" effort="40" velocity="1"/><dynamics damping="5" friction="2"/></joint>
  <joint name="grip" type="revolute"><parent link="column"/><child link="jaw"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="2" velocity="5"/></joint>
  <joint name="mirror" type="revolute"><parent link="column"/><child link="twin"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="2" velocity="5"/><mimic joint="grip" multiplier="-1"/></joint>
</robot>
""".format(
    inertial='<inertial><mass value="0.5"/>'
    '<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>',
    visual='<collision><geometry><mesh filename="package://lift/meshes/part.stl"/></geometry></collision>',
)


def write(folder: Path, name: str, text: str) -> Path:
    (folder / name).write_text(textwrap.dedent(text))
    return folder / name


def test_a_drive_has_friction_damping_and_armature_once_and_the_chain_is_where() -> None:
    model = get_robot(ARM).drivetrain().model
    sts3215 = load_chain("sts3215")
    np.testing.assert_allclose(model.dof_damping, sts3215.value("friction.viscous"))
    np.testing.assert_allclose(model.dof_frictionloss, sts3215.value("friction.coulomb"))
    np.testing.assert_allclose(model.dof_armature, sts3215.armature())
    bare = bare_model(load_robot_file(ARM))
    assert not bare.dof_damping.any() and not bare.dof_frictionloss.any() and not bare.dof_armature.any()


@pytest.mark.parametrize("key", ["damping", "armature", "frictionloss"])
def test_the_file_can_own_a_number_which_the_chain_then_carries(key: str, tmp_path: Path) -> None:
    write(tmp_path, "arm.xml", (ROBOTS / "arm.xml").read_text())
    path = write(tmp_path, "arm.yaml", f"model: arm.xml\njoints:\n  elbow: {{chain: sts3215, {key}: file}}\n")
    elbow = load_robot_file(path).joint("elbow")
    model = get_robot(path).drivetrain().model
    dof = model.joint("elbow").dofadr[0]
    assert getattr(model, f"dof_{key}")[dof] == pytest.approx(elbow.model_values[key])
    ours = (
        elbow.chain.armature()
        if key == "armature"
        else elbow.chain.value({"damping": "friction.viscous", "frictionloss": "friction.coulomb"}[key])
    )
    assert ours == pytest.approx(elbow.model_values[key])


def test_what_stands_in_both_is_said_where_the_yaml_does_not_choose(tmp_path: Path) -> None:
    write(tmp_path, "arm.xml", (ROBOTS / "arm.xml").read_text())
    path = write(tmp_path, "arm.yaml", "model: arm.xml\njoints: {elbow: {chain: sts3215}}\n")
    said = " ".join(load_robot_file(path).said)
    damping = "damping is 0.3 in arm.xml and 0.059 in its chain, 5.1 times less; the chain's counts"
    assert f"Warning: joint elbow: {damping}" in said and "Warning: joint elbow: armature" not in said
    assert "the actuators shoulder drive nothing here" in said
    assert load_robot_file(path).joint("elbow").owners["armature"] == "chain"


def test_another_chain_on_the_command_line_gets_what_the_file_owns_unless_it_says_so_itself() -> None:
    bare = get_robot(ROBOTS / "arm.xml")
    assert bare.drivetrain("ideal").model.dof_damping == pytest.approx([0.3, 0.3])
    assert bare.drivetrain("sts3215").model.dof_damping == pytest.approx([0.059, 0.059])


def test_a_bare_model_keeps_its_position_actuators_as_ideal_servos_and_moves_as_before() -> None:
    file = load_robot_file(ROBOTS / "arm.xml")
    assert [joint.name for joint in file.joints] == ["shoulder", "elbow"]
    assert "an ideal servo of 12 N.m/rad" in " ".join(file.said)
    ours = get_robot(ROBOTS / "arm.xml").drivetrain().model
    theirs = mujoco.MjModel.from_xml_path(str(ROBOTS / "arm.xml"))
    theirs.opt.integrator, theirs.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, ours.opt.timestep
    ends = []
    for model in (ours, theirs):
        data = mujoco.MjData(model)
        data.ctrl[:] = 0.5, -0.3
        mujoco.mj_step(model, data, 400)
        ends.append(data.qpos.copy())
    np.testing.assert_allclose(ends[0], ends[1], atol=2e-3)  # dry friction is stiffer than MuJoCo's default


def test_a_urdf_with_a_slide_a_mimic_joint_a_missing_mesh_and_an_undeclared_world_is_read(tmp_path: Path) -> None:
    file = load_robot_file(write(tmp_path, "lift.urdf", URDF))
    assert [(joint.name, joint.kind, joint.range) for joint in file.joints] == [
        ("rise", "slide", (0.0, 0.3)),
        ("grip", "hinge", (-1.0, 1.0)),
    ]
    assert file.model.followers == {"mirror": "grip"} and not file.coupled
    said = " ".join(file.said)
    assert "taken for the ground" in said and "these meshes are not there: part.stl;" in said
    drivetrain = as_robot(file).drivetrain()
    data = mujoco.MjData(drivetrain.model)
    data.ctrl[:] = 0.2, 0.5
    mujoco.mj_step(drivetrain.model, data, 1500)
    rise, grip, mirror = (float(data.joint(name).qpos[0]) for name in ("rise", "grip", "mirror"))
    assert rise == pytest.approx(0.2, abs=0.03) and grip == pytest.approx(0.5, abs=0.05)
    assert mirror == pytest.approx(-grip, abs=0.01)


def test_numbers_of_bodies_stops_and_tilt_act_on_the_model() -> None:
    robot = get_robot(ARM)
    believed = robot.drivetrain().model
    params = {"forearm_mass": 0.36, "elbow_upper_stop": 0.4, "tilt_y": 0.1, "forearm_centre_z": -0.2}
    found = robot.drivetrain(params=params).model
    body = found.body("forearm").id
    assert found.body_mass[body] == pytest.approx(0.36) and found.body_ipos[body][2] == pytest.approx(-0.2)
    np.testing.assert_allclose(found.body_inertia[body], 2.0 * believed.body_inertia[body])
    assert found.joint("elbow").range[1] == pytest.approx(0.4)
    assert found.opt.gravity == pytest.approx([9.81 * np.sin(0.1), 0.0, -9.81 * np.cos(0.1)])
    assert robot_hash(robot, params) != robot_hash(robot)


@pytest.mark.parametrize("stiffness", [150.0, 500.0])
def test_a_stop_of_a_robot_is_as_hard_as_it_was_found(stiffness: float) -> None:
    robot = get_robot(ARM)
    drivetrain = robot.drivetrain(params={"elbow_upper_stop": 0.4, "elbow_stop_stiffness": stiffness})
    data = mujoco.MjData(drivetrain.model)
    data.ctrl[[item.name for item in drivetrain.coordinates].index("elbow")] = 1.0
    mujoco.mj_step(drivetrain.model, data, 2000)
    beyond = float(data.joint("elbow").qpos[0]) - 0.4
    against = -float(data.qfrc_constraint[drivetrain.model.joint("elbow").dofadr[0]])
    assert against > 1.0 and against == pytest.approx(stiffness * beyond, rel=0.05)
    (ends,) = {tuple(model.jnt_range[1]) for model in (drivetrain.model, drivetrain.spec.copy().compile())}
    assert ends[1] == pytest.approx(0.4)


def test_two_models_of_one_name_are_two_robots(tmp_path: Path) -> None:
    hashes = set()
    for folder, mass in (("a", "0.1"), ("b", "0.2")):
        (tmp_path / folder).mkdir()
        write(
            tmp_path / folder,
            "arm.xml",
            (ROBOTS / "arm.xml").read_text().replace('0.15" mass="0.1"', f'0.15" mass="{mass}"'),
        )
        write(tmp_path / folder, "arm.yaml", ARM.read_text())
        hashes.add(robot_hash(get_robot(tmp_path / folder / "arm.yaml")))
    assert len(hashes) == 2


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("model: none.xml", "there is no model .*none.xml"),
        ("joints: {elbow: {}}", "model is missing"),
        ("model: arm.xml\njoint: {elbow: {}}", r"joint is unknown \(did you mean 'joints'\?\)"),
        ("model: arm.xml\njoints: {elbo: {}}", r"no hinge or slide 'elbo' \(did you mean 'elbow'\?\)"),
        ("model: arm.xml\njoints: {elbow: {chian: sts3215}}", r"joints.elbow.chian is unknown \(did you mean 'chain'"),
        ("model: arm.xml\njoints: {elbow: {chain: sts321}}", r"joints.elbow.chain: there is no actuator 'sts321'"),
        ("model: arm.xml\njoints: {elbow: {range: [1, -1]}}", "range is 1 to -1; it goes from its low"),
        ("model: arm.xml\njoints: {elbow: {damping: both}}", "joints.elbow.damping takes 'chain' or 'file'"),
        ("model: arm.xml\njoints: {elbow: {unknown: [payload]}}", "unknown holds 'payload'.*; words are zero"),
        ("model: arm.xml\njoints: {a: {joint: elbow}, b: {joint: elbow}}", "a and b both drive the joint 'elbow'"),
        ("model: arm.xml\nbase: free", "base is free, but a joint ties 'upper_arm' to the world"),
        ("model: arm.xml\ntimestep: 1.0", "timestep is 1 s; it must lie between"),
        ("model: [", "is not valid YAML"),
        ("- model", "is a mapping of model, joints"),
    ],
)
def test_what_is_wrong_in_a_file_is_told_in_a_sentence(text: str, sentence: str, tmp_path: Path) -> None:
    write(tmp_path, "arm.xml", (ROBOTS / "arm.xml").read_text())
    path = write(tmp_path, "arm.yaml", text + "\n")
    with pytest.raises(RobotError, match=sentence):
        load_robot_file(path)


def test_a_base_can_be_set_on_a_stand_or_taken_from_it(tmp_path: Path) -> None:
    write(
        tmp_path,
        "leg.xml",
        """
        <mujoco><worldbody><geom type="plane" size="1 1 1"/><body name="base" pos="0 0 1"><freejoint/>
        <geom size="0.1"/><body><joint name="hip"/><geom size="0.05" pos="0 0 -0.3"/></body></body></worldbody></mujoco>
    """,
    )
    sizes = {}
    for base in ("free", "fixed"):
        path = write(tmp_path, f"{base}.yaml", f"model: leg.xml\nbase: {base}\njoints: {{hip: {{chain: sts3215}}}}\n")
        sizes[base] = get_robot(path).drivetrain().model.nq
    assert sizes == {"free": 8, "fixed": 1}


def test_joints_that_others_carry_and_actuators_on_something_else_are_refused(tmp_path: Path) -> None:
    write(tmp_path, "lift.urdf", URDF)
    path = write(tmp_path, "lift.yaml", "model: lift.urdf\njoints: {rise: {}, mirror: {}}\n")
    with pytest.raises(RobotError, match="joint 'mirror' follows 'grip' by an equality of the model; leave it out"):
        load_robot_file(path)
    thruster = (
        (ROBOTS / "arm.xml").read_text().replace('<position name="elbow" joint="elbow"/>', '<general site="tip"/>')
    )
    thruster = thruster.replace("</body>", '<site name="tip"/></body>', 1)
    with pytest.raises(RobotError, match="acts on 'tip', which is neither a hinge, a slide nor a fixed tendon"):
        load_robot_file(write(tmp_path, "arm.xml", thruster))


def test_robots_of_python_are_the_same_kind_of_object_and_a_wrong_name_says_both_ways() -> None:
    assert type(get_robot("bench")) is type(get_robot(ARM))
    with pytest.raises(RobotError, match=r"did you mean 'bench'\?\); robots are .*bench, .* or the path of a robot's"):
        get_robot("benck")
    with pytest.raises(RobotError, match=r"there is no robot file .*nothing\.yaml; sealegs new-robot"):
        get_robot("nothing.yaml")


def test_a_payload_and_another_inertia_of_a_joint_act_on_what_the_joints_feel() -> None:
    robot = get_robot(ARM)

    def felt(**params: float) -> tuple[np.ndarray, np.ndarray]:
        model = robot.build_spec(params).compile()
        data = mujoco.MjData(model)
        data.qpos[:] = 0.3, -0.7
        mujoco.mj_forward(model, data)
        full = np.zeros((2, 2))
        mujoco.mj_fullM(model, data, full)
        return full, np.array(data.qfrc_bias)

    inertia, gravity = felt()
    loaded, heavier = felt(forearm_payload=0.05)
    text = (ROBOTS / "arm.xml").read_text()
    assert robot.file is not None
    centre = robot.file.model.bodies["forearm"].tip
    point = f'<geom type="sphere" size="1e-4" mass="0.05" pos="{" ".join(map(str, centre))}"/><geom name="weight"'
    model = mujoco.MjModel.from_xml_string(text.replace('<geom name="weight"', point))
    data = mujoco.MjData(model)
    data.qpos[:] = 0.3, -0.7
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(heavier, data.qfrc_bias, atol=1e-5)
    full = np.zeros((2, 2))
    mujoco.mj_fullM(model, data, full)
    np.testing.assert_allclose(loaded, full - np.diag(model.dof_armature), atol=1e-6)
    more, _ = felt(elbow_inertia=0.003)  # of the forearm, which the shoulder turns as well
    np.testing.assert_allclose(more - inertia, np.full((2, 2), 0.003), atol=1e-9)
    more, _ = felt(elbow_rotor=0.003)
    np.testing.assert_allclose(more - inertia, np.diag([0.0, 0.003]), atol=1e-9)
    less, same = felt(elbow_inertia=-1e-4)
    assert (inertia - less)[1, 1] == pytest.approx(1e-4, rel=1e-6)
    np.testing.assert_allclose(same, gravity, atol=1e-9)
    with pytest.raises(SealegsError, match="'forearm' would have a negative inertia"):
        felt(elbow_inertia=-1.0)


GRIPPER = """
<mujoco><compiler angle="radian" autolimits="true"/><default><geom contype="0" conaffinity="0"/></default>
<worldbody><body name="hand">
<joint name="lift" type="slide" axis="0 0 1" range="0 0.3"/><geom size="0.02" mass="0.5"/>
<body name="left">
<joint name="finger_l" type="slide" axis="1 0 0" range="0 0.03"/><geom size="0.01" mass="0.02"/></body>
<body name="right">
<joint name="finger_r" type="slide" axis="-1 0 0" range="0 0.03"/><geom size="0.01" mass="0.02"/></body>
{more}</body></worldbody>
<tendon><fixed name="split"><joint joint="finger_l" coef="0.5"/><joint joint="finger_r" coef="0.5"/></fixed></tendon>
<equality><joint joint1="finger_r" joint2="finger_l" polycoef="0 1 0 0 0"/></equality>
<actuator><position joint="lift" kp="500"/><position tendon="split" kp="300"/>{actuator}</actuator></mujoco>
"""


def test_a_tendon_over_two_fingers_of_which_one_follows_drives_the_leading_one(tmp_path: Path) -> None:
    path = write(tmp_path, "hand.xml", GRIPPER.format(more="", actuator=""))
    text, said = robot_yaml(path, tmp_path / "hand.yaml")
    (tmp_path / "hand.yaml").write_text(text)
    assert "belt: {finger_l: 1.0}" in text and "Joint finger_r is not driven: it follows finger_l" in text
    assert "nothing drives" not in " ".join(said)
    for file in (load_robot_file(path), load_robot_file(tmp_path / "hand.yaml")):
        split = file.joint("split")
        assert split.terms == (("finger_l", 1.0),) and split.range == (0.0, 0.03)
    drivetrain = as_robot(file).drivetrain()
    data = mujoco.MjData(drivetrain.model)
    data.ctrl[:] = 0.1, 0.02
    mujoco.mj_step(drivetrain.model, data, 2000)
    assert float(data.joint("finger_l").qpos[0]) == pytest.approx(0.02, abs=2e-3)
    assert float(data.joint("finger_r").qpos[0]) == pytest.approx(0.02, abs=2e-3)


def test_an_actuator_of_a_follower_is_added_to_the_drive_of_its_leader(tmp_path: Path) -> None:
    twin = '<position name="twin" joint="finger_r" kp="80"/>'
    path = write(tmp_path, "hand.xml", GRIPPER.format(more="", actuator=twin))
    text, said = robot_yaml(path, tmp_path / "hand.yaml")
    sentence = "drive it together, since an equality of the model ties finger_r to it; their gains and forces are added"
    assert sentence in " ".join(said) and "Left out" not in text
    assert load_robot_file(path).joint("split").chain.value("ideal.stiffness") == 380.0


def test_joints_that_nothing_drives_are_told_and_commented(tmp_path: Path) -> None:
    more = (
        '<body name="cable"><joint axis="0 1 0"/><geom size="0.01" mass="0.01"/>'
        '<body><joint name="head" type="ball"/><geom size="0.01" mass="0.01"/></body></body>'
        '<body><joint name="swing" axis="0 1 0"/><geom size="0.01" mass="0.01"/></body>'
    )
    path = write(tmp_path, "hand.xml", GRIPPER.format(more=more, actuator=""))
    text, said = robot_yaml(path, tmp_path / "hand.yaml")
    what = "the hinge swing, the hinge without a name on cable, the ball joint head"
    assert any(f"nothing drives {what}; such joints move freely" in sentence for sentence in said)
    assert all(f"# Nothing drives {one}: it moves freely." in text for one in what.split(", "))
    assert any(f"nothing drives {what}" in sentence for sentence in load_robot_file(path).said)


def test_the_files_of_a_robot_are_all_that_its_model_reads(tmp_path: Path) -> None:
    for folder in ("meshes", "lift/meshes", "chains"):
        (tmp_path / folder).mkdir(parents=True)
    write(tmp_path, "arm.yaml", "model: arm.xml\njoints: {elbow: {chain: chains/mine.yaml}, wrist: {chain: sts3215}}\n")
    write(tmp_path, "chains/mine.yaml", "- net: {file: mine.npz}\n")
    parts = '<mujocoinclude><compiler meshdir="meshes"/><asset><mesh file="{}.stl"/></asset></mujocoinclude>'
    write(tmp_path, "arm.xml", '<mujoco><include file="parts.xml"/></mujoco>')
    write(tmp_path, "parts.xml", parts.format("link"))
    write(tmp_path, "lift/lift.urdf", URDF)
    files = ("chains/mine.npz", "meshes/link.stl", "lift/meshes/part.stl", "meshes/other.stl")
    for name in files:
        write(tmp_path, name, name)
    of_yaml = {"arm.yaml", "arm.xml", "parts.xml", "chains/mine.yaml", *files[:2]}
    found = files_read([str(tmp_path / "arm.yaml"), "bench", "A sentence that is no path.xml" * 20])
    assert {path.relative_to(tmp_path.resolve()).as_posix() for path in found} == of_yaml
    (urdf, mesh) = files_read([str(tmp_path / "lift" / "lift.urdf")])
    assert (urdf.name, mesh.name) == ("lift.urdf", "part.stl")
    write(tmp_path, "arm.xml", "<mujoco>")
    assert len(files_read([str(tmp_path / "arm.xml")])) == 1, "that it is damaged is said where it is read"
