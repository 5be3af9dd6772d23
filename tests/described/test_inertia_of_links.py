"""The inertia of a link, which acts on all that turns it: its own joint and those above."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.envs.described.as_robot import as_robot
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.extended import Change
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.load.terms import E_COUPLING, E_INERTIA, T_COLUMNS, T_OWN, T_SPIN
from sealegs.gap.load.tree import Motion, spin_block, terms_along
from sealegs.gap.log.arrays import measured_set
from sealegs.gap.output.robot_extension import of_robot

from testbed.arm import ARMS, mjcf
from tests.gap.log.test_torque_driven_arm import CENTRE, COULOMB, INERTIA, LENGTH, MASS, MODEL, ROTOR, moved
from tests.logged_robots import block_of, robot, two_link_run

CARRIAGE = """<mujoco><worldbody><body name="base"><joint name="turn" axis="0 0 1"/>
<inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.01"/>
<body name="cart" pos="0.1 0 0"><joint name="slide" type="slide" axis="1 0 0"/>
<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/></body></body></worldbody></mujoco>"""


def moving(joints: int, samples: int = 5) -> Motion:
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
    motion = moving(2)
    block = block_of(terms_along(model, 1, motion), T_SPIN)
    ratio = float(model.jnt_axis[0] @ model.jnt_axis[1])
    np.testing.assert_allclose(block[:, E_INERTIA - T_OWN], 1.0, atol=1e-9)
    np.testing.assert_allclose(block[:, E_COUPLING - T_OWN], ratio * motion.acceleration[:, 0], atol=1e-9)
    np.testing.assert_allclose(block[:, 1], ratio * motion.acceleration[:, 0], atol=1e-9)  # the whole bias
    np.testing.assert_allclose(block[:, 2:5], 0.0, atol=1e-9)


def test_it_is_that_of_the_body_whatever_the_axes_above() -> None:
    model = mujoco.MjModel.from_xml_string(mjcf(ARMS["six_joint"]))
    motion = moving(model.nv)
    for joint in range(model.njnt):
        plain, heavy = terms_along(model, joint, motion), terms_along(with_more(model, joint, 0.02), joint, motion)
        added = block_of(heavy, 0) - block_of(plain, 0)
        np.testing.assert_allclose(0.02 * block_of(plain, T_SPIN), added, atol=1e-6)


def test_of_a_joint_whose_parent_does_not_turn_it_is_inertia_alone_and_of_a_slide_nothing() -> None:
    model = mujoco.MjModel.from_xml_string(CARRIAGE)
    motion = moving(2)
    np.testing.assert_array_equal(spin_block(model, 0, motion), np.tile([1.0, 0, 0, 0, 0, 0], (5, 1)))
    assert not spin_block(model, 1, motion).any()


def test_it_turns_round_with_a_log_that_counts_the_other_way() -> None:
    model = mujoco.MjModel.from_xml_string(mjcf(ARMS["two_link"]))
    motion = moving(2)
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
    motion = moving(2)
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
@pytest.mark.parametrize(("number", "part"), [("load.extra_inertia", "link"), ("load.rotor_inertia", "rotor")])
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
