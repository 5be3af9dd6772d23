"""Inertias of links and payloads: what each joint feels of them, also at frames without a mass."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.envs.described.as_robot import as_robot, bare_model
from sealegs.envs.described.model_file import read_model
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.engine.numbers import RobotError
from sealegs.envs.extended import Change, Extended
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.load.robot import LoggedRobot
from sealegs.gap.load.terms import E_COUPLING, E_INERTIA, T_COLUMNS, T_OWN, T_SPIN
from sealegs.gap.load.tree import Motion, block_along, spin_block, terms_along, tip_behind
from sealegs.gap.log.reader import measured_set
from sealegs.gap.output.extension import of_robot
from sealegs.gap.robot.directions import Direction, every

from testbed.arm import ARMS, mjcf
from tests.gap.replay.test_torque_gauge import CENTRE, COULOMB, INERTIA, LENGTH, MASS, MODEL, ROTOR, moved
from tests.logged_robots import block_of, robot, two_link_run

GRAVITY = 9.81
URDF = """<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tool0"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="100" velocity="3"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz=".3 0 0"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="100" velocity="3"/></joint>
<joint name="flange" type="fixed"><parent link="fore"/><child link="tool0"/><origin xyz=".3 0 0"/></joint></robot>"""
MJCF = """<mujoco><compiler {compiler}/><worldbody>
<body name="upper" pos="0 0 1" gravcomp="{gravcomp}"><joint name="shoulder" axis="0 1 0"/>
<inertial pos=".1 0 .02" mass="1" diaginertia=".01 .01 .01"/>{shape}
<body name="fore" pos=".3 0 0" gravcomp="{gravcomp}"><joint name="elbow" axis="0 1 0"/>
<inertial pos="{centre}" mass="1" diaginertia=".01 .012 .013"/>{shape}{end}</body></body></worldbody></mujoco>"""
FRAME = '<body name="tool0" pos=".3 0 0"/>'
SITE = '<site name="tip" pos=".3 0 0"/>'


def arm(
    folder: Path, end: str, gravcomp: float = 0.0, *, compiler: str = "", shape: str = "", centre: str = ".1 0 .02"
) -> LoggedRobot:
    """An arm of two links of 0.3 m."""
    text = MJCF.format(compiler=compiler, gravcomp=gravcomp, shape=shape, end=end, centre=centre)
    return logged(folder / "arm.xml", text)


def logged(path: Path, text: str) -> LoggedRobot:
    path.write_text(text)
    file = load_robot_file(path)
    return LoggedRobot(file, bare_model(file))


def level() -> Motion:
    return Motion(*np.zeros((3, 1, 2)))


def moving() -> Motion:
    return Motion(*np.random.default_rng(3).normal(0.0, 0.6, (3, 4, 2)))


def mended(machine: LoggedRobot, changes: list[Change]) -> mujoco.MjModel:
    """The robot's own model with what was found."""
    found = Extended(str(machine.file.path), {}, {}, tuple(of_robot(machine, changes)))
    return bare_model(machine.file, found.params_on(as_robot(machine.file)))


def felt(machine: LoggedRobot, model: mujoco.MjModel, joint: str, motion: Motion) -> np.ndarray:
    """What a joint works against in a model more than in that of the robot (samples, columns)."""
    number = machine.number(joint)
    return block_along(model, number, motion) - block_along(machine.model, number, motion)


def said(machine: LoggedRobot, direction: Direction, joint: str, motion: Motion) -> np.ndarray:
    """What a number of the robot adds to a joint, per unit (samples, columns)."""
    before, after, by = direction.change()
    rows = block_along(after, machine.number(joint), motion)
    return (rows - (0.0 if before is None else block_along(before, machine.number(joint), motion))) / by


@pytest.mark.parametrize("name", ["arm.urdf", "arm.xml"])
def test_a_payload_at_a_frame_without_a_mass_hangs_at_the_origin_of_the_frame(tmp_path: Path, name: str) -> None:
    """MuJoCo's centre of mass of such a body may be the body's place in its parent: the way there counted twice."""
    machine = logged(tmp_path / name, URDF) if name == "arm.urdf" else arm(tmp_path, FRAME)
    for joint, reach in (("elbow", 0.3), ("shoulder", 0.6)):
        number = machine.number(joint)
        tip = tip_behind(machine.model, number)
        assert machine.model.body(tip.body).name == "tool0" and not tip.point.any()
        payload = block_of(terms_along(machine.model, number, level()), 1)[0]
        np.testing.assert_allclose(payload[:2], [reach**2, -GRAVITY * reach], atol=1e-9)
        shared = said(machine, every(machine)["body.tool0.payload"], joint, level())[0]
        np.testing.assert_allclose(shared, payload, atol=1e-9)


