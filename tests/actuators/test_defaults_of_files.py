"""What a user's file gives its own joints and actuators stays out of the parts that chains add to its model."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.actuators import Drivetrain
from sealegs.actuators.mounting import DrivenCoordinate
from sealegs.envs.described.as_robot import as_robot
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.gap.output.mjcf import native_text

ARM = """<mujoco>{size}<default>{main}<default class="arm">{arm}</default></default>
<worldbody><body childclass="arm"><geom size="0.02" mass="0.1"/><body><joint name="a" axis="0 1 0" {own}/>
<geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0" mass="1"/><body pos="0.3 0 0">
<joint name="b" axis="0 1 0" {own}/><geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0" mass="1"/></body></body>
</body></worldbody>{actuators}</mujoco>"""
OWN = """damping="0.5" frictionloss="0.1" armature="0.01" stiffness="0" limited="false" actuatorfrclimited="false"
range="0 0" actuatorfrcrange="0 0" margin="0" group="0" springref="0" solreflimit="0.02 1" springdamper="0 0" """
JOINTS = """<joint damping="2" frictionloss="0.5" armature="0.1" stiffness="3" range="-60 60" actuatorfrcrange="-1 1"
margin="0.1" group="2" springref="20" solreflimit="0.1 1"/>"""
DRIVES = """<tendon damping="3" frictionloss="1" stiffness="20" range="-0.2 0.2" springlength="0.1 0.2" margin="0.1"/>
<position kp="3" timeconst="0.1" gear="2" forcerange="-3 3" ctrlrange="-0.2 0.2" delay="0.02" nsample="9"/>"""
IDEAL = {"ideal": {"stiffness": 20.0, "damping": 1.0, "armature": 0.02}}
CHAINS = {
    "stiff": [IDEAL],
    "compliance": [IDEAL, {"compliance": {"stiffness": 300.0, "damping": 1.0}}],
    "backlash": [IDEAL, {"backlash": {"width": 0.01}}],
    "spring": [IDEAL, {"spring": {"stiffness": 300.0, "damping": 1.0}}],
    "spring with an inertia": [IDEAL, {"spring": {"stiffness": 300.0, "damping": 1.0, "inertia": 0.001}}],
}
JOINT = DrivenCoordinate.of_joint("a")
BELT = DrivenCoordinate("belt", (("a", 2.0), ("b", -1.0)))


def text(main: str = "", arm: str = "", actuators: str = "", size: str = "", own: str = OWN) -> str:
    return ARM.format(main=main, arm=arm, actuators=actuators, size=size, own=own)


def driven(xml: str, chain: list, coordinate: DrivenCoordinate) -> Drivetrain:
    return Drivetrain(mujoco.MjSpec.from_string(xml), {coordinate.name: chain}, [coordinate])


def unlike(one: mujoco.MjModel, other: mujoco.MjModel) -> list[str]:
    """Fields of joints, tendons and actuators that differ between two models."""
    kinds = ("jnt_", "dof_", "tendon_", "actuator_")
    fields = [name for name in dir(one) if name.startswith(kinds)]
    assert len(fields) > 80
    return [name for name in fields if not np.allclose(getattr(one, name), getattr(other, name), 1e-5)]


@pytest.mark.parametrize(
    ("kind", "coordinate"),
    [*((kind, JOINT) for kind in CHAINS), *((kind, BELT) for kind in CHAINS if kind != "spring with an inertia")],
    ids=lambda item: getattr(item, "name", item),
)
def test_parts_of_a_chain_take_nothing_from_default_classes(kind: str, coordinate: DrivenCoordinate) -> None:
    plain = driven(text(), CHAINS[kind], coordinate).model
    for main, arm in ((JOINTS + DRIVES, ""), (DRIVES, JOINTS)):
        drivetrain = driven(text(main, arm), CHAINS[kind], coordinate)
        assert unlike(drivetrain.model, plain) == []
        assert unlike(mujoco.MjSpec.from_string(drivetrain.spec.to_xml()).compile(), plain) == []


def test_a_model_written_for_plain_mujoco_takes_nothing_from_default_classes() -> None:
    models = []
    for xml in (text(), text(JOINTS + DRIVES), text(DRIVES + '<general forcelimited="true"/>', JOINTS)):
        drivetrain = driven(xml, CHAINS["compliance"], JOINT)
        written = native_text(drivetrain.spec.to_xml(), drivetrain.chains)
        models.append(mujoco.MjModel.from_xml_string(written))
    assert models[0].nu == 1 and [unlike(model, models[0]) for model in models[1:]] == [[], []]


def test_a_file_that_limits_its_own_actuators_does_not_limit_a_chain(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    servo = '<position name="{0}" joint="{0}" kp="100" kv="5" gear="1" forcerange="-50 50"/>'
    actuators = f"<actuator>{servo.format('a')}{servo.format('b')}</actuator>"
    path.write_text(text('<motor gear="2" forcerange="-3 3"/>', actuators=actuators))
    file = load_robot_file(path)
    model = as_robot(file).drivetrain({joint.name: joint.chain for joint in file.joints}).model
    data = mujoco.MjData(model)
    data.ctrl[model.actuator("a").id] = 0.1
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[model.joint("a").dofadr[0]] == pytest.approx(10.0)
    assert file.joint("a").chain.value("ideal.torque_limit") == 50.0


@pytest.mark.parametrize(
    ("first", "second", "limit"),
    [
        ("", 'ctrlrange="-1 1"', None),
        ('forcerange="-3 3"', "", None),
        ('forcerange="-3 3"', 'ctrlrange="-1 1"', 4.0),
        ("", "", None),
    ],
)
def test_actuators_of_a_joint_have_a_torque_limit_where_each_has_one(
    tmp_path: Path, first: str, second: str, limit: float | None
) -> None:
    path = tmp_path / "arm.xml"
    two = f'<position name="p" joint="a" kp="100" kv="5" {first}/><motor name="m" joint="a" {second}/>'
    path.write_text(text(actuators=f"<actuator>{two}</actuator>"))
    (stage,) = (s for s in load_robot_file(path).joint("a").chain.to_list() if "ideal" in s)
    assert stage["ideal"].get("torque_limit") == limit


def test_a_file_may_say_how_many_user_values_its_parts_have(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    size = '<size nuser_actuator="3" nuser_jnt="2" nuser_tendon="1"/>'
    servo = '<position name="a" joint="a" kp="100" kv="5" user="1 2 3"/>'
    path.write_text(text(actuators=f"<actuator>{servo}</actuator>", size=size, own=f'{OWN} user="1 2"'))
    file = load_robot_file(path)
    for chain in (file.joint("a").chain, CHAINS["compliance"]):
        drivetrain = as_robot(file).drivetrain({"a": chain})
        row = drivetrain.model.actuator_user[drivetrain.actuator_ids["a"]]
        assert np.array_equal(row, drivetrain.program("a")) and drivetrain.model.nuser_jnt == 2
