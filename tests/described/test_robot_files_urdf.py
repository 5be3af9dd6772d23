"""What new-robot makes of a model: of URDF, of its drives and its gains."""

from __future__ import annotations

import math
import re
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.commands import new_robot
from sealegs.configs.compose import compose
from sealegs.envs.contract import ContractError, make_contract
from sealegs.envs.described.as_robot import bare_model
from sealegs.envs.described.model_file import read_model
from sealegs.envs.described.model_sources import files_read
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.engine.numbers import RobotError
from sealegs.envs.robots import get_robot
from sealegs.gap.log.types import OTHER
from sealegs.hw.machine.own_robot import READERS
from sealegs.hw.machine.robot import build_robot

GOOD = 'ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"'
URDF = """<robot name="arm"><link name="{root}"/>{head}
<link name="upper"><inertial><mass value="0.3"/><inertia {inertia}/></inertial>{shape}</link>
<joint name="yaw" type="{kind}"><parent link="{root}"/><child link="upper"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="3" velocity="6"{limit}/></joint>{more}</robot>"""
FIXED = '<joint name="weld" type="fixed"><parent link="upper"/><child link="hand"/></joint>'
MESH = '<collision><geometry><mesh filename="{}"/></geometry></collision>'
CORNERS = ("0 0 0", "1 0 0", "0 1 0", "0 0 1")
SOLID = "".join(f"v {corner}\n" for corner in CORNERS) + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
FLAT = SOLID.replace("v 0 0 1", "v 1 1 0")


def urdf(folder: Path, **more: str) -> Path:
    given = {"root": "base", "head": "", "inertia": GOOD, "shape": "", "kind": "revolute", "limit": "", "more": ""}
    path = folder / "arm.urdf"
    path.write_text(URDF.format(**given | more))
    return path


def test_a_folder_of_meshes_that_a_urdf_names_for_mujoco_is_looked_into(tmp_path: Path) -> None:
    head = '<mujoco><compiler meshdir="parts" strippath="true" discardvisual="false"/></mujoco>'
    path = urdf(tmp_path, head=head, shape=MESH.format("package://other/solid.obj"))
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "solid.obj").write_text(SOLID)
    robot = load_robot_file(path)
    assert robot.model.spec().compile().nmesh == 1 and "not there" not in " ".join(robot.said)
    assert (tmp_path / "parts" / "solid.obj").resolve() in files_read([str(path)])


def test_a_floating_joint_on_a_root_link_of_any_name_is_a_free_base(tmp_path: Path) -> None:
    arm = urdf(tmp_path, root="trunk").read_text()
    base = '<robot name="arm"><link name="footprint"/><joint name="float" type="floating"><parent link="footprint"/>'
    trunk = f'<link name="trunk"><inertial><mass value="1"/><inertia {GOOD}/></inertial></link>'
    arm = arm.replace('<robot name="arm"><link name="trunk"/>', f'{base}<child link="trunk"/></joint>{trunk}')
    (tmp_path / "arm.urdf").write_text(arm)
    robot = load_robot_file(tmp_path / "arm.urdf")
    assert robot.base == "free" and robot.model.root == "trunk"
    assert "a floating joint hangs on its root link 'footprint'; that is taken for the ground" in " ".join(robot.said)


def test_a_prefix_that_nothing_declares_is_passed_over(tmp_path: Path) -> None:
    path = urdf(tmp_path, limit=' drake:acceleration="2"', more='<drake:joint name="x"/><gazebo/>')
    assert list(read_model(path).joints) == ["yaw"]


@pytest.mark.parametrize(("before", "after"), [("\n\n", ""), ("", "\n\0"), ("\ufeff", "")])
def test_what_stands_before_the_declaration_or_behind_the_end_is_passed_over(
    before: str, after: str, tmp_path: Path
) -> None:
    path = urdf(tmp_path)
    path.write_text(f'{before}<?xml version="1.0"?>\n{path.read_text()}{after}', encoding="utf-8")
    assert list(read_model(path).joints) == ["yaw"]


def test_elements_of_xacro_are_said_to_count_for_nothing(tmp_path: Path) -> None:
    path = urdf(tmp_path, more='<xacro:arm side="left"/>')
    assert "expand them: xacro arm.urdf > robot.urdf" in " ".join(load_robot_file(path).said)


