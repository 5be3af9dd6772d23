"""Whose numbers count: those of a user's model, of the chain that is added to it, or of its YAML."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.actuators import Drivetrain
from sealegs.actuators.chain import load_chain
from sealegs.actuators.engine import install
from sealegs.actuators.mounting import DrivenCoordinate
from sealegs.envs.described.as_robot import as_robot
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.engine.numbers import RobotError
from sealegs.envs.engine.robot import Robot, _tell
from sealegs.envs.extended import Change, Extended, Mounted
from sealegs.envs.robots import get_robot
from sealegs.gap.output.mjcf import native_text
from sealegs.hw.virtual.machine import Machine

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


INNER = """<mujoco model="inner"><compiler angle="{angle}"{more}/><worldbody><body name="b">{inertial}
<joint name="j" axis="0 1 0" range="{range}"/><geom type="capsule" fromto="0 0 0 .2 0 0" size=".02"/></body>
</worldbody></mujoco>"""
OUTER = """<mujoco><compiler angle="{angle}"/><asset><model name="inner" file="inner.xml"/></asset><worldbody>
<body name="base"><attach model="inner" body="b" prefix="L_"/></body></worldbody></mujoco>"""
CART = """<mujoco><worldbody><body name="cart"><joint name="s" type="slide" axis="1 0 0" range="-.4 .4"/>
<geom size=".1" mass="2"/></body></worldbody>
<actuator><position joint="s" kp="600" kv="30" forcerange="-200 200"/></actuator></mujoco>"""


def attached(folder: Path, outer: str, inner: str, ends: str, inertial: str = "", more: str = "") -> Path:
    (folder / "inner.xml").write_text(INNER.format(angle=inner, range=ends, inertial=inertial, more=more))
    (folder / "outer.xml").write_text(OUTER.format(angle=outer))
    return folder / "outer.xml"


@pytest.mark.parametrize(
    ("outer", "inner", "ends", "low"), [("degree", "radian", "-1 1", -1.0), ("radian", "degree", "-60 60", -np.pi / 3)]
)
def test_stops_are_written_in_the_unit_of_the_file_that_holds_the_joint(
    outer: str, inner: str, ends: str, low: float, tmp_path: Path
) -> None:
    """They were 57 times too far, or as much too near."""
    robot = as_robot(load_robot_file(attached(tmp_path, outer, inner, ends)))
    model = robot.build_spec({"L_j_upper_stop": 0.5}).compile()
    assert model.jnt_range[0] == pytest.approx((low, 0.5))


def test_a_mass_is_written_where_an_attached_file_takes_its_own_from_shapes(tmp_path: Path) -> None:
    inertial = '<inertial pos="0 0 0" mass="7" diaginertia="1 1 1"/>'
    path = attached(tmp_path, "radian", "radian", "-1 1", inertial, ' inertiafromgeom="true"')
    model = as_robot(load_robot_file(path)).build_spec({"L_b_mass": 0.9}).compile()
    assert model.body("L_b").mass == pytest.approx(0.9)


def mass(model: mujoco.MjModel) -> float:
    data = mujoco.MjData(model)
    install()
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return float(full[0, 0])


def test_inertia_that_a_slide_has_too_much_of_is_taken_from_it(tmp_path: Path) -> None:
    """A mass that was found to be less than the file's stayed as it was in what was handed over."""
    (tmp_path / "cart.xml").write_text(CART)
    robot = as_robot(load_robot_file(tmp_path / "cart.xml"))
    for more in (-0.6, 0.0, 0.6):
        drivetrain = robot.drivetrain({}, {"s_inertia": more})
        assert mass(drivetrain.model) == pytest.approx(2.0 + more)
    heavy = load_chain(robot.chains["s"]).with_value("ideal.armature", 0.3)
    drivetrain = robot.drivetrain({"s": heavy}, {"s_inertia": -0.6})
    assert mass(drivetrain.model) == pytest.approx(1.7)


def test_a_slide_with_nothing_left_of_its_inertia_is_refused(tmp_path: Path) -> None:
    (tmp_path / "cart.xml").write_text(CART)
    robot = as_robot(load_robot_file(tmp_path / "cart.xml"))
    with pytest.raises(RobotError, match="joint 's' would have a negative inertia: what was found at it is more than"):
        robot.build_spec({"s_inertia": -2.1})


TWO_JOINTS = """<mujoco><compiler angle="radian"/><worldbody><body><joint name="j" axis="0 1 0" range="-1 1"
damping="0.5" frictionloss="0.02" armature="0.01"/><geom size="0.1" mass="1"/></body></worldbody></mujoco>"""
SOFT = {"ideal": {"stiffness": 40.0, "damping": 2.0}}
FILE = "damping: file, armature: file, frictionloss: file"


def robot(folder: Path, chain: str = "[{ideal: {stiffness: 40, damping: 2}}]", more: str = FILE) -> Robot:
    (folder / "arm.xml").write_text(TWO_JOINTS)
    path = folder / "arm.yaml"
    path.write_text(f"model: arm.xml\njoints: {{j: {{chain: {chain}, {more}}}}}\n")
    return get_robot(path)


