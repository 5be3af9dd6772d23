"""Step, integrator and assumed servos of new-robot: they load and step; a chain too stiff for its step is refused."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest
import sealegs
import yaml
from sealegs.actuators import ChainError
from sealegs.commands import new_robot
from sealegs.common.errors import SealegsError
from sealegs.envs.any_robot.reach import ReachTask
from sealegs.envs.described.as_robot import as_robot
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.engine.batch import BatchEngine
from sealegs.envs.engine.model_poses import Loops
from sealegs.envs.new_robot.robot_trial import tried
from sealegs.envs.robots import get_robot
from sealegs.hw.virtual.machine import Machine

from tests.smooth_bench import PENDULUM, drivetrain, run

ROBOT = """<mujoco><compiler angle="radian" autolimits="true"/>{option}<worldbody>
<body name="upper" pos="0 0 1"><joint name="shoulder" axis="0 1 0" range="-1.5 1.5" {shoulder}/>
<inertial pos="0 0 -0.1" mass="0.4" diaginertia="0.002 0.002 0.001"/>
<body name="hand" pos="0 0 -0.2">{hand}</body></body></worldbody>{more}</mujoco>"""
LIGHT = """<joint name="finger" axis="0 1 0" {finger}/>
<inertial pos="0 0 -0.005" mass="0.01" diaginertia="1e-6 1e-6 1e-6"/>"""
MOTOR = '<actuator><motor joint="shoulder" ctrlrange="-5 5"/></actuator>'


def model(folder: Path, finger: str = "", shoulder: str = "", more: str = "", option: str = "") -> Path:
    path = folder / "robot.xml"
    path.write_text(ROBOT.format(shoulder=shoulder, hand=LIGHT.format(finger=finger), more=more, option=option))
    return path


def written(path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[dict, str]:
    new_robot.main([str(path)])
    return yaml.safe_load(path.with_suffix(".yaml").read_text()), capsys.readouterr().out


def resets(robot: Path, steps: int = 50) -> int:
    """How often the environment of a robot breaks in that many control steps."""
    env = sealegs.make_env("track", robot=str(robot))
    env.reset(seed=0)
    generator, count = np.random.default_rng(0), 0
    for _ in range(steps):
        terminated = env.step(generator.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32))[2]
        count += bool(terminated)
        if terminated:
            env.reset()
    return count


@pytest.mark.long
def test_the_damping_of_a_light_joint_that_nothing_drives_is_taken_implicitly(tmp_path: Path, capsys) -> None:
    """RK4 takes it explicitly: such robots exploded in the first steps."""
    robot, said = written(model(tmp_path, finger='damping="1"', more=MOTOR), capsys)
    assert (robot["timestep"], robot["integrator"]) == (5e-4, "implicitfast")
    reason = "since the damping that the file gives the joint finger would be unstable at a longer step"
    assert f"the simulation steps by 0.5 ms, with implicitfast, {reason}." in said
    assert resets(tmp_path / "robot.yaml") == 0


@pytest.mark.long
def test_a_spring_on_a_light_joint_that_nothing_drives_makes_the_step_shorter(tmp_path: Path, capsys) -> None:
    robot, said = written(model(tmp_path, finger='stiffness="5" damping="0.001"', more=MOTOR), capsys)
    assert robot["timestep"] < 2e-3 and "since the springs that the file gives the joint finger" in said
    assert resets(tmp_path / "robot.yaml") == 0


@pytest.mark.long
def test_a_joint_that_carries_followers_gets_a_servo_that_its_own_inertia_bears(tmp_path: Path, capsys) -> None:
    """new-robot reckoned with the inertia of all, the engine's check with that of the joint: it refused the file."""
    follower = """<body name="heavy" pos="0 0.2 1"><joint name="heavy" axis="0 1 0"/>
    <inertial pos="0 0 -0.1" mass="2" diaginertia="0.02 0.02 0.02"/></body>"""
    tie = '<equality><joint joint1="heavy" joint2="finger"/></equality>'
    path = model(tmp_path, more=f'{tie}<actuator><motor joint="finger" ctrlrange="-20 20"/></actuator>')
    path.write_text(path.read_text().replace("</worldbody>", f"{follower}</worldbody>"))
    robot, said = written(path, capsys)
    assert robot["timestep"] >= 2.5e-4
    assert re.search(r"joint finger: an ideal servo of \S+ N.m/rad drives it \(assumed: \S+ would be unstable at", said)
    assert resets(tmp_path / "robot.yaml") == 0