@pytest.mark.parametrize(("file", "text"), [("a.dae", "<COLLADA/>"), ("a.stl", "not\n"), ("a.obj", FLAT)])
def test_a_mesh_that_cannot_be_read_is_left_out_where_the_link_has_an_inertia(
    file: str, text: str, tmp_path: Path
) -> None:
    (tmp_path / file).write_text(text)
    (tmp_path / "solid.obj").write_text(SOLID)
    path = urdf(tmp_path, shape=MESH.format(file) + MESH.format("solid.obj"))
    robot = load_robot_file(path)
    assert f"arm.urdf: MuJoCo cannot read these meshes: {file}; bodies move without them" in " ".join(robot.said)
    assert bare_model(robot).ngeom == 1
    bodies = '<body name="upper"><joint name="yaw"/><geom type="mesh" mesh="m"/></body>'
    model = f'<mujoco><asset><mesh name="m" file="{file}"/></asset><worldbody>{bodies}</worldbody></mujoco>'
    (tmp_path / "arm.xml").write_text(model)
    with pytest.raises(
        RobotError, match=r"body 'upper' takes its mass from a\.\w+, which MuJoCo cannot read; give it as"
    ):
        read_model(tmp_path / "arm.xml")


@pytest.mark.parametrize(
    "inertia",
    [
        pytest.param(GOOD.replace('izz="1e-3"', 'izz="3e-3"'), id="one moment above the sum of the others"),
        pytest.param(GOOD.replace('ixx="1e-3"', 'ixx="-1e-4"'), id="below 0"),
        pytest.param(" ".join(f'i{axes}="1e-6"' for axes in ("xx", "yy", "zz", "xy", "xz", "yz")), id="of a rod"),
        pytest.param(GOOD.replace("1e-3", "0"), id="of a point"),
    ],
)
def test_the_nearest_possible_inertia_takes_the_place_of_one_that_no_body_has(inertia: str, tmp_path: Path) -> None:
    """Four of ten public quadrupeds have such numbers: they were refused, and had to be mended by hand."""
    robot = load_robot_file(urdf(tmp_path, inertia=inertia))
    (said,) = [sentence for sentence in robot.said if sentence.startswith("Warning: arm.urdf: no body has the inertia")]
    assert "'upper'" in said
    model = robot.model.spec().compile()
    small, middle, large = np.sort(model.body("upper").inertia)
    assert small > 0.0 and small + middle >= large and model.body("upper").mass[0] == 0.3
    written = [float(number) for number in re.findall(r'i[xyz]{2}="([^"]+)"', inertia)]
    assert large <= max(*np.abs(written) * 1.5, 3e-4)


def test_a_possible_inertia_stays_as_it_is(tmp_path: Path) -> None:
    robot = load_robot_file(urdf(tmp_path, inertia=GOOD.replace('izz="1e-3"', 'izz="2e-3"')))
    assert "no body has" not in " ".join(robot.said)
    np.testing.assert_allclose(robot.model.spec().compile().body("upper").inertia, [2e-3, 1e-3, 1e-3])


def test_a_link_that_is_fixed_keeps_the_mass_of_its_point_and_of_its_impossible_inertia(tmp_path: Path) -> None:
    """Its mass was left out, which a base that was then set free lacked."""
    links = {"none": GOOD.replace("1e-3", "0"), "flat": GOOD.replace('izz="1e-3"', 'izz="2e-3"')}
    links["odd"] = GOOD.replace('"0"', '"1e-3"')
    more = "".join(
        f'<link name="{name}"><inertial><mass value="1"/><inertia {inertia}/></inertial></link>'
        f'<joint name="{name}" type="fixed"><parent link="base"/><child link="{name}"/></joint>'
        for name, inertia in links.items()
    )
    robot = load_robot_file(urdf(tmp_path, more=more))
    assert "arm.urdf: no body has the inertia of 'odd'; the nearest" in " ".join(robot.said)
    assert robot.model.mass == pytest.approx(3.3)


def test_the_line_that_balances_inertias_mends_the_urdf(tmp_path: Path) -> None:
    line = '<mujoco><compiler balanceinertia="true"/></mujoco>'
    assert (
        read_model(urdf(tmp_path, inertia=GOOD.replace('ixx="1e-3"', 'ixx="9"'), head=line)).bodies["upper"].mass == 0.3
    )


