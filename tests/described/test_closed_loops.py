"""Loops that welds and connects close: closed before the first step, and tried on many episodes."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.commands import new_robot
from sealegs.envs.any_robot.reach import ReachTask
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.engine.batch import BatchEngine
from sealegs.envs.engine.model_poses import Loops
from sealegs.envs.new_robot.robot_trial import tried
from sealegs.envs.robots import get_robot
from sealegs.hw.virtual.machine import Machine

HEAD = '<mujoco model="{name}"><compiler angle="radian" autolimits="true"/><option gravity="0 0 -9.81"/><worldbody>'


def four_bar(reach: float = 1.2, apart: float = 0.01, aside: float = 0.0) -> str:
    """A crank and a rocker with a rod between; its end is ``apart`` from its pin in the file [m]."""
    return f"""{HEAD.format(name="bar")}<body name="ground"><geom type="box" size="0.02 0.02 0.02" mass="1"/>
    <body name="crank"><joint name="crank" axis="0 1 0" range="-{reach} {reach}" armature="0.002"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.06" size="0.006" mass="0.05" contype="0" conaffinity="0"/>
      <body name="rod" pos="0 0 0.06"><joint name="rod" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0.2 0 0.04" size="0.004" mass="0.02" contype="0" conaffinity="0"/>
        <site name="end" pos="{0.2 + apart} {aside} 0.04"/></body></body>
    <body name="rocker" pos="0.2 0 0"><joint name="rocker" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.1" size="0.006" mass="0.05" contype="0" conaffinity="0"/>
      <site name="pin" pos="0 0 0.1"/></body></body></worldbody>
    <equality><connect site1="end" site2="pin"/></equality>
    <actuator><position joint="crank" kp="20" kv="0.5" forcerange="-3 3"/></actuator></mujoco>"""


def welded() -> str:
    """Two arms on a free base, whose ends a weld holds together; in the file they are 10 mm apart."""
    arm = """<body name="{n}" pos="{x} 0 0"><joint name="{n}_shoulder" axis="0 1 0" range="-1 1" armature="0.002"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.1" size="0.008" mass="0.05" contype="0" conaffinity="0"/>
      <body name="{n}_fore" pos="0 0 -0.1"><joint name="{n}_elbow" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 {w} 0 -0.1" size="0.006" mass="0.03" contype="0" conaffinity="0"/>
      <body name="{n}_hand" pos="{w} 0 -0.1"><joint name="{n}_wrist" axis="0 1 0"/>
      <geom type="sphere" size="0.006" mass="0.01" contype="0" conaffinity="0"/><site name="{n}_hand"/>
      </body></body></body>"""
    left, right = arm.format(n="left", x=-0.05, w=0.045), arm.format(n="right", x=0.05, w=-0.045)
    servos = "".join(f'<position joint="{n}_shoulder" kp="10" kv="0.3" forcerange="-2 2"/>' for n in ("left", "right"))
    return f"""{HEAD.format(name="welded")}<geom type="plane" size="1 1 0.1" pos="0 0 -1"/>
    <body name="trunk"><freejoint/>
    <geom type="box" size="0.06 0.03 0.02" mass="1"/>{left}{right}</body></worldbody>
    <equality><weld site1="left_hand" site2="right_hand"/></equality><actuator>{servos}</actuator></mujoco>"""


def file(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def begun(path: Path, episodes: int = 3) -> BatchEngine:
    engine = BatchEngine(ReachTask.on(get_robot(path))(start_noise=0.3), episodes, autoreset=False)
    engine.seed(0)
    engine.reset()
    return engine


def open_by(engine: BatchEngine) -> float:
    """How far the loops of all simulations are open [m or rad]."""
    data, largest = mujoco.MjData(engine.drivetrain.model), 0.0
    for k in range(engine.num_envs):
        engine.look(k, data)
        largest = max(largest, float(np.abs(data.efc_pos[: data.ne]).max()))
    return largest


@pytest.mark.parametrize("text", [four_bar(), welded()], ids=["connect", "weld"])
def test_episodes_begin_with_loops_closed_that_the_file_has_open(tmp_path: Path, text: str) -> None:
    engine = begun(file(tmp_path / "looped.xml", text))
    data = mujoco.MjData(engine.drivetrain.model)
    mujoco.mj_forward(engine.drivetrain.model, data)
    assert np.abs(data.efc_pos[: data.ne]).max() > 0.009
    assert open_by(engine) < 1e-6
    goals, places = engine.batch.bind("ctrl"), engine.motion(np.zeros((3, len(engine.names)))).link
    np.testing.assert_allclose(goals, places, atol=1e-9)  # goals hold the robot where the loops let it be
    engine.step(np.clip((goals - engine.goal_centre) / engine.goal_half, -1.0, 1.0))
    assert np.abs(engine.batch.bind("qvel")).max() < 2.0


def test_joints_that_nothing_drives_give_way_and_the_base_stays(tmp_path: Path) -> None:
    drivetrain = get_robot(file(tmp_path / "looped.xml", welded())).drivetrain()
    loops = Loops.of(drivetrain)
    assert loops is not None
    qpos = np.array(drivetrain.model.qpos0)
    before = qpos.copy()
    assert loops.open(qpos) > 0.009
    assert loops.close(qpos) < 1e-6
    np.testing.assert_allclose(qpos[:7], before[:7], atol=1e-4)
    model = drivetrain.model
    at = {model.joint(k).name: int(model.jnt_qposadr[k]) for k in range(1, model.njnt)}
    moved = {name: abs(float(qpos[place] - before[place])) for name, place in at.items()}
    assert moved["left_shoulder"] < 0.2 * moved["left_elbow"]


def test_the_virtual_machine_begins_with_them_closed_too(tmp_path: Path) -> None:
    machine = Machine(get_robot(file(tmp_path / "looped.xml", four_bar())))
    mujoco.mj_forward(machine.model, machine.data)
    assert np.abs(machine.data.efc_pos[: machine.data.ne]).max() < 1e-6
    machine.advance(0.5)
    assert machine.time == pytest.approx(0.5)


def test_new_robot_says_that_loops_are_open_in_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = file(tmp_path / "looped.xml", four_bar())
    new_robot.main([str(model), f"out={tmp_path / 'looped.yaml'}"])
    said = capsys.readouterr().out
    assert "are open by 10 mm or mrad in the file; episodes start with them closed" in said


def test_loops_that_cannot_be_closed_are_warned_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = file(tmp_path / "looped.xml", four_bar(aside=0.004))
    new_robot.main([str(model), f"out={tmp_path / 'looped.yaml'}"])
    assert "stay open by 4 mm or mrad where episodes start, whatever its joints do" in capsys.readouterr().out


def test_what_breaks_in_some_episodes_only_is_caught(tmp_path: Path) -> None:
    """A rod that is too short for some goals of a stiff crank: it broke in 13 of 64 episodes, and in none of one."""
    text = four_bar(reach=2.0).replace('kp="20" kv="0.5" forcerange="-3 3"', 'kp="400" kv="1"')
    text = text.replace('armature="0.002"', 'armature="0.0005"').replace('mass="0.02"', 'mass="0.002"')
    lasted, said = tried(load_robot_file(file(tmp_path / "looped.xml", text)))
    found = re.search(r"crank is beyond all bounds after .* s, of goals anywhere .*, in (\d+) of 64 episodes", said)
    assert found is not None and 0 < int(found[1]) < 64 and 64 < lasted < 100
