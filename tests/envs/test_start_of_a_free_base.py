"""Episodes of a robot of one's own start its base where the keyframe has it, not only its joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import sealegs
from sealegs.actuators import load_chain
from sealegs.envs.contract import make_contract, start_pose
from sealegs.envs.robots import get_robot
from sealegs.hw.virtual.machine import Machine

DOG = """<mujoco><compiler angle="radian" autolimits="true"/><worldbody><geom type="plane" size="5 5 0.1"/>
<body name="trunk" pos="0 0 0.5">{base}<geom type="box" size="0.1 0.05 0.03" mass="2"/>
<body name="thigh" pos="0 0.07 0"><joint name="hip" axis="0 1 0" range="-1 1" damping="0.1"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.15" size="0.02" mass="0.2"/></body>
<body name="tail" pos="-0.1 0 0"><joint {tail} axis="0 1 0" stiffness="1" damping="0.01"/>
<geom type="capsule" fromto="0 0 0 -0.1 0 0" size="0.01" mass="0.05"/></body></body></worldbody>
<actuator><position joint="hip" kp="30" kv="1"/></actuator>
<keyframe>{key}</keyframe></mujoco>"""
HOME = '<key name="low" qpos="0 0 0.1 1 0 0 0 0 0"/><key name="home" qpos="1 2 0.25 2 0 0 2 0.2 0.4"/>'
NAMES = {"named": ('<freejoint name="root"/>', 'name="wag"'), "nameless": ("<freejoint/>", "")}


def dog(folder: Path, names: str = "named", key: str = HOME) -> Path:
    base, tail = NAMES[names]
    path = folder / "dog.xml"
    path.write_text(DOG.format(base=base, tail=tail, key=key))
    return path


def start(path: Path, task: str = "track") -> np.ndarray:
    """Positions at the start of an episode: seven of the base, the hip, the tail."""
    env = sealegs.make_env(task, robot=str(path))
    env.reset(seed=0)
    return np.array(env.unwrapped.data.qpos)


@pytest.mark.parametrize("task", ["track", "reach"])
@pytest.mark.parametrize("names", NAMES)
def test_the_base_and_a_joint_that_nothing_drives_start_as_in_the_keyframe_home(
    task: str, names: str, tmp_path: Path
) -> None:
    """A dog that its file stands at a height of 0.25 m fell on it from 0.5 m."""
    found = start(dog(tmp_path, names), task)
    np.testing.assert_allclose(found[:7], [1.0, 2.0, 0.25, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    assert found[8] == 0.4 and found[7] == pytest.approx(0.2, abs=0.45)


@pytest.mark.parametrize("key", ["", '<key name="home" qpos="0 0 0.25"/>'])
def test_without_a_keyframe_of_the_robots_size_the_base_starts_where_the_file_has_it(key: str, tmp_path: Path) -> None:
    found = start(dog(tmp_path, key=key))
    np.testing.assert_allclose(found[:7], [0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("names", NAMES)
def test_a_virtual_machine_stands_where_the_episodes_of_its_policy_start(names: str, tmp_path: Path) -> None:
    """Of a base without a name, asking where it stands ended in a traceback."""
    path = dog(tmp_path, names)
    robot = get_robot(path)
    chains = {name: load_chain(chain).to_list() for name, chain in robot.chains_for(None).items()}
    contract = make_contract({"id": "SeaLegs/Reach-v0", "robot": str(path)}, chains, 50.0)
    machine = Machine(robot, pose=start_pose(contract))
    np.testing.assert_allclose(machine.data.qpos[:7], [1.0, 2.0, 0.25, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)], atol=1e-9)


def test_a_base_that_the_yaml_sets_on_a_stand_stays_where_the_file_has_it(tmp_path: Path) -> None:
    dog(tmp_path)
    path = tmp_path / "stand.yaml"
    path.write_text("model: dog.xml\nbase: fixed\njoints: {hip: {chain: sts3215}}\n")
    assert start(path)[1] == 0.4 and len(start(path)) == 2