def test_a_line_of_a_urdf_is_that_of_the_file(tmp_path: Path) -> None:
    path = urdf(tmp_path, limit=' drake:acceleration="2"', kind="revolute")
    path.write_text("<!--\n\n\n-->\n" + path.read_text().replace('xyz="0 0 1"', 'xyz="0 0 up"'))
    with pytest.raises(RobotError, match=r"bad format in attribute 'xyz' Element 'axis', line 7\."):
        read_model(path)


def test_a_line_of_a_urdf_that_is_no_xml_is_that_of_the_file(tmp_path: Path) -> None:
    path = urdf(tmp_path)
    path.write_text(f'\n\n<?xml version="1.0"?>\n{path.read_text().replace("</joint>", "</link>")}')
    with pytest.raises(RobotError, match=r"is not valid XML in line 7: mismatched tag"):
        read_model(path)


def test_a_name_that_stands_twice_is_one_sentence_with_the_name_and_the_file(tmp_path: Path) -> None:
    hand = f'<link name="hand"><inertial><mass value="1"/><inertia {GOOD}/></inertial></link>'
    more = hand + FIXED.replace("weld", "yaw").replace("fixed", "continuous")
    with pytest.raises(RobotError, match=r"arm\.urdf: more than one joint is called 'yaw'; give each joint a name of"):
        read_model(urdf(tmp_path, more=more))
    with pytest.raises(RobotError, match=r"arm\.urdf: more than one link is called 'upper'; give each link a name of"):
        read_model(urdf(tmp_path, more=hand.replace("hand", "upper")))
    assert list(read_model(urdf(tmp_path, more=hand + FIXED.replace("weld", "yaw"))).joints) == ["yaw"]


def test_a_lower_limit_above_the_upper_one_is_refused_with_both_numbers(tmp_path: Path) -> None:
    """MuJoCo drops such limits, and new-robot assumed a whole turn."""
    path = urdf(tmp_path)
    path.write_text(path.read_text().replace('lower="-1" upper="1"', 'lower="-0.2" upper="-2.4"'))
    with pytest.raises(RobotError, match=r"above the upper one at 'yaw' \(lower -0\.2, upper -2\.4\); exchange them\."):
        read_model(path)
    path.write_text(path.read_text().replace("revolute", "continuous"))
    assert read_model(path).joints["yaw"].range is None


@pytest.mark.parametrize(("lower", "upper", "asked"), [(-40.1, 40.1, True), (-6.2, 6.2, False), (-1e9, 1e9, False)])
def test_limits_of_many_turns_are_asked_whether_they_are_degrees(
    lower: float, upper: float, asked: bool, tmp_path: Path
) -> None:
    path = urdf(tmp_path)
    path.write_text(path.read_text().replace('lower="-1" upper="1"', f'lower="{lower}" upper="{upper}"'))
    said = " ".join(read_model(path).said)
    assert (
        "Warning: arm.urdf: limits let joints turn more than 2 times round: 'yaw' (12.8); are they" in said
    ) == asked


def test_a_total_mass_is_worked_into_the_masses_and_warned_of_by_no_one(tmp_path: Path) -> None:
    text = """<mujoco><compiler settotalmass="2"/><worldbody><body name="a"><joint name="j" axis="0 1 0"/>
    <geom size=".1" pos=".2 0 0"/><geom size=".1" mass="3"/><body name="b"><joint name="k"/>
    <inertial mass="1" pos=".1 0 0" fullinertia="1 2 2 .1 0 0"/></body></body></worldbody></mujoco>"""
    (tmp_path / "arm.xml").write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        wanted = mujoco.MjModel.from_xml_string(text)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        robot = load_robot_file(tmp_path / "arm.xml")
        model = bare_model(robot)
    np.testing.assert_allclose(model.body_mass, wanted.body_mass)
    np.testing.assert_allclose(model.body_inertia, wanted.body_inertia)
    assert "asks for a total mass of 2 kg" in " ".join(robot.said)


MOUNT = '<link name="mount"><collision><geometry><box size="0.1 0.1 0.2"/></geometry></collision></link>'


def test_a_link_without_an_inertial_that_is_fixed_to_one_with_a_mass_has_none(tmp_path: Path) -> None:
    """A camera mount weighed 2 kg, as a solid block of 1000 kg/m3, and the trunk of a public quadruped 29 kg twice."""
    more = MOUNT + FIXED.replace("hand", "mount")
    robot = load_robot_file(urdf(tmp_path, more=more))
    assert robot.model.mass == pytest.approx(0.3) and "<inertial>" not in " ".join(robot.said)