@pytest.mark.long
def test_steps_do_not_get_shorter_joint_by_joint(tmp_path: Path, capsys) -> None:
    """Each joint halved the step that those before had left, until it was shorter than a YAML may ask for."""
    fingers = "".join(
        f'<body pos="0 {0.02 * k} 0"><joint name="f{k}" axis="0 1 0" range="-1 1" damping="{damping}"/>'
        '<inertial pos="0 0 -0.005" mass="0.01" diaginertia="1e-6 1e-6 1e-6"/></body>'
        for k, damping in enumerate((0.02, 0.3))
    )
    servos = "".join(f'<position joint="f{k}" kp="0.2"/>' for k in range(2))
    path = model(tmp_path, more=f"<actuator>{servos}</actuator>", finger='armature="0.01"')
    path.write_text(path.read_text().replace("</body></body>", f"{fingers}</body></body>"))
    robot, said = written(path, capsys)
    assert robot["timestep"] >= 2.5e-4 and re.search(r"since at joint f\d the servo's", said), said


@pytest.mark.long
def test_an_assumed_step_fits_between_actions(tmp_path: Path, capsys) -> None:
    robot, _ = written(model(tmp_path, option='<option timestep="0.0015"/>', more=MOTOR), capsys)
    assert round(0.02 / robot["timestep"]) == pytest.approx(0.02 / robot["timestep"], rel=1e-8) == 14
    assert resets(tmp_path / "robot.yaml", 5) == 0


def test_an_assumed_servo_overcomes_friction_and_damping_of_the_file(tmp_path: Path) -> None:
    """It was 4 Hz with the joint's inertia, however much friction held that."""
    found = {}
    for more in ("", 'frictionloss="5"', 'damping="8"'):
        path = model(tmp_path, shoulder=more, finger='damping="0.001"').rename(tmp_path / f"{len(found)}.xml")
        found[more] = load_robot_file(path).joint("shoulder").chain.value("ideal.stiffness")
    assert found['frictionloss="5"'] >= 5.0 / (3.0 / 8.0) > found[""]
    assert found['damping="8"'] >= 8.0 * 4.0


@pytest.mark.long
def test_an_assumed_servo_that_friction_holds_is_named(tmp_path: Path, capsys) -> None:
    _, said = written(model(tmp_path, finger='range="-1 1" frictionloss="10"'), capsys)
    assert "Warning: joint finger: its servo of" in said and "N.m of dry friction only from an error of" in said
    (tmp_path / "robot.yaml").unlink()
    limited = 'range="-1 1" frictionloss="2" actuatorfrcrange="-1 1"'
    _, said = written(model(tmp_path, finger=limited), capsys)
    assert "Warning: joint finger: its largest force, 1 N.m, is not above the dry friction of 2 N.m" in said


@pytest.mark.long
def test_a_robot_whose_simulation_breaks_in_any_case_is_warned_about(tmp_path: Path, capsys) -> None:
    """Two bodies within each other, which the contact throws apart."""
    path = model(tmp_path, more=MOTOR, finger='damping="0.001"')
    inside = '<geom name="a" type="sphere" size="0.05" solref="-1e12 0" mass="0.001"/>'
    beside = (
        '<body pos="0 0 0.8"><freejoint/><geom name="b" type="sphere" size="0.05" solref="-1e12 0" mass="1e-6"/></body>'
    )
    text = path.read_text().replace("</body></body></worldbody>", f"{inside}</body></body>{beside}</worldbody>")
    path.write_text(text)
    _, said = written(path, capsys)
    assert re.search(r"Warning: robot.xml: a short trial of the simulation breaks at any step .*: .* of ", said)


@pytest.mark.long
def test_a_step_that_is_stable_in_the_pose_of_the_file_alone_is_made_shorter(tmp_path: Path, capsys) -> None:
    """Folded, this arm has a quarter of the inertia that it has outstretched."""
    path = tmp_path / "robot.xml"
    path.write_text("""<mujoco><compiler angle="radian" autolimits="true"/><worldbody>
<body><joint name="shoulder" axis="0 0 1" range="-1.5 1.5" armature="0.04"/><inertial pos="0.1 0 0" mass="0.01"
diaginertia="1e-5 1e-5 1e-5"/><body pos="0.2 0 0"><joint name="elbow" axis="0 0 1" range="0 3" armature="0.2"/>
<inertial pos="0.2 0 0" mass="1" diaginertia="1e-5 1e-5 1e-5"/></body></body></worldbody><actuator>
<position joint="shoulder" kp="500" kv="195"/><position joint="elbow" kp="2000" kv="40"/></actuator></mujoco>""")
    robot, said = written(path, capsys)
    assert (
        robot["timestep"] <= 1e-3
        and re.search("of goals (anywhere in|at the ends of) its ranges", said)
        and "Warning" not in said
    ), said
    assert resets(tmp_path / "robot.yaml") == 0


