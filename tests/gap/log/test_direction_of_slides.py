"""Slides of a robot's log that count the other way round: told by weight and coupling, and turned."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.gap.load.robot import Frame, Machine
from sealegs.gap.log.finding import Finding
from sealegs.gap.log.types import JointLog, MeasuredRun
from sealegs.gap.prepare.frames import in_likely_frames

from tests.logged_robots import robot
from tests.quick import quick

STIFFNESS, DAMPING, FRICTION, VISCOUS = 3000.0, 80.0, 1.0, 5.0
LIFTED, GRAVITY = 2.0, 9.81  # [kg] behind the vertical slide of the gantry, [m/s2]
SAGS = LIFTED * GRAVITY / STIFFNESS  # [m] that its drive is off its goal
TURN = 0.15  # [rad or m] of motions

GANTRY = """<mujoco model="gantry"><compiler angle="radian" autolimits="true"/><worldbody>
<body name="bridge"><joint name="x" type="slide" axis="1 0 0" range="-0.5 0.5"/>
<inertial pos="0 0 0" mass="4" diaginertia="1 1 1"/>
<body name="lift"><joint name="z" type="slide" axis="0 0 1" range="{low} {high}"/>
<inertial pos="0 0 0" mass="{mass}" diaginertia="1 1 1"/></body></body></worldbody></mujoco>"""
POLAR = """<mujoco model="polar"><compiler angle="radian" autolimits="true"/><worldbody>
<body name="boom"><joint name="pitch" axis="0 -1 0" range="-1.5 1.5"/>
<inertial pos="0.1 0 0" mass="1" diaginertia=".01 .01 .01"/>
<body name="beam"><joint name="reach" type="slide" axis="1 0 0" range="0.2 0.8"/>
<inertial pos="0 0 0" mass="2" diaginertia=".01 .01 .01"/></body></body></worldbody></mujoco>"""
CART = """<mujoco model="cart"><compiler angle="radian" autolimits="true"/><worldbody>
<body name="cart"><joint name="x" type="slide" axis="1 0 0" range="-0.5 0.5"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<body name="pole"><joint name="pole" axis="0 1 0"/><inertial pos="0 0 -0.3" mass="3" diaginertia=".01 .01 .01"/></body>
</body></worldbody></mujoco>"""


def gantry(mass: float = LIFTED, low: float = -0.3, high: float = 0.3) -> str:
    return GANTRY.format(mass=mass, low=low, high=high)


def recorded(
    folder: Path, model: str, middles: Mapping[str, float], passive: str = "", believed: str = ""
) -> MeasuredRun:
    """Joints that swing about these places, by the goals that the motion needs of their drives.

    Args:
        folder: for the file of the model.
        model: of what was recorded.
        middles: by joint.
        passive: joint that nothing drives.
        believed: model that the log names; default: the same.
    """
    machine = mujoco.MjModel.from_xml_string(model)
    data, time = mujoco.MjData(machine), np.arange(0.0, 8.0, 0.005)
    rows = np.empty((4, len(time), machine.nv))
    for j, middle in enumerate(middles.values()):
        phases = [(0.4 + 0.13 * j, 0.3 * j, 0.7), (1.1 + 0.17 * j, 1.0 + j, 0.3)]
        for k in range(3):
            waves = [part * (2.0 * np.pi * f) ** k * np.sin(2.0 * np.pi * f * time + phase + 0.5 * np.pi * k)
                     for f, phase, part in phases]  # fmt: skip
            rows[k, :, j] = TURN * np.sum(waves, axis=0) + (middle if k == 0 else 0.0)
    for k in range(len(time)):
        data.qpos[:], data.qvel[:], data.qacc[:] = rows[:3, k]
        mujoco.mj_inverse(machine, data)
        rows[3, k] = data.qfrc_inverse
    noise, joints = np.random.default_rng(4).normal(0.0, 1e-5, rows[0].shape), {}
    for j, name in enumerate(middles):
        place, speed = rows[0, :, j], rows[1, :, j]
        drive = rows[3, :, j] + FRICTION * np.tanh(speed / 1e-3) + (VISCOUS + DAMPING) * speed
        goal = None if name == passive else place + drive / STIFFNESS
        joints[name] = JointLog(goal=goal, position=place + noise[:, j])
    path = folder / "robot.xml"
    path.write_text(believed or model, encoding="utf-8")
    chain: list = [
        {"ideal": {"stiffness": STIFFNESS, "damping": DAMPING, "torque_limit": 1e4, "armature": 0.0}},
        {"friction": {"coulomb": FRICTION, "viscous": VISCOUS}},
    ]
    driven: dict[str, str | list] = {name: chain for name in middles if name != passive}
    return MeasuredRun("run", time, joints, robot=str(path), actuators=driven, meta={"group": "run"})


def as_host(run: MeasuredRun, joint: str, counts: Callable[[np.ndarray], np.ndarray]) -> MeasuredRun:
    """The run as a host logs it whose places of a joint count otherwise."""
    log = run.joints[joint]
    goal = None if log.goal is None else counts(log.goal)
    return replace(run, joints={**run.joints, joint: JointLog(goal=goal, position=counts(log.position))})


def judged(run: MeasuredRun) -> tuple[dict[str, Frame], dict[str, Finding]]:
    """The frames in which a diagnosis takes a run, where they are not the model's, and what it says."""
    runs, findings = in_likely_frames(Machine.of([run]), lambda text: None)
    frames = {name: frame for name, frame in robot(runs[0]).frames.items() if frame != Frame()}
    assert len({finding.code for finding in findings}) == len(findings)
    return frames, {finding.code: finding for finding in findings}