def numbers(machine: Robot, actuator: object = None) -> tuple[float, float, float]:
    """Damping, dry friction and armature of the joint with a chain."""
    model = machine.drivetrain(actuator).model  # pyright: ignore[reportArgumentType]
    return float(model.dof_damping[0]), float(model.dof_frictionloss[0]), float(model.dof_armature[0])


def of(chain: object) -> tuple[float, float, float]:
    loaded = load_chain(chain)  # pyright: ignore[reportArgumentType]
    return loaded.value("friction.viscous"), loaded.value("friction.coulomb"), loaded.armature()


def test_in_the_yaml_file_means_the_file(tmp_path: Path) -> None:
    assert numbers(robot(tmp_path, "sts3215")) == (0.5, 0.02, 0.01)


@pytest.mark.parametrize("actuator", ["sts3215", {"j": "sts3215"}])
def test_a_chain_that_is_named_elsewhere_counts_with_its_own_numbers_and_that_is_said_once(
    actuator: object, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Damping was 0.5 with `chain: sts3215` and 0.059 with `actuator=sts3215`, and nobody said so."""
    machine = robot(tmp_path)
    _tell.cache_clear()
    for _ in range(2):
        assert numbers(machine, actuator) == pytest.approx(of("sts3215"))
    said = [record.getMessage() for record in caplog.records if "of the chain sts3215 count" in record.getMessage()]
    assert len(said) == 1


def test_what_is_said_names_joints_numbers_and_the_way_out(tmp_path: Path) -> None:
    file = load_robot_file(robot(tmp_path).source)
    assert file.whose({"j": load_chain("sts3215")}) == (
        "joint j: damping, armature, frictionloss of the chain sts3215 count, not of arm.xml; to count these, name the "
        "chain in arm.yaml, with damping: file.",
    )
    assert file.whose({"j": file.joint("j").chain}) == ()
    assert file.whose({"j": load_chain([SOFT])}) == (), "it states none: the file's count"
    bare = load_robot_file(tmp_path / "arm.xml")
    assert "name the chain in a YAML of the robot" in bare.whose({"j": load_chain("sts3215")})[0]


def test_a_friction_of_zero_is_a_number_and_no_stage_is_none(tmp_path: Path) -> None:
    """A chain without dry friction got the file's back."""
    machine = robot(tmp_path)
    assert numbers(machine, [SOFT]) == (0.5, 0.02, 0.01)
    assert numbers(machine, [SOFT, {"friction": {"coulomb": 0.0, "viscous": 0.3}}]) == (0.3, 0.0, 0.01)
    assert numbers(machine, [SOFT, {"friction": {"coulomb": 0.1}}]) == (0.0, 0.1, 0.01)
    assert numbers(machine, [SOFT, {"friction": {}}]) == (0.0, 0.0, 0.01)


@pytest.mark.parametrize("given", [{}, {"damping": "file"}, {"damping": "chain"}])
def test_a_chain_of_the_yaml_is_read_alike(given: dict[str, str], tmp_path: Path) -> None:
    more = ", ".join(f"{key}: {value}" for key, value in given.items()) or "unknown: []"
    machine = robot(tmp_path, "[{ideal: {stiffness: 40, damping: 2}}, {friction: {coulomb: 0.1}}]", more)
    damping = 0.5 if given == {"damping": "file"} else 0.0
    assert numbers(machine) == (damping, 0.1, 0.01)
    assert machine.file is not None
    said = "Warning: joint j: damping is 0.5 in arm.xml and 0 in its chain; the chain's counts (damping: chain)"
    assert any(said in sentence for sentence in machine.file.said) == (not given)


@pytest.mark.parametrize("found", [0.0, 0.2])
def test_a_chain_of_a_diagnosis_keeps_the_friction_that_was_found(
    found: float, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    machine = robot(tmp_path)
    assert machine.file is not None
    chain = load_chain([SOFT, {"friction": {"coulomb": found, "viscous": 0.5}}])
    change = Change("j", "friction.coulomb", 0.02, found, "friction.coulomb", "chain")
    digest = machine.file.model.digest
    extended = Extended(machine.source, {}, {"j": (Mounted(chain, "j.yaml"),)}, (change,), digest=digest)
    caplog.clear()
    for _ in range(2):  # and again from its stages, as they stand in a run's config
        assert numbers(machine, extended.chains_on(machine)) == (0.5, found, 0.01)
        extended = Extended.from_dict(extended.to_dict())
    assert not [record for record in caplog.records if "of the chain" in record.getMessage()]


@pytest.mark.parametrize("hidden", [0.0, 0.2])
def test_a_friction_that_a_virtual_machine_hides_is_there_also_where_it_is_none(hidden: float, tmp_path: Path) -> None:
    path = tmp_path / "hidden.yaml"
    path.write_text(f"j: {{friction.coulomb: {hidden}}}\n")
    model = Machine(robot(tmp_path), hidden=str(path)).model
    assert (float(model.dof_damping[0]), float(model.dof_frictionloss[0])) == (0.5, hidden)
