"""A joint that is driven by torques keeps its amplifier's faults in the model for plain MuJoCo."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.actuators.chain import load_chain
from sealegs.envs.described.as_robot import as_robot
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.gap.output.mjcf import native_text, not_native

ARM = """<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody><body name="u"><joint name="s" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.5"/></body></worldbody></mujoco>"""
FAULTS = {
    "a weak motor": [{"scale": {"factor": 0.8}}, {"torque_command": {"armature": 0.02}}],
    "a late command": [{"delay": {"seconds": 0.02}}, {"torque_command": {"armature": 0.02}}],
    "a bias": [{"torque_command": {"armature": 0.02}}, {"offset": {"value": 0.05}}],
    "a limit before a factor": [
        {"torque_command": {"armature": 0.02}}, {"torque_limit": {"limit": 0.3}}, {"scale": {"factor": 0.5}}
    ],
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_plain_mujoco_moves_as_the_chain_does(fault: str, tmp_path: Path) -> None:
    """The motor was written bare: the weak slide that had been named moved as a strong one."""
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    chain = load_chain(FAULTS[fault])
    drivetrain = as_robot(load_robot_file(path)).drivetrain({"s": chain})
    assert not_native(chain) == []
    plain = mujoco.MjModel.from_xml_string(native_text(drivetrain.spec.to_xml(), drivetrain.chains))
    ends = []
    for model in (drivetrain.model, plain):
        data = mujoco.MjData(model)
        for k in range(400):
            data.ctrl[:] = 0.4 * (k > 50) * np.sign(np.sin(2.0 * np.pi * 5.0 * k * 1e-3) + 0.2)
            mujoco.mj_step(model, data)
        ends.append([data.qpos[0], data.qvel[0]])
    np.testing.assert_allclose(*ends, rtol=0.01)
    assert np.abs(ends[0]).max() > 0.04