def test_links_whose_mass_comes_from_their_shapes_are_named(tmp_path: Path) -> None:
    more = MOUNT + FIXED.replace("hand", "mount").replace("fixed", "continuous")
    (said,) = [sentence for sentence in load_robot_file(urdf(tmp_path, more=more)).said if "<inertial>" in sentence]
    assert "mount 2 kg" in said and "1 of its links" in said


@pytest.mark.parametrize("left", ["$(optenv TILT 0.1)", "${0.1 * scale}"])
def test_what_xacro_left_in_a_number_is_shown_with_the_way_to_expand_it(left: str, tmp_path: Path) -> None:
    path = urdf(tmp_path, limit=f' friction="0"/><dynamics damping="{left}"', inertia=GOOD)
    said = f"It holds {re.escape(left)}, which is for xacro to replace; expand it: xacro arm.urdf > robot.urdf."
    with pytest.raises(RobotError, match=said):
        read_model(path)


def test_a_part_that_other_files_include_is_refused_with_what_to_give(tmp_path: Path) -> None:
    (tmp_path / "part.xml").write_text("<mujocoinclude><body name='b'/></mujocoinclude>")
    with pytest.raises(RobotError, match="is a part that other files include; give the file with <mujoco> that"):
        read_model(tmp_path / "part.xml")


# --- goals and servos -------------------------------------------------------------------------------------------------


ARM = """<mujoco><compiler angle="{angle}"/><worldbody><body><joint name="j" axis="0 1 0" {joint}/>
<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="0.3"/></body></worldbody>
<actuator>{actuator}</actuator></mujoco>"""

BELT = """<mujoco><compiler angle="radian"/><worldbody><body><joint name="a" axis="0 1 0" {a}/>
<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="0.3"/><body pos="0 0 -0.2">
<joint name="b" axis="0 1 0" range="-1 2"/><geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="0.3"/>
</body></body></worldbody><tendon><fixed name="belt">{terms}</fixed></tendon>
<actuator>{actuator}</actuator></mujoco>"""


def arm(folder: Path, actuator: str, joint: str = "", angle: str = "radian") -> Path:
    path = folder / "arm.xml"
    path.write_text(ARM.format(actuator=actuator, joint=joint, angle=angle))
    return path


def written(model: Path, capsys: pytest.CaptureFixture[str], *more: str) -> tuple[str, str]:
    """The YAML, with its comments on one line each, and what the terminal says."""
    out = model.with_suffix(".yaml")
    out.unlink(missing_ok=True)
    new_robot.main([str(model), *more])
    return out.read_text().replace("\n    #   ", " "), capsys.readouterr().out


@pytest.mark.long
@pytest.mark.parametrize("gear", [1.0, 2.0])
def test_a_dampratio_is_the_damping_that_the_engine_makes_of_it(gear: float, tmp_path: Path, capsys) -> None:
    model = arm(tmp_path, f'<position name="p" joint="j" kp="20" dampratio="0.7" gear="{gear}"/>', 'armature="0.01"')
    text, said = written(model, capsys)
    inertia = mujoco.MjModel.from_xml_path(str(model)).dof_M0[0]
    kp = 20.0 * gear**2
    chain = load_robot_file(tmp_path / "arm.yaml").joint("j").chain
    assert chain.value("ideal.stiffness") == pytest.approx(kp)
    assert chain.value("ideal.damping") == pytest.approx(2.0 * 0.7 * math.sqrt(kp * inertia), rel=1e-3)
    assert "is what the engine makes of dampratio 0.7 of actuator 'p'" in text and "dampratio 0.7" in said


def test_what_is_written_names_no_file_of_a_checkout(tmp_path: Path, capsys) -> None:
    text, _ = written(arm(tmp_path, '<position name="p" joint="j" kp="20"/>'), capsys)
    comments = "".join(line.partition("#")[2] for line in text.splitlines())
    assert not [word for word in ("configs/", "docs/", "hw/", ".py") if word in comments]