@pytest.mark.parametrize("name", ["arm.urdf", "arm.xml"])
def test_a_payload_that_was_found_at_a_frame_without_a_mass_goes_into_the_robots_model(
    tmp_path: Path, name: str
) -> None:
    machine = logged(tmp_path / name, URDF) if name == "arm.urdf" else arm(tmp_path, FRAME)
    model = mended(machine, [Change("elbow", "load.payload", 0.0, 0.5, "load.mass", "robot")])
    for joint in ("shoulder", "elbow"):
        payload = block_of(terms_along(machine.model, machine.number(joint), moving()), 1)
        np.testing.assert_allclose(felt(machine, model, joint, moving()), 0.5 * payload, atol=1e-6)
    with pytest.raises(RobotError, match="tool0_payload"):
        bare_model(machine.file, {"tool0_payload": -0.1})


def test_a_payload_hangs_at_the_site_of_a_body_whose_centre_of_mass_is_its_origin(tmp_path: Path) -> None:
    """Of such a body the engine does not read where the centre is."""
    machine = arm(tmp_path, SITE, centre="0 0 0")
    payload = said(machine, every(machine)["body.fore.payload"], "elbow", level())[0]
    np.testing.assert_allclose(payload[:2], [0.09, -GRAVITY * 0.3], atol=1e-9)