def test_a_run_stops_where_every_episode_breaks_at_once(tmp_path: Path) -> None:
    """Training went on, and handed over a policy that had seen nothing."""
    model(tmp_path, finger='damping="1"', more=MOTOR)
    path = tmp_path / "robot.yaml"
    servo = "[{ideal: {stiffness: 5, damping: 0.3}}]"
    path.write_text(f"model: robot.xml\ntimestep: 0.002\nintegrator: RK4\njoints: {{shoulder: {{chain: {servo}}}}}\n")
    with pytest.raises(SealegsError, match=r"the simulation of robot 'robot' breaks within the first 3 control steps"):
        resets(path)


IDEAL = {"ideal": {"stiffness": 1e5}}
DAMPED = {"ideal": {"stiffness": 2e4, "damping": 8.0}}
GEARED = [
    {"position_p": {"gain": 1000.0}},
    {"supply": {"volts": 12.0}},
    {"dc_motor": {"motor_constant": 0.02, "resistance": 1.0, "emf_ratio": 0.1}},
    {"gear": {"ratio": 250.0, "efficiency": 1.0}},
]
REGRESSION = [{"position_p": {"gain": 100.0}}, {"regression": {"duty_torque": 500.0, "speed_torque": -0.1}}]


def longest(chain: list, xml: str) -> float:
    """Step [s] that the refusal of a chain asks for."""
    with pytest.raises(ChainError, match=r"controller holds with .* N\.m/rad on an inertia") as caught:
        drivetrain(chain, xml)
    assert "\n" not in str(caught.value)
    found = re.search(r"shorter than (\S+) s", str(caught.value))
    assert found is not None
    return float(found[1])


def reached(model: mujoco.MjModel) -> float:
    """Largest position of a pendulum that starts at 0.01 rad and is held at 0 [rad]."""
    data = mujoco.MjData(model)
    data.qpos[0] = 0.01
    positions = []
    for _ in range(2000):
        mujoco.mj_step(model, data)
        positions.append(abs(float(data.qpos[0])))
    return max(positions)


@pytest.mark.parametrize("integrator", ["RK4", "implicitfast", "Euler"])
@pytest.mark.parametrize("chain", [[IDEAL], GEARED, REGRESSION], ids=["ideal", "geared", "regression"])
def test_a_controller_too_stiff_for_the_step_is_refused(chain: list, integrator: str) -> None:
    xml = PENDULUM.replace("RK4", integrator).replace("0.001", "0.002")
    step = 0.95 * longest(chain, xml)
    stable = drivetrain(chain, xml.replace("0.002", f"{step:g}")).model
    assert reached(stable) < 0.05
    stable.opt.timestep = 1.5 * step
    assert reached(stable) > 1.0


def test_stiffness_and_damping_count_together_where_the_engine_has_one_stage() -> None:
    semi = PENDULUM.replace("RK4", "implicitfast")
    step = longest([DAMPED], semi)
    parts = [{"ideal": {**DAMPED["ideal"], key: 0.0}} for key in ("stiffness", "damping")]
    for part in parts:
        drivetrain([part], semi)
    stable = drivetrain([DAMPED], semi.replace("0.001", f"{0.95 * step:g}")).model
    assert reached(stable) < 0.05
    drivetrain([DAMPED])  # Runge-Kutta, at the step that was refused


def test_native_damping_lets_a_stiff_light_joint_be() -> None:
    semi = PENDULUM.replace("RK4", "implicitfast")
    assert longest([IDEAL], semi) < 0.001
    driven = drivetrain([IDEAL, {"friction": {"viscous": 100.0}}], semi)
    assert reached(driven.model) < 0.05


def test_a_digital_controller_is_not_told_to_shorten_the_step() -> None:
    """It oscillates by its own period, which a shorter step does not change."""
    digital = [{"position_pi": {"gain": 1000.0, "integral": 0.0, "period": 0.005}}, *GEARED[1:]]
    run(drivetrain(digital), 0.01)


def test_the_assumed_step_of_a_file_is_short_enough_for_its_stiff_servos(tmp_path: Path) -> None:
    model = tmp_path / "arm.xml"
    steps = []
    for stiffness in (10, 20000, 100000):
        model.write_text(f"""<mujoco><worldbody><body><joint name="elbow" axis="0 1 0" range="-60 60"/>
            <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="0.3"/></body></worldbody>
            <actuator><position joint="elbow" kp="{stiffness}" kv="1"/></actuator></mujoco>""")
        robot = load_robot_file(model)
        steps.append(robot.timestep)
        assert reached(as_robot(robot).drivetrain().model) < 0.05
    assert all(later < earlier for earlier, later in pairwise(steps))


# --- loops that welds and connects close: closed before the first step, and tried on many episodes -------------------

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
