"""`sealegs new-robot` sees that a file's robot has legs and no ground, and writes a pose in which it stands."""

from __future__ import annotations

import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import sealegs
import yaml
from sealegs.commands import new_robot
from sealegs.envs.described.as_robot import as_robot
from sealegs.envs.described.model_file import read_model
from sealegs.envs.described.robot_described import along_frame
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.engine.numbers import RobotError

LINK = """<link name="{name}"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="{centre}"/><geometry>{shape}</geometry></collision></link>"""
JOINT = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{place}"/>
<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" effort="{effort}" velocity="8"/></joint>"""


def link(name: str, mass: float, centre: str, shape: str) -> str:
    return LINK.format(name=name, mass=mass, centre=centre, i=max(mass * 2e-3, 1e-5), shape=shape)


def joint(
    name: str, parent: str, child: str, place: str, axis: str, ends: tuple[float, float], effort: float = 3
) -> str:
    low, high = ends
    return JOINT.format(
        name=name, parent=parent, child=child, place=place, axis=axis, low=low, high=high, effort=effort
    )


def box(x: float, y: float, z: float) -> str:
    return f'<box size="{x} {y} {z}"/>'


def quadruped(words: tuple[str, str, str] = ("hip", "thigh", "calf"), up: float = -1.0) -> str:
    """Twelve joints; legs along z, downwards for an ``up`` of -1."""
    parts = [link("trunk", 1.2, "0 0 0", box(0.3, 0.12, 0.06))]
    for k, (x, y) in enumerate(product((0.13, -0.13), (0.07, -0.07))):
        names = [f"{word}_{k}" for word in words]
        parts += [
            link(names[0], 0.08, "0 0 0", box(0.04, 0.04, 0.04)),
            link(names[1], 0.08, f"0 0 {0.05 * up}", box(0.02, 0.02, 0.08)),
            link(names[2], 0.04, f"0 0 {0.105 * up}", '<sphere radius="0.012"/>'),
            joint(f"j0_{k}", "trunk", names[0], f"{x} {y} 0", "1 0 0", (-0.8, 0.8)),
            joint(f"j1_{k}", names[0], names[1], f"0 {0.03 * np.sign(y)} 0", "0 1 0", (-1.2, 1.8)),
            joint(f"j2_{k}", names[1], names[2], f"0 0 {0.1 * up}", "0 1 0", (-2.4, 0.1)),
        ]
    return f'<robot name="dog">{"".join(parts)}</robot>'


def biped() -> str:
    """Ten joints in two legs with feet that are boxes, an arm on each side, legs straight as the file has them."""
    parts = [link("torso", 0.8, "0 0 0.08", box(0.1, 0.14, 0.16))]
    for side, y in (("left", 0.05), ("right", -0.05)):
        chain = [
            ("hip_yaw", "0 0 1", f"0 {y} 0", (-0.8, 0.8), 0.05, box(0.03, 0.03, 0.03), "0 0 0"),
            ("hip_roll", "1 0 0", "0 0 -0.03", (-0.6, 0.6), 0.05, box(0.03, 0.03, 0.03), "0 0 0"),
            ("hip_pitch", "0 1 0", "0 0 -0.02", (-1.2, 1.2), 0.08, box(0.03, 0.03, 0.06), "0 0 -0.045"),
            ("knee", "0 1 0", "0 0 -0.1", (0.0, 2.2), 0.08, box(0.03, 0.03, 0.06), "0 0 -0.045"),
            ("ankle", "0 1 0", "0 0 -0.1", (-1.0, 1.0), 0.06, box(0.11, 0.06, 0.016), "0.015 0 -0.03"),
        ]
        parent = "torso"
        for word, axis, place, ends, mass, shape, centre in chain:
            name = f"{side}_{word}_link"
            parts += [link(name, mass, centre, shape), joint(f"{side}_{word}", parent, name, place, axis, ends)]
            parent = name
        arm = f"{side}_arm_link"
        parts += [
            link(arm, 0.06, "0 0 -0.06", box(0.02, 0.02, 0.1)),
            joint(f"{side}_arm", "torso", arm, f"0 {2.4 * y} 0.14", "0 1 0", (-2.0, 2.0)),
        ]
    return f'<robot name="walker">{"".join(parts)}</robot>'