def test_a_policy_of_a_robots_yaml_names_it_where_the_model_alone_is_given(tmp_path: Path, capsys) -> None:
    model = arm(tmp_path, '<position name="p" joint="j" kp="20" kv="1"/>', 'range="-1 1"')
    written(model, capsys)
    yaml = tmp_path / "arm.yaml"
    yaml.write_text(yaml.read_text().replace("stiffness: 20.0", "stiffness: 15.0"))
    robots = [build_robot(compose("deploy", {"robot": str(path)}, readers=READERS)["robot"]) for path in (yaml, model)]
    chains = {name: chain.to_list() for name, chain in robots[0].chains.items()}
    contract = make_contract({"id": "SeaLegs/Track-v0", "robot": str(yaml)}, chains, 50.0)
    robots[0].check_contract(contract)
    with pytest.raises(ContractError, match=r"trained with robot=.*arm\.yaml, and here it is arm\.xml: give that file"):
        robots[1].check_contract(contract)


def test_an_actuator_that_no_servo_can_stand_for_is_named_with_its_file_and_joint(tmp_path: Path) -> None:
    model = arm(tmp_path, '<general name="g" joint="j" biastype="affine" gainprm="3" biasprm="0 -4 0.5"/>')
    with pytest.raises(
        RobotError, match=r"arm\.xml: joint 'j': actuator 'g' cannot be .*: ideal\.damping is -0\.5; .*"
    ):
        new_robot.main([str(model)])


@pytest.mark.long
@pytest.mark.parametrize(
    ("actuator", "joint", "goals", "note"),
    [
        ('ctrlrange="-0.5 0.4"', "", (-0.5, 0.4), "no range; its goals end with the control range of actuator 'p'"),
        ('ctrlrange="-0.5 0.4" gear="2"', "", (-0.25, 0.2), "no range; its goals end with the control range"),
        ('ctrlrange="-0.5 3"', 'range="-1 1"', (-0.5, 1.0), "which is narrower than its range (-1 to 1 rad)"),
        ('ctrlrange="-2 3"', 'range="-1 1"', (-1.0, 1.0), ""),
        ('ctrlrange="-1.91986 1.91986"', 'range="-1.92 1.92"', (-1.91986, 1.91986), ""),
        ('inheritrange="1"', 'range="-1 1"', (-1.0, 1.0), ""),
        ('ctrlrange="30 60"', 'range="-1 1"', (-1.0, 1.0), "(30 to 60 rad) lies outside its range (-1 to 1 rad)"),
        ('ctrlrange="-0.5 0.4" ctrllimited="false"', "", (-math.pi, math.pi), "-3.142 to 3.142 rad is assumed"),
    ],
)
def test_goals_end_where_the_joint_or_its_control_does_whichever_is_narrower(
    actuator: str, joint: str, goals: tuple[float, float], note: str, tmp_path: Path, capsys
) -> None:
    model = arm(tmp_path, f'<position name="p" joint="j" kp="20" {actuator}/>', joint)
    text, said = written(model, capsys)
    for file in (model, tmp_path / "arm.yaml"):
        assert load_robot_file(file).joint("j").range == pytest.approx(goals, abs=1e-6)
    assert note in text and note in said and (note != "" or "its goals" not in said)


def test_numbers_of_file_and_chain_that_differ_threefold_are_a_warning_at_the_end(tmp_path: Path, capsys) -> None:
    """A damping of 0.6 in the file stood among notes as if 0.059 in the chain were the same."""
    model = arm(tmp_path, '<position name="p" joint="j" kp="20"/>', 'damping="0.6" frictionloss="0.06"')
    new_robot.main([str(model), "chain=sts3215"])
    said = [line.strip() for line in capsys.readouterr().out.splitlines()]
    warnings = [line for line in said if line.startswith("Warning: ")]
    assert len(warnings) == 1 and said[-2] == warnings[0]
    assert "damping is 0.6 in arm.xml and 0.059 in its chain, 10 times less; the chain's counts" in warnings[0]
    assert any(line.startswith("joint j: frictionloss is 0.06") for line in said)


def test_of_two_servos_on_a_joint_goals_end_where_both_together_can_hold_it(tmp_path: Path) -> None:
    both = (
        '<position joint="j" kp="30" ctrlrange="-1 1"/><position joint="j" kp="10" ctrlrange="-0.2 0.2"/>'
        '<velocity joint="j" kv="2" ctrlrange="-9 9"/>'
    )
    assert load_robot_file(arm(tmp_path, both)).joint("j").range == pytest.approx((-0.8, 0.8))