@pytest.mark.parametrize("gravcomp", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("end", [SITE, FRAME])
def test_nothing_compensates_the_weight_of_what_the_model_did_not_know(
    tmp_path: Path, gravcomp: float, end: str
) -> None:
    """The engine compensated the found payload too: 28 mrad were left of 30."""
    machine = arm(tmp_path, end, gravcomp)
    body = "fore" if end == SITE else "tool0"
    for path, size in (("load.payload", 0.5), ("load.centre_shift", 0.05)):
        change = Change("elbow", path, 0.0, size, "load.mass", "robot")
        number, block = machine.number("elbow"), 1 if path == "load.payload" else 2
        terms = terms_along(machine.model, number, moving())
        wanted = size * block_of(terms, block) + (size**2 * block_of(terms, 3) if block == 2 else 0.0)
        np.testing.assert_allclose(felt(machine, mended(machine, [change]), "elbow", moving()), wanted, atol=1e-4)
    known = every(machine)
    for number, size in ((f"body.{body}.payload", 0.5), ("body.fore.mass_factor", 1.6), ("body.upper.centre_z", 1e-3)):
        direction = known[number]
        model = mended(machine, [Change(direction.body, direction.effect, direction.neutral, size, "", "robot")])
        for joint in ("shoulder", "elbow"):
            rows = (size - direction.neutral) * said(machine, direction, joint, moving())
            np.testing.assert_allclose(felt(machine, model, joint, moving()), rows, atol=1e-4, err_msg=number)


def test_a_model_whose_compensation_was_kept_is_the_same_in_its_own_xml(tmp_path: Path) -> None:
    machine = arm(tmp_path, SITE, 1.0)
    spec = as_robot(machine.file).build_spec({"fore_payload": 0.5})
    model, again = spec.compile(), mujoco.MjModel.from_xml_string(spec.to_xml())
    number = machine.number("shoulder")
    np.testing.assert_allclose(
        block_along(again, number, moving()), block_along(model, number, moving()), rtol=1e-4, atol=1e-4
    )
    extended = LoggedRobot(machine.file, model)  # as a log has it that was made with these numbers
    assert extended.model.body(tip_behind(model, number).body).name == "fore"


def test_a_base_with_compensated_weights_feels_its_tilt_and_is_refused_in_the_engine(tmp_path: Path) -> None:
    """The engine compensates along gravity: a tilt did nothing to any joint, and could not be found."""
    machine, plain = arm(tmp_path, SITE, 1.0), arm(tmp_path, SITE, 0.0)
    for joint in ("shoulder", "elbow"):
        rows = [said(one, every(one)["base.tilt_y"], joint, moving()) for one in (machine, plain)]
        assert np.abs(rows[0]).max() > 0.1
        np.testing.assert_allclose(rows[0], rows[1], atol=1e-9)
    machine = arm(tmp_path, SITE, 1.0)
    with pytest.raises(RobotError, match=r"cannot be tilted .* \(gravcomp of bodies upper, fore\)"):
        bare_model(machine.file, {"tilt_y": 0.1})


def test_one_mass_that_is_changed_leaves_those_of_bodies_that_are_taken_from_shapes(tmp_path: Path) -> None:
    """With inertiafromgeom, shapes of 2 kg override inertials of 1 kg; another body got 1 kg again."""
    shape = '<geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass="2"/>'
    end = '<body name="block" pos=".3 0 0"><inertial pos="0 0 .1" mass=".3" diaginertia=".01 .01 .01"/></body>'
    machine = arm(tmp_path, end, compiler='inertiafromgeom="true"', shape=shape)
    believed = mujoco.MjModel.from_xml_path(str(machine.file.path))
    model = bare_model(machine.file, {"fore_mass": 2.4})
    np.testing.assert_allclose(model.body_mass, [0.0, 2.0, 2.4, 0.3])
    for values in ("body_ipos", "body_iquat"):
        np.testing.assert_allclose(getattr(model, values), getattr(believed, values), atol=1e-9)
    np.testing.assert_allclose(model.body("upper").inertia, believed.body("upper").inertia)
    assert read_model(machine.file.path).bodies["upper"].mass == 2.0


CARRIAGE = """<mujoco><worldbody><body name="base"><joint name="turn" axis="0 0 1"/>
<inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.01"/>
<body name="cart" pos="0.1 0 0"><joint name="slide" type="slide" axis="1 0 0"/>
<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/></body></body></worldbody></mujoco>"""


def moving_joints(joints: int, samples: int = 5) -> Motion:
    return Motion(*np.random.default_rng(7).normal(0.0, 0.7, (3, samples, joints)))


def with_more(model: mujoco.MjModel, joint: int, more: float) -> mujoco.MjModel:
    """A robot whose joint's own body has more inertia about that joint's axis [kg.m2], and no other."""
    other, body = model.__copy__(), int(model.jnt_bodyid[joint])
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    axes, axis = turn.reshape(3, 3), np.array(model.jnt_axis[joint])
    whole = axes @ np.diag(model.body_inertia[body]) @ axes.T + more * np.outer(axis, axis)
    principal, frame = np.linalg.eigh(whole)
    frame[:, 0] *= np.linalg.det(frame)
    mujoco.mju_mat2Quat(other.body_iquat[body], frame.ravel())
    other.body_inertia[body] = principal
    other.body_sameframe[body] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
    return other


def test_an_inertia_of_a_link_asks_for_a_torque_when_its_parent_turns_it() -> None:
    """It entered the joint's own inertia alone: a forearm that a shoulder swings was as light as before."""
    model = mujoco.MjModel.from_xml_string(mjcf(ARMS["two_link"]))
    motion = moving_joints(2)
    block = block_of(terms_along(model, 1, motion), T_SPIN)
    ratio = float(model.jnt_axis[0] @ model.jnt_axis[1])
    np.testing.assert_allclose(block[:, E_INERTIA - T_OWN], 1.0, atol=1e-9)
    np.testing.assert_allclose(block[:, E_COUPLING - T_OWN], ratio * motion.acceleration[:, 0], atol=1e-9)
    np.testing.assert_allclose(block[:, 1], ratio * motion.acceleration[:, 0], atol=1e-9)  # the whole bias
    np.testing.assert_allclose(block[:, 2:5], 0.0, atol=1e-9)


def test_it_is_that_of_the_body_whatever_the_axes_above() -> None:
    model = mujoco.MjModel.from_xml_string(mjcf(ARMS["six_joint"]))
    motion = moving_joints(model.nv)
    for joint in range(model.njnt):
        plain, heavy = terms_along(model, joint, motion), terms_along(with_more(model, joint, 0.02), joint, motion)
        added = block_of(heavy, 0) - block_of(plain, 0)
        np.testing.assert_allclose(0.02 * block_of(plain, T_SPIN), added, atol=1e-6)


def test_of_a_joint_whose_parent_does_not_turn_it_is_inertia_alone_and_of_a_slide_nothing() -> None:
    model = mujoco.MjModel.from_xml_string(CARRIAGE)
    motion = moving_joints(2)
    np.testing.assert_array_equal(spin_block(model, 0, motion), np.tile([1.0, 0, 0, 0, 0, 0], (5, 1)))
    assert not spin_block(model, 1, motion).any()


def test_it_turns_round_with_a_log_that_counts_the_other_way() -> None:
    model = mujoco.MjModel.from_xml_string(mjcf(ARMS["two_link"]))
    motion = moving_joints(2)
    one, other = (block_of(terms_along(model, 1, motion, sign), T_SPIN) for sign in (1.0, -1.0))
    np.testing.assert_allclose(other[:, E_INERTIA - T_OWN], one[:, E_INERTIA - T_OWN])
    np.testing.assert_allclose(other[:, E_COUPLING - T_OWN], -one[:, E_COUPLING - T_OWN])
    assert terms_along(model, 1, motion).shape[1] == T_COLUMNS


@pytest.mark.parametrize("more", [0.003, -1e-4])
def test_an_inertia_that_was_found_of_a_link_is_the_bodys_in_the_robots_model(tmp_path: Path, more: float) -> None:
    """It became an armature, which feels no parent: the extended model meant something else than the diagnosis."""
    (tmp_path / "arm.xml").write_text(mjcf(ARMS["two_link"]))
    file = load_robot_file(tmp_path / "arm.xml")
    name = file.joints[1].joint
    plain, found = (as_robot(file).build_spec(params).compile() for params in ({}, {f"{name}_inertia": more}))
    motion = moving_joints(2)
    wanted = block_of(terms_along(plain, 1, motion), 0) + more * block_of(terms_along(plain, 1, motion), T_SPIN)
    np.testing.assert_allclose(block_of(terms_along(found, 1, motion), 0), wanted, atol=1e-6)
    assert found.dof_armature[1] == plain.dof_armature[1]
    rotor = as_robot(file).build_spec({f"{name}_rotor": 0.003}).compile()
    assert rotor.dof_armature[1] == pytest.approx(plain.dof_armature[1] + 0.003)


@pytest.mark.parametrize(
    ("shoulder", "elbow", "wanted"),
    [
        (0.005, 0.006, {"elbow": 0.006}),
        (0.010, 0.006, {"shoulder": 0.004, "elbow": 0.006}),
        (0.01, 0.0, {"shoulder": 0.01}),
    ],
)
def test_what_a_shoulder_feels_of_its_forearm_is_not_added_to_the_upper_arm_too(
    tmp_path: Path, shoulder: float, elbow: float, wanted: dict[str, float]
) -> None:
    """Alone, each joint named the same 0.006 kg.m2, and the whole robot got it twice."""
    machine = robot(two_link_run(tmp_path, 2.0))
    found = {"shoulder": shoulder, "elbow": elbow}
    changes = [Change(j, "load.extra_inertia", 0.0, x, "load.inertia", "robot") for j, x in found.items() if x]
    kept = {change.joint: change.after for change in of_robot(machine, changes)}
    assert kept == {name: pytest.approx(value) for name, value in wanted.items()}


@pytest.mark.long
@pytest.mark.parametrize(
    ("number", "part"),
    [
        ("load.extra_inertia", "link"),
        pytest.param("load.rotor_inertia", "rotor", marks=pytest.mark.weekly),
    ],
)
def test_the_inertia_of_a_forearm_is_told_from_that_of_its_rotor(tmp_path: Path, number: str, part: str) -> None:
    """Where the shoulder swings the forearm. Masses, centres and strengths of the drive were named, as certain."""
    path, more = tmp_path / "two.xml", 0.006
    named = dict(zip(("m1", "m2", "c1", "c2", "i1", "i2"), (*MASS, *CENTRE, *INERTIA), strict=True))
    path.write_text(MODEL.format(length=LENGTH, **named))
    inertia, rotors = (
        (INERTIA[0], INERTIA[1] + more * (part == "link")),
        (ROTOR[0], ROTOR[1] + more * (part == "rotor")),
    )
    chains = {
        joint: [
            {"delay": {"seconds": 0.0}},
            {"torque_command": {"armature": rotor}},
            {"friction": {"coulomb": dry, "viscous": 0.0}},
        ]
        for joint, rotor, dry in zip(("upper", "fore"), ROTOR, COULOMB, strict=True)
    }
    runs = [moved(seed, inertia=inertia, rotor=rotors) for seed in (1, 2, 3)]
    (found,) = diagnose(measured_set(runs, {"robot": str(path), "actuators": chains}, "two"), only=["fore"])
    (cause,) = found.causes
    assert (cause.name, list(cause.parameters), cause.standing) == ("load.inertia", [number], "certain")
    assert cause.parameters[number].value == pytest.approx(more, rel=0.2)