def arm() -> str:
    parts = [link("base", 1.0, "0 0 0.03", box(0.1, 0.1, 0.06))]
    for k, parent in enumerate(("base", "upper", "fore")):
        name = ("upper", "fore", "hand")[k]
        parts += [
            link(name, 0.1, "0 0 0.06", box(0.02, 0.02, 0.1)),
            joint(f"a{k}", parent, name, f"0 0 {0.07 if k == 0 else 0.12}", "0 1 0", (-2, 2)),
        ]
    return f'<robot name="arm">{"".join(parts)}</robot>'


def written(folder: Path, text: str, capsys: pytest.CaptureFixture[str]) -> tuple[Path, str]:
    """The YAML that is written of a URDF, and what the terminal says."""
    model = folder / "robot.urdf"
    model.write_text(text)
    new_robot.main([str(model)])
    return folder / "robot.yaml", capsys.readouterr().out


def stood(path: Path, seconds: float = 5.0) -> tuple[float, float]:
    """How far a robot's base has sunk and turned [m], [rad] after a while at the goals at which episodes start."""
    env = sealegs.make_env("track", robot=str(path), amplitude=0.0, start_noise=0.0, correction=0.1)
    env.reset(seed=0)
    start = np.array(env.unwrapped.data.qpos[:7])
    for _ in range(round(seconds * 50)):
        env.step(np.zeros(env.action_space.shape, np.float32))
    now = np.array(env.unwrapped.data.qpos[:7])
    return float(start[2] - now[2]), float(2.0 * np.arccos(min(1.0, abs(now[3:] @ start[3:]))))


