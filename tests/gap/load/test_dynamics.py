"""What joints work against along a motion is what MuJoCo's Newton-Euler algorithm says, sample by sample."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from sealegs.gap.load import dynamics
from sealegs.gap.load.dynamics import Dynamics

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