def off(run: MeasuredRun, way: float) -> MeasuredRun:
    """The run with a position of z that has another zero than its goal [m]."""
    log = run.joints["z"]
    return replace(run, joints={**run.joints, "z": replace(log, position=log.position + way)})


MIDDLES = {"x": 0.0, "z": 0.05}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> MeasuredRun:
    return recorded(tmp_path_factory.mktemp("gantry"), gantry(), MIDDLES)


def test_a_vertical_slide_that_counts_the_other_way_is_turned_and_told_in_millimetres(run: MeasuredRun) -> None:
    """Nothing was said of it, and the gap was a zero that is off by twice what the drive sags."""
    frames, said = judged(as_host(run, "z", np.negative))
    assert frames == {"z": Frame(0.0, -1.0)}
    sentence = said["robot.frame"].sentence
    assert "are taken here" in sentence and f"{2e3 * SAGS:.3g} mm rms" in sentence and "rad" not in sentence
    assert "constant force of about twice the weight" in sentence, "of the size that is told it looks the same"


def test_a_right_slide_is_left_alone_and_a_level_one_is_listed_as_not_told(run: MeasuredRun) -> None:
    frames, said = judged(run)
    assert frames == {} and list(said) == ["robot.frame_unknown"]
    assert "the direction of x:" in said["robot.frame_unknown"].sentence


def test_the_direction_of_a_level_slide_that_nothing_tells_is_believed(run: MeasuredRun) -> None:
    frames, said = judged(as_host(run, "x", np.negative))
    assert frames == {} and list(said) == ["robot.frame_unknown"]


@pytest.mark.parametrize("mass", quick([0.5, 1.5, 4.0], 2))
def test_a_wrong_mass_is_no_other_direction(tmp_path: Path, mass: float) -> None:
    frames, said = judged(recorded(tmp_path, gantry(), MIDDLES, believed=gantry(mass)))
    assert frames == {} and "robot.frame" not in said


@pytest.mark.parametrize("sags", quick([0.5, -0.5, 4.0, -4.0], 2))
def test_a_zero_that_goal_and_position_do_not_share_is_no_other_direction(run: MeasuredRun, sags: float) -> None:
    frames, said = judged(off(run, sags * SAGS))
    assert frames == {} and "robot.frame" not in said


@pytest.mark.parametrize("way", quick([1.0, -1.0], 2))
def test_a_zero_of_both_is_no_other_direction(run: MeasuredRun, way: float) -> None:
    frames, _ = judged(as_host(run, "z", lambda places: places + 0.1 * way))
    assert frames == {}


def test_a_slide_is_only_doubted_where_a_constant_force_is_as_likely(tmp_path: Path) -> None:
    """Turned around, its load would be 1.6 times the model's: another zero or force may be it."""
    turned = as_host(recorded(tmp_path, gantry(), MIDDLES, believed=gantry(LIFTED / 1.6)), "z", np.negative)
    frames, said = judged(turned)
    assert frames == {}
    assert "constant force" in said["robot.frame"].sentence and "z: {zero: 0" in said["robot.frame"].sentence