@pytest.mark.parametrize(
    "text", [pytest.param(quadruped(), id="quadruped"), pytest.param(biped(), id="biped", marks=pytest.mark.long)]
)
def test_a_robot_on_legs_gets_a_free_base_a_floor_and_a_pose_in_which_it_stands(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, said = written(tmp_path, text, capsys)
    row = yaml.safe_load(path.read_text())
    assert row["base"] == "free" and row["floor"] == {"friction": 1.0} and row["height"] > 0.1 and row["imu"] == {}
    assert "legs hang in the air" in said and "it stands 5 s" in said
    sunk, turned = stood(path)
    assert abs(sunk) < 0.01 and turned < 0.05


def test_legs_of_whole_turns_keep_within_reach_of_their_stance(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a public quadruped with ranges of 20 rad, an action was 2.5 rad, and learning made it walk worse."""
    text = quadruped().replace('lower="-1.2" upper="1.8"', 'lower="-10" upper="10"')
    path, said = written(tmp_path, text, capsys)
    rows = yaml.safe_load(path.read_text())["joints"]
    for k in range(4):
        low, high = rows[f"j1_{k}"]["range"]
        assert high - low == pytest.approx(np.pi, abs=0.01) and 0.5 * (low + high) == pytest.approx(
            rows[f"j1_{k}"]["start"], abs=0.01
        )
        assert rows[f"j0_{k}"]["range"] == [-0.8, 0.8]
    assert "goals of j1_0, j1_1, j1_2, j1_3 keep within 1.57 rad of their start" in said
    assert "it stands 5 s" in said


def test_assumed_servos_of_legs_move_the_weight_that_they_carry(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Those of a public quadruped were slower than its gait: it followed 29 % of the forward speed asked for."""
    path, said = written(tmp_path, quadruped(), capsys)
    row = yaml.safe_load(path.read_text())
    share = 2.0 * 9.81 / 4.0  # [N] on a foot
    for name in ("j0_0", "j1_0"):
        (stage,) = row["joints"][name]["chain"]
        assert stage["ideal"]["stiffness"] > 12.0 * share * row["height"]
    assert "from the weight that it holds and moves" in said


@pytest.mark.long
def test_what_stands_is_simulated_as_its_yaml_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, _ = written(tmp_path, quadruped(), capsys)
    robot = as_robot(load_robot_file(path))
    assert robot.numbers["floor_friction"].value == 1.0
    slippery = sealegs.make_env("track", robot=str(path), params={"floor_friction": 0.3})
    model = slippery.unwrapped.model
    assert model.geom("floor").friction[0] == 0.3


@pytest.mark.long
@pytest.mark.parametrize("text", [arm(), quadruped(("a", "b", "c"), up=1.0)], ids=["arm", "limbs that point upwards"])
def test_a_robot_that_stands_on_its_base_stays_fixed(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, said = written(tmp_path, text, capsys)
    assert yaml.safe_load(path.read_text())["base"] == "fixed" and " legs" not in said


@pytest.mark.long
def test_legs_are_known_by_where_they_end_where_no_name_says_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, _ = written(tmp_path, quadruped(("a", "b", "c")), capsys)
    assert yaml.safe_load(path.read_text())["base"] == "free"


@pytest.mark.long
def test_feet_without_a_shape_stand_on_boxes_of_their_inertias(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of six public bipeds four have feet without a shape that can be read: they stayed welded to the air."""
    shape = f'<collision><origin xyz="0.015 0 -0.03"/><geometry>{box(0.11, 0.06, 0.016)}</geometry></collision>'
    text = biped().replace(shape, "")
    assert shape not in text and shape in biped()
    path, said = written(tmp_path, text, capsys)
    row = yaml.safe_load(path.read_text())
    assert row["base"] == "free" and row["feet"] == ["left_ankle_link", "right_ankle_link"]
    assert "it stands 5 s" in said and "Boxes of their inertias" in said
    sunk, turned = stood(path)
    assert abs(sunk) < 0.02 and turned < 0.05


def test_the_box_of_a_foot_whose_heel_is_heavier_lies_level_in_its_frame() -> None:
    """A public biped stood on the edge of its toes, 10 mm behind which its weight was: its gait fell in 11 of 24."""
    lean = np.array([np.cos(0.1), 0.0, np.sin(0.1), 0.0])
    moments = along_frame((1.0, 3.0, 2.0), tuple(lean))
    assert moments == pytest.approx((np.cos(0.2) ** 2 + 2 * np.sin(0.2) ** 2, 3.0, 2 - np.sin(0.2) ** 2))
    assert along_frame((1.0, 3.0, 2.0), (1.0, 0.0, 0.0, 0.0)) == (1.0, 3.0, 2.0)


@pytest.mark.long
def test_the_ankles_of_two_legs_move_the_weight_that_stands_on_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They held it barely upright, so it rocked: a public biped fell standing still, in 8 of 24 starts with noise."""
    path, _ = written(tmp_path, biped(), capsys)
    file = load_robot_file(path)
    weight = 9.81 * float(as_robot(file).drivetrain().model.body_subtreemass[0])
    ankles = [item for item in file.joints if "ankle" in item.name]
    assert len(ankles) == 2 and file.height is not None
    assert all(item.chain.value("ideal.stiffness") > 2.0 * weight * 0.5 * file.height for item in ankles)


@pytest.mark.parametrize(
    ("part", "question"),
    [
        (link("trunk", 1.2, "0 0 0", box(300, 120, 60)), r"the robot is 3\d\d m across; are its lengths millimetres\?"),
        (link("trunk", 1200, "0 0 0", box(0.3, 0.12, 0.06)), r"the robot weighs 1201 kg; are its masses grams\?"),
    ],
    ids=["millimetres", "grams"],
)
def test_a_robot_of_other_units_than_metres_and_kilograms_is_asked_about(
    part: str, question: str, tmp_path: Path
) -> None:
    plain = quadruped()
    (tmp_path / "dog.urdf").write_text(plain.replace(link("trunk", 1.2, "0 0 0", box(0.3, 0.12, 0.06)), part))
    (tmp_path / "plain.urdf").write_text(plain)
    (said,) = read_model(tmp_path / "dog.urdf").said
    assert re.match(f"Warning: dog.urdf: {question} A URDF has", said) and not read_model(tmp_path / "plain.urdf").said


MASSLESS = '<inertial><mass value="0"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>'


@pytest.mark.parametrize("inertial", ["", MASSLESS], ids=["without inertial", "of mass 0"])
def test_links_that_move_without_a_mass_of_their_own_are_named(inertial: str, tmp_path: Path) -> None:
    foot = link("foot", 0.1, "0 0 0", '<sphere radius="0.01"/>')
    foot += '<joint name="weld" type="fixed"><parent link="calf_0"/><child link="foot"/></joint></robot>'
    legs = re.sub(r'(<link name="calf_0">)<inertial>.*?</inertial>', rf"\1{inertial}", quadruped(), flags=re.DOTALL)
    (tmp_path / "dog.urdf").write_text(legs.replace("</robot>", foot))
    (said,) = read_model(tmp_path / "dog.urdf").said
    assert "links that move without a mass of their own: calf_0; what is fixed to each counts alone." in said


@pytest.mark.parametrize("mass", [-0.08, float("nan")])
def test_a_mass_that_no_link_has_is_refused(mass: float, tmp_path: Path) -> None:
    text = quadruped().replace('<mass value="0.08"/>', f'<mass value="{mass}"/>', 1)
    (tmp_path / "dog.urdf").write_text(text)
    with pytest.raises(RobotError, match=rf"dog\.urdf: link 'hip_0' has a mass of {mass:g} kg; give 0 or more\."):
        read_model(tmp_path / "dog.urdf")


def test_a_foot_that_the_model_has_not_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_text(quadruped())
    path = tmp_path / "robot.yaml"
    path.write_text("model: robot.urdf\nfeet: [calf_9]\n")
    with pytest.raises(RobotError, match=r"feet: robot\.urdf has no body 'calf_9'"):
        load_robot_file(path)


@pytest.mark.long
def test_shapes_that_lie_within_each_other_never_touch(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of public files, links two joints apart overlap: they would push joints aside for ever."""
    text = quadruped().replace(box(0.02, 0.02, 0.08), box(0.02, 0.2, 0.08))
    path, said = written(tmp_path, text, capsys)
    pairs = yaml.safe_load(path.read_text())["exclude"]
    assert ["trunk", "thigh_0"] in pairs and "trunk and thigh_0" in said


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("floor: {friction: -1}", "floor.friction is -1"),
        ("base: fixed\nheight: 0.2", "height is where a free base starts"),
        ("exclude: [[trunk, thihg_0]]", "no body 'thihg_0'"),
        ("exclude: [[trunk]]", "give pairs of bodies"),
        ("floor: 3", "floor"),
    ],
)
def test_a_wrong_ground_is_one_sentence(line: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_text(quadruped())
    path = tmp_path / "robot.yaml"
    path.write_text(f"model: robot.urdf\n{line}\n")
    with pytest.raises(RobotError, match=message):
        load_robot_file(path)


@pytest.mark.long
def test_feet_stand_under_the_thighs_and_not_tucked_under_the_roll_joints(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Feet nearer to each other than the thighs: a robot of the kind fell to the side as soon as it lifted two feet."""
    path, _ = written(tmp_path, quadruped(), capsys)
    joints = yaml.safe_load(path.read_text())["joints"]
    assert max(abs(entry["start"]) for name, entry in joints.items() if name.startswith("j0")) < 0.05
