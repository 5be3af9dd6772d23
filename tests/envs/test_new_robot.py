"""What `sealegs new-robot` reads from a model's actuators, what it assumes in their place, and that it says so."""

import math
from pathlib import Path

import mujoco
import pytest
from sealegs.commands import new_robot
from sealegs.configs.compose import compose
from sealegs.envs.contract import ContractError, make_contract
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.engine.numbers import RobotError
from sealegs.envs.robots import get_robot
from sealegs.gap.log.types import OTHER
from sealegs.hw.machine.own_robot import READERS
from sealegs.hw.machine.robot import build_robot

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


URDF = """<robot name="arm"><link name="base">
<visual><geometry><mesh filename="package://arm/meshes/base.dae"/></geometry></visual>
<collision><geometry><mesh filename="package://arm/meshes/base.stl"/></geometry></collision></link>
<link name="upper"><inertial><mass value="0.3"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/>
</inertial><visual><geometry><mesh filename="package://arm/meshes/upper.dae"/></geometry></visual></link>
<joint name="yaw" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="3" velocity="6"/></joint>{more}</robot>"""


@pytest.mark.long
def test_every_mesh_that_is_missing_is_named_with_its_ending(tmp_path: Path, capsys) -> None:
    (tmp_path / "arm.urdf").write_text(URDF.format(more=""))
    (tmp_path / "meshes").mkdir()
    sentence = "arm.urdf: these meshes are not there: {}; bodies move without them"
    assert sentence.format("base.dae, base.stl, upper.dae") in written(tmp_path / "arm.urdf", capsys)[1]
    (tmp_path / "meshes" / "upper.dae").write_text("")
    (tmp_path / "arm.urdf").write_text(URDF.format(more="<!-- changed -->"))
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
    model.write_text(URDF.format(more=f'<transmission name="t">{inside}</transmission>'))
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