@pytest.mark.long
def test_goals_of_a_belt_end_where_those_of_its_joints_do(tmp_path: Path, capsys) -> None:
    terms = '<joint joint="a" coef="1"/><joint joint="b" coef="-0.5"/>'
    model = tmp_path / "arm.xml"
    actuator = '<position tendon="belt" kp="20"/>'
    model.write_text(BELT.format(a='range="-0.5 0.5"', terms=terms, actuator=actuator))
    text, said = written(model, capsys)
    assert load_robot_file(tmp_path / "arm.yaml").joint("belt").range == pytest.approx((-1.5, 1.0))
    assert "-1.5 to 1 rad, is what those of a and b add up to" in text and "add up to" in said
    model.write_text(BELT.format(a="", terms=terms, actuator=actuator))
    assert "it has no range; -3.142 to 3.142 rad is assumed" in written(model, capsys)[1]


@pytest.mark.parametrize("name", OTHER)
def test_a_joint_called_by_a_word_of_log_columns_is_warned_about(name: str, tmp_path: Path, capsys) -> None:
    model = arm(tmp_path, '<position joint="j" kp="20"/>')
    model.write_text(model.read_text().replace('"j"', f'"{name}"'))
    advice = f"give the joint another name here and name the model's: my_{name}: {{joint: {name}, ...}}"
    text, said = written(model, capsys)
    assert advice in text and f"joint {name}: logs have columns '{name}.*'" in said and advice in said
    (tmp_path / "arm.yaml").write_text(text.replace(f"  {name}:", f"  my_{name}:\n    joint: {name}"))
    assert [joint.joint for joint in load_robot_file(tmp_path / "arm.yaml").joints] == [name]


LEVER = """<robot name="arm"><link name="base">
<visual><geometry><mesh filename="package://arm/meshes/base.dae"/></geometry></visual>
<collision><geometry><mesh filename="package://arm/meshes/base.stl"/></geometry></collision></link>
<link name="upper"><inertial><mass value="0.3"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/>
</inertial><visual><geometry><mesh filename="package://arm/meshes/upper.dae"/></geometry></visual></link>
<joint name="yaw" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="3" velocity="6"/></joint>{more}</robot>"""


@pytest.mark.long
def test_every_mesh_that_is_missing_is_named_with_its_ending(tmp_path: Path, capsys) -> None:
    (tmp_path / "arm.urdf").write_text(LEVER.format(more=""))
    (tmp_path / "meshes").mkdir()
    sentence = "arm.urdf: these meshes are not there: {}; bodies move without them"
    assert sentence.format("base.dae, base.stl, upper.dae") in written(tmp_path / "arm.urdf", capsys)[1]
    (tmp_path / "meshes" / "upper.dae").write_text("")
    (tmp_path / "arm.urdf").write_text(LEVER.format(more="<!-- changed -->"))
    assert sentence.format("base.dae, base.stl") in written(tmp_path / "arm.urdf", capsys)[1]


@pytest.mark.long
@pytest.mark.parametrize(
    ("inside", "number"),
    [
        ('<joint name="yaw"/><actuator name="m"><mechanicalReduction>50</mechanicalReduction></actuator>', "50"),
        ('<joint name="yaw"><mechanical_reduction>30</mechanical_reduction></joint><actuator name="m"/>', "30"),
        ('<joint name="yaw"/><actuator name="m"><mechanicalReduction>1</mechanicalReduction></actuator>', ""),
    ],
)
def test_a_reduction_of_a_urdf_is_said_not_to_be_used(inside: str, number: str, tmp_path: Path, capsys) -> None:
    model = tmp_path / "arm.urdf"
    model.write_text(LEVER.format(more=f'<transmission name="t">{inside}</transmission>'))
    text, said = written(model, capsys)
    sentence = f"a mechanical reduction of {number} stands in arm.urdf and is not used: limits and goals count at"
    assert (f"joint yaw: {sentence}" in said) == (sentence[1:] in text) == bool(number)
    assert (f"joint yaw: {sentence}" in " ".join(load_robot_file(model).said)) == bool(number)
    assert load_robot_file(model).joint("yaw").chain.value("ideal.torque_limit") == 3.0


