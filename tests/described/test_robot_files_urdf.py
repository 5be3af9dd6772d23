"""URDFs as they lie about: what MuJoCo reads is read, what it cannot is left out or named with the link."""

import re
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.envs.described.as_robot import bare_model
from sealegs.envs.described.model_file import read_model
from sealegs.envs.described.model_sources import files_read
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.engine.numbers import RobotError

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
