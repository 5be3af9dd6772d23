"""Models and callbacks of others in the same process keep what is theirs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import mujoco
import pytest
from sealegs.actuators.engine import install, installed

from tests.pendulum_on_a_chain import PENDULUM, drivetrain, run

REPOSITORY = Path(__file__).resolve().parents[2]
FOREIGN = """<mujoco><worldbody><body><joint name="j" axis="0 1 0"/><geom size=".1"/></body></worldbody><actuator>
<general joint="j" biastype="user" {user}/><motor joint="j"/></actuator></mujoco>"""


def foreign_script(setup: str, expected: str) -> None:
    """Run a check in a process of its own: callbacks belong to a process."""
    code = f"""
import ctypes, mujoco, numpy as np
from sealegs.actuators import Drivetrain
FOREIGN, PENDULUM = {FOREIGN!r}, {PENDULUM!r}
models = [mujoco.MjModel.from_xml_string(FOREIGN.format(user=user)) for user in ('', 'user="3 4"')]
{setup}
for _ in range(2):  # before and after one of ours exists
    forces = []
    for model in models:
        data = mujoco.MjData(model); data.ctrl[1] = 2.0
        mujoco.mj_step(model, data); forces += data.actuator_force.tolist()
    assert np.allclose(forces, {expected}), forces
    driven = Drivetrain(mujoco.MjSpec.from_string(PENDULUM), {{"shaft": "sts3215"}})
    ours = mujoco.MjData(driven.model); ours.ctrl[0] = 0.5
    mujoco.mj_step(driven.model, ours, 500)
    assert 0.3 < ours.qpos[0] < 0.6, ours.qpos
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.long
def test_models_without_our_actuators_are_untouched():
    foreign_script("", "[0, 2, 0, 2]")


@pytest.mark.long
def test_a_python_callback_of_another_library_keeps_its_actuators():
    foreign_script("mujoco.set_mjcb_act_bias(lambda model, data, actuator: 0.25)", "[0.25, 2, 0.25, 2]")


@pytest.mark.long
def test_a_c_callback_of_another_library_keeps_its_actuators():
    foreign_script(
        "kind = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int)\n"
        "theirs = kind(lambda model, data, actuator: 0.5)\n"
        "mujoco.set_mjcb_act_bias(theirs)",
        "[0.5, 2, 0.5, 2]",
    )


def test_the_law_is_installed_again_after_another_library_took_its_place():
    driven = drivetrain("sts3215")
    try:
        mujoco.set_mjcb_act_bias(None)
        assert not installed()
        drivetrain("ideal")
        assert installed()
        assert run(driven, 0.3, 0.5).qpos[0] > 0.1
    finally:
        install()