def test_a_motor_is_said_to_become_a_position_servo_whatever_its_chain(tmp_path: Path, capsys) -> None:
    model = arm(tmp_path, '<motor name="m" joint="j" gear="5" ctrlrange="-1 1"/>')
    sentence = "ctuator 'm' is a motor, whose control is a torque; here goals are positions, so a position servo takes"
    for more in ((), ("chain=sts3215",)):
        text, said = written(model, capsys, *more)
        assert text.count(sentence) == said.count(sentence) == 1
    assert sentence not in " ".join(load_robot_file(tmp_path / "arm.yaml").said), "the file has it as a comment"


@pytest.mark.long
def test_an_assumed_servo_gives_its_largest_force_at_an_error_of_an_eighth_of_its_range(tmp_path: Path, capsys) -> None:
    motor = '<motor joint="j" gear="5" ctrlrange="-1 1"/>'
    text, said = written(arm(tmp_path, motor, 'range="-1 1"'), capsys)
    assert load_robot_file(tmp_path / "arm.yaml").joint("j").chain.value("ideal.stiffness") == pytest.approx(20.0)
    assert "an ideal servo of 20 N.m/rad drives it (assumed, full force at an error of 1/8 of its range)" in said
    assert "An ideal servo of 20 N.m/rad drives it (assumed, full force" in text
    light = arm(tmp_path, motor, 'range="-1 1"')
    light.write_text(light.read_text().replace('mass="0.3"', 'mass="0.0003"'))
    text, said = written(light, capsys)
    assert "Hz with the joint's inertia, the fastest that a timestep of 2 ms resolves)" in said
    drivetrain = get_robot(tmp_path / "arm.yaml").drivetrain()
    data = mujoco.MjData(drivetrain.model)
    data.ctrl[0] = 0.8
    mujoco.mj_step(drivetrain.model, data, 500)
    assert float(data.qpos[0]) == pytest.approx(0.8, abs=0.01) and abs(float(data.qvel[0])) < 1e-3


def test_assumed_servos_of_a_long_chain_of_links_can_be_simulated(tmp_path: Path) -> None:
    links = "".join(
        f'<body pos="0 0 -0.2"><joint name="j{k}" axis="0 1 0" range="-1 1" actuatorfrcrange="-50 50"/>'
        '<geom type="capsule" size="0.01" fromto="0 0 0 0 0 -0.2" mass="0.2" contype="0" conaffinity="0"/>'
        for k in range(6)
    )
    path = tmp_path / "snake.xml"
    path.write_text(f'<mujoco><compiler angle="radian"/><worldbody>{links}{"</body>" * 6}</worldbody></mujoco>')
    drivetrain = get_robot(path).drivetrain()
    data = mujoco.MjData(drivetrain.model)
    data.ctrl[:] = 0.5
    mujoco.mj_step(drivetrain.model, data, 3000)
    assert abs(data.qvel).max() < 0.05


def test_an_assumed_servo_on_a_belt_is_as_stiff_at_the_joint_as_one_on_the_joint(tmp_path: Path) -> None:
    found = []
    for number in (1.0, -0.5, 4.0):
        model = tmp_path / f"{number}.xml"
        terms = f'<joint joint="b" coef="{number}"/>'
        model.write_text(BELT.format(a="", terms=terms, actuator='<motor tendon="belt"/>'))
        found.append(number**2 * load_robot_file(model).joint("belt").chain.value("ideal.stiffness"))
    assert found == pytest.approx([found[0]] * 3, rel=1e-3)


def test_the_smaller_limit_of_joint_and_actuator_is_that_of_its_servo(tmp_path: Path) -> None:
    for at_joint, limit in ((4.0, 4.0), (20.0, 6.0)):
        joint = f'actuatorfrcrange="-{at_joint} {at_joint}"'
        model = arm(tmp_path, '<position joint="j" kp="20" gear="2" forcerange="-3 3"/>', joint)
        model = model.rename(tmp_path / f"{at_joint}.xml")
        assert load_robot_file(model).joint("j").chain.value("ideal.torque_limit") == pytest.approx(limit)


def test_episodes_start_at_the_keyframe_of_the_model(tmp_path: Path, capsys) -> None:
    model = arm(tmp_path, '<position joint="j" kp="20"/>')
    keys = '<keyframe><key name="other" qpos="0.1"/><key name="home" qpos="0.3"/></keyframe></mujoco>'
    model.write_text(model.read_text().replace("</mujoco>", keys))
    assert "start: 0.3   # of episodes" in written(model, capsys)[0]