def test_a_slide_that_counts_from_the_other_end_of_its_range_is_turned_with_it(tmp_path: Path) -> None:
    run = recorded(tmp_path, gantry(low=-0.02, high=0.4), {"x": 0.0, "z": 0.2})
    frames, _ = judged(as_host(run, "z", lambda places: 0.38 - places))
    assert list(frames) == ["z"] and frames["z"].sign == -1.0 and frames["z"].zero == pytest.approx(0.38)


@pytest.mark.parametrize("mass", [LIFTED, LIFTED / 3.0])
def test_the_range_tells_what_the_weight_alone_leaves_open(tmp_path: Path, mass: float) -> None:
    believed = gantry(mass, low=-0.02, high=0.4)
    run = recorded(tmp_path, gantry(low=-0.02, high=0.4), {"x": 0.0, "z": 0.2}, believed=believed)
    frames, said = judged(as_host(run, "z", np.negative))
    assert frames == {"z": Frame(0.0, -1.0)} and "constant" not in said["robot.frame"].sentence


def test_a_direction_that_a_sidecar_gives_is_doubted_and_kept(run: MeasuredRun) -> None:
    given = {"z": {"zero": 0.0, "direction": -1}}
    frames, said = judged(replace(run, meta={**run.meta, "frames": given}))
    assert frames == {"z": Frame(0.0, -1.0)} and "are taken" not in said["robot.frame"].sentence


def test_a_slide_that_a_force_drives_is_doubted_and_not_turned(run: MeasuredRun) -> None:
    log = run.joints["z"]
    assert log.goal is not None
    speed = np.gradient(log.position, run.time)
    force = STIFFNESS * (log.goal - log.position) - DAMPING * speed
    turned = JointLog(goal=None, position=-log.position, torque_command=-force)
    chain = [{"torque_command": {}}, {"friction": {"coulomb": FRICTION, "viscous": VISCOUS}}]
    driven = replace(run, joints={**run.joints, "z": turned}, actuators={**run.actuators, "z": chain})
    frames, said = judged(driven)
    assert frames == {} and "z: {zero: 0, direction: -1}" in said["robot.frame"].sentence


@pytest.mark.long
@pytest.mark.parametrize("joint", ["", "reach", "pitch"])
def test_of_a_slide_on_a_hinge_the_joint_is_turned_that_counts_the_other_way(tmp_path: Path, joint: str) -> None:
    """An arm and its mirror image need the same torques; the range of the slide tells them apart."""
    run = recorded(tmp_path, POLAR, {"pitch": 0.4, "reach": 0.5})
    frames, _ = judged(as_host(run, joint, np.negative) if joint else run)
    assert {name: frame.sign for name, frame in frames.items()} == ({joint: -1.0} if joint else {})


def test_a_cart_is_turned_by_its_coupling_and_the_pole_is_named_that_may_be_turned_instead(tmp_path: Path) -> None:
    run = recorded(tmp_path, CART, {"x": 0.0, "pole": 0.3}, passive="pole")
    assert judged(run)[0] == {}
    frames, said = judged(as_host(run, "x", np.negative))
    assert frames == {"x": Frame(0.0, -1.0)}
    assert "pole turned around instead" in said["robot.frame"].sentence and "robot.frame_unknown" not in said


def test_a_hinge_that_is_only_doubted_turns_no_slide_instead(tmp_path: Path) -> None:
    """Of a pole that a torque drives no direction is taken; its cart was turned in its place, and both were named."""
    run = recorded(tmp_path, CART, {"x": 0.0, "pole": 0.3})
    pole = run.joints["pole"]
    assert pole.goal is not None
    torque = STIFFNESS * (pole.goal - pole.position) - DAMPING * np.gradient(pole.position, run.time)
    chain: list = [{"torque_command": {}}, {"friction": {"coulomb": FRICTION, "viscous": VISCOUS}}]
    turned = JointLog(goal=None, position=-pole.position, torque_command=-torque)
    driven = replace(run, joints={**run.joints, "pole": turned}, actuators={**run.actuators, "pole": chain})
    frames, said = judged(driven)
    assert frames == {} and "pole: {zero: 0, direction: -1}" in said["robot.frame"].sentence
