"""What joints work against along a motion, and joints that an equality ties: judged as one, with the mass of both."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.envs.engine.model_poses import followers_of
from sealegs.gap.diagnose import diagnose
from sealegs.gap.load import dynamics
from sealegs.gap.load.dynamics import Dynamics
from sealegs.gap.load.robot import LoggedRobot, moved_by
from sealegs.gap.load.tree import Motion, block_along, carries, terms_along
from sealegs.gap.log.types import MeasuredRun
from sealegs.gap.replay.tree import not_free, torques_of
from sealegs.gap.robot.directions import payload

MASSES, LENGTHS, RATIO = (0.3, 0.2), (0.12, 0.15), -0.8  # of the two fingers [kg, m], and of the ways they go
STIFFNESS, DAMPING = 6.0, 0.15  # of the servo [N.m/rad, N.m.s/rad]
FINGERS = """<mujoco><compiler angle="radian"/><worldbody>
<body name="thumb"><joint name="jaw" axis="0 1 0" range="-2 2"/>
<inertial pos="0 0 -0.12" mass="0.3" diaginertia="1e-7 1e-7 1e-7"/>{inside}</body>{beside}</worldbody>
<equality><joint name="tie" joint1="mirror" joint2="jaw" polycoef="{polycoef}"/></equality></mujoco>"""
MIRROR = """<body name="finger" pos="0.1 0 0"><joint name="mirror" axis="0 1 0" damping="{damping}" {more}/>
<inertial pos="0 0 -0.15" mass="0.2" diaginertia="1e-7 1e-7 1e-7"/></body>"""


def gripper(
    folder: Path, *, inside: bool = False, damping: float = 0.0, more: str = "", polycoef: str = "0 -0.8 0 0 0"
) -> Path:
    """The model of two fingers side by side, or of one on the other."""
    mirror = MIRROR.format(damping=damping, more=more)
    text = FINGERS.format(inside=mirror if inside else "", beside="" if inside else mirror, polycoef=polycoef)
    folder.mkdir(exist_ok=True)
    path = folder / "gripper.xml"
    path.write_text(text)
    return path


def log(friction: float, mirror_damping: float, seed: int = 3) -> dict[str, np.ndarray]:
    """Two pendulums that turn together behind a servo, in a simulation of its own: 20 s at 200 Hz."""
    (m1, m2), (l1, l2), r = MASSES, LENGTHS, RATIO
    inertia, step, every = m1 * l1**2 + r**2 * m2 * l2**2, 1e-4, 50
    time = np.arange(4000) * 0.005
    goal = 0.5 * np.sin(2 * np.pi * (0.3 * time + 0.04 * time**2)) + 0.3 * np.sign(np.sin(2.2 * time))
    q = w = 0.0
    position = np.empty_like(time)
    for k in range(len(time)):
        position[k] = q
        for _ in range(every):
            gravity = 9.81 * (m1 * l1 * np.sin(q) + r * m2 * l2 * np.sin(r * q))
            torque = STIFFNESS * (goal[k] - q) - (DAMPING + r**2 * mirror_damping) * w - gravity
            a = (torque - np.clip(w / 1e-3, -1.0, 1.0) * friction) / inertia
            w += step * a
            q += step * w
    position += np.random.default_rng(seed).normal(0.0, 5e-4, len(time))
    return {"time": time, "jaw.goal": goal, "jaw.position": position}


def machine(path: Path) -> LoggedRobot:
    from tests.logged_robots import robot

    return robot(MeasuredRun(path.stem, np.arange(3.0), {}, robot=str(path)))


def sidecar(model: Path) -> dict[str, object]:
    chain = [{"ideal": {"stiffness": STIFFNESS, "damping": DAMPING}}]
    return {"robot": str(model), "actuators": {"jaw": chain}}


@pytest.mark.long
def test_a_finger_that_another_one_follows_is_replayed_with_the_mass_of_both(tmp_path: Path) -> None:
    model = gripper(tmp_path, damping=0.02)
    found = diagnose(log(0.0, 0.02), sidecar=sidecar(model), causes=["friction.coulomb", "load.mass"]).joint("jaw")
    assert found.gap["nominal"].rmse < 1.3e-3, "and with the damping of both"
    assert "robot.held" not in [finding.code for finding in found.findings] and not found.causes


@pytest.mark.long
def test_friction_behind_a_finger_that_another_one_follows_is_found(tmp_path: Path) -> None:
    model = gripper(tmp_path)
    found = diagnose(log(0.12, 0.0), sidecar=sidecar(model), causes=["friction.coulomb", "load.mass", "drive.delay"])
    (cause,) = found.joint("jaw").causes
    assert cause.name == "friction.coulomb" and abs(cause.parameters["friction.coulomb"].value - 0.12) < 0.02


@pytest.mark.parametrize("inside", [False, True])
def test_the_terms_of_tied_joints_are_those_of_one_joint(tmp_path: Path, inside: bool) -> None:
    """Against the torques of both along motions a little further, faster and faster still."""
    model = mujoco.MjModel.from_xml_path(str(gripper(tmp_path, inside=inside)))
    assert moved_by(model, 0) == {0: 1.0, 1: RATIO} and followers_of(model)[1].leader == 0
    way = np.array([1.0, RATIO])
    q, w, a = (np.linspace(low, high, 7) for low, high in ((-1.0, 1.2), (-3.0, 2.0), (5.0, -8.0)))

    def torque(q: np.ndarray, w: np.ndarray, a: np.ndarray) -> np.ndarray:
        return torques_of(model, Motion(np.outer(q, way), np.outer(w, way), np.outer(a, way))) @ way

    own = terms_along(model, 0, Motion(np.outer(q, way), np.outer(w, way), np.outer(a, way)))[:, 2:8]
    inertia, bias, slope, _, drag, coupling = own.T
    np.testing.assert_allclose(bias + inertia * a, torque(q, w, a), atol=1e-9)
    np.testing.assert_allclose(inertia, torque(q, w, a + 1.0) - torque(q, w, a), atol=1e-9)
    np.testing.assert_allclose(slope, (torque(q + 1e-4, w, 0 * a) - torque(q - 1e-4, w, 0 * a)) / 2e-4, atol=1e-3)
    np.testing.assert_allclose(drag, (torque(q, w + 1e-4, a) - torque(q, w - 1e-4, a)) / 2e-4, atol=1e-6)
    np.testing.assert_allclose(coupling, 0.0, atol=1e-9)
    assert carries(model, 0, model.body("finger").id)


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ({"polycoef": "0 -1 0.2 0 0"}, "ties 'mirror' to 'jaw' otherwise than in proportion"),
        ({"more": 'frictionloss="0.1"'}, "ties 'mirror' to 'jaw', which has dry friction of its own"),
    ],
)
def test_a_finger_is_moved_as_measured_where_the_other_one_follows_otherwise(tmp_path: Path, more, why: str) -> None:
    held = not_free(machine(gripper(tmp_path, **more)), "jaw", [])
    assert held is not None and why in held.sentence


def test_armature_and_damping_of_a_follower_are_no_mass_of_a_body(tmp_path: Path) -> None:
    """They were added once more per kilogram of a payload that joints share."""
    plain, heavy = (
        payload(machine(gripper(folder, damping=damping, more=more)), "jaw")
        for folder, damping, more in ((tmp_path / "a", 0.0, ""), (tmp_path / "b", 0.5, 'armature="0.3"'))
    )
    assert plain is not None and heavy is not None
    motion = Motion(*(np.full((4, 2), value) for value in (0.3, 1.0, 2.0)))
    one, other = (block_along(found.change()[1], 0, motion) for found in (plain, heavy))
    np.testing.assert_allclose(one, other, atol=1e-12)


ROBOT = """<mujoco><worldbody><body name="base"><freejoint/><geom size=".1" mass="2"/>
<body name="upper" pos=".1 0 0"><joint name="upper" axis="0 1 0" stiffness="2" armature=".3"/>
<geom size=".05" pos=".1 0 0" mass=".4"/>
<body name="lower" pos=".2 0 0"><joint name="lower" axis="0 0 1" armature=".1" damping=".2"/>
<geom size=".05" pos=".1 .02 0" mass=".3"/></body></body>
<body name="slider" pos="0 .1 0"><joint name="slider" type="slide" axis="0 1 0"/><geom size=".05" mass=".2"/></body>
</body></worldbody></mujoco>"""
TIED = {"upper": 1.0, "lower": 0.5}
ALONE = """<mujoco><worldbody><body name="carriage"><joint name="x" type="slide" axis="1 0 0" armature=".2"/>
<joint name="y" type="slide" axis="0 1 0"/><joint name="turn" axis="0 0 1"/>
<inertial pos="0 0 0" mass="3" diaginertia="1 2 3"/></body></worldbody></mujoco>"""


def by_newton_euler(model: mujoco.MjModel, dofs: np.ndarray, ratios: np.ndarray, q, w, a) -> np.ndarray:
    """Torque of the joints together, of each sample (n,)."""
    data, result, found = mujoco.MjData(model), np.zeros(model.nv), []
    for row in range(len(q)):
        data.qpos[-3:], data.qvel[:], data.qacc[:] = q[row][-3:], w[row], a[row]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 1, result)
        found.append(ratios @ result[dofs])
    return np.array(found)


@pytest.mark.parametrize("joints", [{"lower": 1.0}, {"slider": 1.0}, TIED])
@pytest.mark.parametrize("empty", [False, True], ids=["as it is", "one body has all the mass"])
def test_torques_along_a_motion_are_those_of_newton_and_euler(
    joints: dict[str, float], empty: bool, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(dynamics, "MAX_BATCH_SAMPLES", 16)  # several rounds
    model = mujoco.MjModel.from_xml_string(ROBOT)
    if empty:
        last = model.body("lower").id
        model.body_mass[np.arange(model.nbody) != last] = model.body_inertia[np.arange(model.nbody) != last] = 0.0
    rng = np.random.default_rng(5)
    q, w, a = (scale * rng.normal(size=(40, model.nv)) for scale in (0.5, 2.0, 10.0))
    dofs, ratios = model.jnt_dofadr[[model.joint(name).id for name in joints]], np.array(list(joints.values()))

    parts = Dynamics(model, dofs, ratios, len(q))
    found = []
    for first in range(0, len(q), parts.size):
        part = slice(first, first + parts.size)
        row, bias = parts.at(q[part], w[part])
        found.append((row * a[part]).sum(axis=1) + bias)

    needed = by_newton_euler(model, dofs, ratios, q, w, a)
    np.testing.assert_allclose(np.concatenate(found), needed, rtol=0.0, atol=1e-9 * np.abs(needed).max() + 1e-12)
    assert "singular" not in "".join(capfd.readouterr())


@pytest.mark.parametrize("joint", ["x", "turn"])
@pytest.mark.parametrize("shift", [0.0, 0.1])
def test_a_body_alone_on_the_world_has_the_mass_that_it_was_given(joint: str, shift: float) -> None:
    """MuJoCo takes its mass matrix from the compiled model: a carriage of 95 kg lost one, and 1 kg at it weighed 94."""
    model = mujoco.MjModel.from_xml_string(ALONE)
    assert model.body_simple.any()
    model.body_mass[1], model.body_ipos[1, 0] = 1.0, shift
    model.body_sameframe[1] = int(mujoco.mjtSameFrame.mjSAMEFRAME_NONE)
    rng = np.random.default_rng(6)
    q, w, a = (scale * rng.normal(size=(40, model.nv)) for scale in (0.5, 2.0, 10.0))
    dofs, ratios = model.jnt_dofadr[[model.joint(joint).id]], np.ones(1)
    row, bias = Dynamics(model, dofs, ratios, len(q)).at(q, w)
    needed = by_newton_euler(model, dofs, ratios, q, w, a)
    np.testing.assert_allclose((row * a).sum(axis=1) + bias, needed, atol=1e-9 * np.abs(needed).max())
