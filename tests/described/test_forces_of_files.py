"""Forces that stand in a robot's file beside its drives: limits of actuators, a fluid, powers of speed and position."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml
from sealegs.actuators import Chain
from sealegs.actuators.chain import load_chain
from sealegs.envs.described.robot_described import LIMIT, stated
from sealegs.envs.described.robot_file import load_robot_file
from sealegs.envs.new_robot.robot_yaml import robot_yaml
from sealegs.envs.robots import get_robot
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.diagnose import diagnose
from sealegs.gap.log.reader import read_measured
from sealegs.gap.log.types import MeasuredRun
from sealegs.gap.replay.engine import replay_whole, whole
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.tree import joint_of_tree, owned, terms_of
from sealegs.hw.virtual.machine import Machine

from testbed.logs import hidden_arm
from tests.logged_robots import free_replay, nominal_error, robot

ARM = """<mujoco>{option}<worldbody><body><joint name="s" axis="0 1 0" {joint}/>
<geom type="capsule" size="0.03" fromto="0 0 0 0.05 0 -0.3" mass="1"/><body pos="0.05 0 -0.3">
<joint name="e" axis="0 1 0" {joint}/><geom type="capsule" size="0.03" fromto="0 0 0 0 0 -0.3" mass="0.5"/></body>
</body></worldbody><actuator><position name="s" joint="s" kp="60" kv="3" {force}/>
<position name="e" joint="e" kp="30" kv="1" {force}/></actuator></mujoco>"""
IDEAL = {"s": {"stiffness": 60.0, "damping": 3.0}, "e": {"stiffness": 30.0, "damping": 1.0}}
STEP = 0.004  # [s]


def chains(more: dict[str, float] | None = None, *stages: Any) -> dict[str, list[Any]]:
    return {name: [{"ideal": values | (more or {})}, *stages] for name, values in IDEAL.items()}


def arm(folder: Path, joint: str = "", option: str = "", force: str = "") -> Path:
    path = folder / "arm.xml"
    path.write_text(ARM.format(joint=joint, option=option, force=force))
    return path


def moved(path: Path, actuators: dict[str, Any], *, limited: bool = True) -> tuple[MeasuredRun, float]:
    """A log of what the engine itself makes of the file, and how much of the time its joint ``s`` is at its limit."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.timestep, model.opt.integrator = 0.25 * STEP, mujoco.mjtIntegrator.mjINT_RK4
    model.jnt_actfrclimited[:] &= limited
    data, time = mujoco.MjData(model), STEP * np.arange(600)
    start = np.minimum(time / 0.5, 1.0) ** 3
    goals = np.stack([start * np.sin(2 * np.pi * 0.9 * time), 1.2 * start * np.sin(2 * np.pi * 0.7 * time + 1.0)])
    for _ in range(2000):  # it hangs at rest before it starts
        data.ctrl[:] = goals[:, 0]
        mujoco.mj_step(model, data)
    rows, full = [], []
    for now, goal in zip(time, goals.T, strict=True):
        data.ctrl[:] = goal
        rows.append([now, *goal, *data.qpos])
        mujoco.mj_step(model, data, 4)
        full.append(abs(data.qfrc_actuator[0]) > 0.999 * abs(model.jnt_actfrcrange[0, 1]))
    header = "time,s.goal,e.goal,s.position,e.position"
    np.savetxt(path.parent / "run.csv", rows, delimiter=",", header=header, comments="", fmt="%.12g")
    (path.parent / "run.yaml").write_text(yaml.safe_dump({"robot": path.name, "actuators": actuators}))
    return read_measured(path.parent).runs[0], float(np.mean(full))


def whole_errors(run: MeasuredRun) -> float:
    """Largest error of both joints when the whole robot is replayed, with what the file owns [rad]."""
    machine = robot(run)
    carried = {item.name: item.carried(load_chain(run.actuators[item.name])) for item in machine.file.joints}
    readings = replay_whole(whole(machine, carried), run)
    return max(float(np.abs(readings[name] - run.joints[name].position).max()) for name in IDEAL)


def free_errors(run: MeasuredRun) -> float:
    """Larger error of both joints, each replayed alone [rad]."""
    return max(nominal_error(free_replay(run, name)) for name in IDEAL)


def test_the_largest_force_that_a_file_gives_a_joint_acts_in_every_replay(tmp_path: Path) -> None:
    run, full = moved(arm(tmp_path, 'actuatorfrcrange="-3 3"'), chains())
    assert full > 0.1, "the limit is met"
    assert free_errors(run) < 2e-3 and whole_errors(run) < 1e-3
    finding = owned(robot(run), "s")
    assert finding is not None and finding.severity == "note" and "actuatorfrcrange is the file's" in finding.sentence


def test_a_limit_that_a_chain_states_counts_in_place_of_that_of_the_file(tmp_path: Path) -> None:
    actuators = chains({"torque_limit": 50.0})
    run, _ = moved(arm(tmp_path, 'actuatorfrcrange="-3 3"'), actuators, limited=False)
    assert free_errors(run) < 1e-3 and whole_errors(run) < 1e-3
    finding = owned(robot(run), "s", load_chain(actuators["s"]))
    assert finding is not None and "actuatorfrcrange is the chain's (50 in place of 3)" in finding.sentence


@pytest.mark.long
@pytest.mark.parametrize(
    ("source", "limit", "expected"),
    [
        ([{"ideal": IDEAL["s"]}], 1.5, 1.5),
        ([{"ideal": IDEAL["s"] | {"torque_limit": 9.0}}], 1.5, 9.0),
        ([{"ideal": IDEAL["s"] | {"torque_limit": 1.0}}], 1.5, 1.0),
        ("sts3215", 1.5, 1.5),
        ("sts3215", 40.0, 0.0),  # more than its motor has: its chain stays as it is
        ("xl330", 0.2, 0.2),
    ],
)  # fmt: skip
def test_replay_training_and_virtual_robot_have_the_same_limit(
    source: Any, limit: float, expected: float, tmp_path: Path
) -> None:
    path = arm(tmp_path, f'actuatorfrcrange="-{limit} {limit}"')
    run, _ = moved(path, {"s": source, "e": source})
    machine, one = robot(run), get_robot(path)
    model = joint_of_tree(machine, "s", load_chain(source), [run], terms_of(machine, "s", [run], changes=False))
    drivetrain = one.drivetrain(source)
    virtual = Machine(one, source)
    for chain in (model.chain, drivetrain.chains["s"], virtual.drivetrain.chains["s"]):
        assert limit_of(chain) == pytest.approx(expected)
    for engine in (machine.model, drivetrain.model, virtual.drivetrain.model):
        assert not engine.jnt_actfrclimited.any()
    if expected:
        data = mujoco.MjData(drivetrain.model)
        data.ctrl[:] = 1.5
        mujoco.mj_step(drivetrain.model, data)
        assert abs(data.qfrc_actuator[0]) <= expected * (1 + 1e-9)


def limit_of(chain: Chain) -> float:
    found = stated(chain, LIMIT)
    return 0.0 if found >= 1e5 else found  # the virtual robot's own, by which its torque is switched


def test_a_yaml_says_whose_limit_counts_and_a_smaller_one_of_an_actuator_stays(tmp_path: Path) -> None:
    path = arm(tmp_path, 'actuatorfrcrange="-3 3"', force='forcerange="-2 2"')
    bare = load_robot_file(path)
    assert [bare.joint("s").owners[LIMIT], stated(bare.joint("s").chain, LIMIT)] == ["file", 2.0]
    (tmp_path / "arm.yaml").write_text(robot_yaml(path, tmp_path / "arm.yaml")[0])
    assert "actuatorfrcrange: file   # chain or file; the file has 3 N.m" in (tmp_path / "arm.yaml").read_text()
    assert stated(load_robot_file(tmp_path / "arm.yaml").joint("s").chain, LIMIT) == 2.0
    for owner, expected in (("file", 3.0), ("chain", 50.0), (None, 50.0)):
        row = {"chain": [{"ideal": {"stiffness": 60.0, "torque_limit": 50.0}}]} | ({LIMIT: owner} if owner else {})
        (tmp_path / "arm.yaml").write_text(yaml.safe_dump({"model": "arm.xml", "joints": {"s": row}}))
        file = load_robot_file(tmp_path / "arm.yaml")
        assert stated(file.joint("s").chain, LIMIT) == expected
        told = [said for said in file.said if LIMIT in said]
        assert (
            told == [] if owner else "Warning: joint s: actuatorfrcrange is 3 in arm.xml and 50 in its chain" in told[0]
        )


@pytest.mark.parametrize(
    ("ends", "force", "why"),
    [("-50 5", 5.0, "smaller"), ("-5 50", 5.0, "smaller"), ("0 50", 50.0, "one way only"), ("-8 8", 8.0, "")],
)
def test_a_limit_that_differs_by_direction_is_read_with_care_and_told(
    ends: str, force: float, why: str, tmp_path: Path
) -> None:
    file = load_robot_file(arm(tmp_path, f'actuatorfrcrange="{ends}"'))
    assert file.model.joints["s"].force == force == stated(file.joint("s").chain, LIMIT)
    told = [said for said in file.said if said.startswith("Warning: joint s: its actuatorfrcrange")]
    assert len(told) == bool(why) and all(why in said for said in told)


@pytest.mark.parametrize("fluid", ['density="1000" viscosity="0.5"', 'density="1000" wind="0.5 0 0"'])
def test_a_fluid_brakes_a_joint_that_is_replayed_alone_as_it_does_the_whole_robot(fluid: str, tmp_path: Path) -> None:
    run, _ = moved(arm(tmp_path, option=f"<option {fluid}/>"), chains())
    assert free_errors(run) < 3e-4 and whole_errors(run) < 3e-4


def test_powers_of_the_position_in_a_spring_count_in_every_replay(tmp_path: Path) -> None:
    run, _ = moved(arm(tmp_path, 'stiffness="2 1 20"'), chains())
    assert free_errors(run) < 3e-4 and whole_errors(run) < 3e-4
    assert owned(robot(run), "s") is None


def test_powers_of_the_speed_in_a_damping_are_told_and_what_stands_for_them_in_a_chain(tmp_path: Path) -> None:
    path = arm(tmp_path, 'damping="0 0.5"')
    said = " ".join(load_robot_file(path).said)
    phrase = "of its damping 0 0.5 0 only the first number counts where it is driven; write friction: {drag: 0.5}"
    assert f"Warning: joint s: {phrase}" in said
    run, _ = moved(path, chains(None, {"friction": {"drag": 0.5}}))
    finding = owned(robot(run), "s")
    assert finding is not None and finding.severity == "warning" and phrase in finding.sentence
    assert free_errors(run) < 1e-3 and whole_errors(run) < 1e-3


def test_a_limit_that_is_believed_may_be_wrong_either_way() -> None:
    """A chain with a limit had no cause that changes it, and an effort of a URDF is often made up."""
    chain = load_chain([{"torque_command": {}}, {"torque_limit": {"limit": 2.0}}])
    joint = JointModel(chain)
    (cause,) = catalogue(replace(joint, axis=replace(joint.axis, effort=5.0)), ["drive.overload"])
    starts = [number.start for (number,) in cause.variants]
    assert cause.error and min(starts) < 2.0 < max(starts)
    assert all(number.low < 0.1 and number.high > 5.0 for (number,) in cause.variants)


@pytest.mark.long
def test_an_effort_that_a_file_makes_up_is_found(tmp_path: Path) -> None:
    data, _ = hidden_arm(tmp_path, "two_link", {}, seed=5, runs=2, duration=10.0)
    file = Path(data.runs[0].robot)
    made_up = 'actuatorfrclimited="true" actuatorfrcrange="-0.5 0.5"'
    file.write_text(file.read_text().replace('<joint name="elbow"', f'<joint {made_up} name="elbow"'))
    found = diagnose(data, causes=["drive.overload", "drive.gain", "friction.coulomb"]).joint("elbow")
    assert [cause.name for cause in found.causes] == ["drive.overload"]
    assert found.causes[0].parameters["torque_limit.limit"].value > 1.0


ONE_JOINT = """<mujoco><worldbody><body><joint name="j" axis="0 1 0" range="-60 60" {joint}/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/></body></worldbody>
<actuator>{actuators}</actuator></mujoco>"""


@pytest.mark.parametrize(
    ("actuators", "force"),
    [
        ('<motor joint="j" ctrlrange="-2 2" forcerange="-50 50"/>', 2.0),
        ('<motor joint="j" ctrlrange="-90 90" forcerange="-50 50" gear="2"/>', 100.0),
        ('<general joint="j" gainprm="3" ctrlrange="-2 2" forcerange="-50 50" gear="-1"/>', 6.0),
        ('<position joint="j" kp="20" kv="1" ctrlrange="-1 1" forcerange="-5 5"/>', 5.0),
        ('<motor joint="j" ctrlrange="0 4"/><motor joint="j" ctrlrange="0 4" gear="-1"/>', 4.0),
    ],
)
def test_a_motor_gives_no_more_than_its_controls_and_its_range_let_it(
    actuators: str, force: float, tmp_path: Path
) -> None:
    (tmp_path / "arm.xml").write_text(ONE_JOINT.format(joint="", actuators=actuators))
    robot = load_robot_file(tmp_path / "arm.xml")
    assert robot.joints[0].chain.value("ideal.torque_limit") == pytest.approx(force)
    assert not any("is read as" in sentence for sentence in robot.said)


@pytest.mark.parametrize(
    ("ends", "force", "why"),
    [
        ("-2 10", 2.0, "-2 to 10 N.m, is read as -2 to 2: the smaller end counts both ways."),
        ("0 10", 10.0, "0 to 10 N.m, is read as -10 to 10: a drive that acts one way only is not known here."),
    ],
)
def test_a_range_of_forces_is_read_alike_at_joints_and_actuators(
    ends: str, force: float, why: str, tmp_path: Path
) -> None:
    servo = '<position joint="j" kp="20" kv="1" {}/>'
    for name, joint, actuators in (
        ("joint", f'actuatorfrcrange="{ends}"', servo.format("")),
        ("actuator", "", servo.format(f'forcerange="{ends}"')),
        ("motor", "", f'<motor joint="j" ctrlrange="{ends}"/>'),
    ):
        path = tmp_path / f"{name}.xml"
        path.write_text(ONE_JOINT.format(joint=joint, actuators=actuators))
        robot = load_robot_file(path)
        assert robot.joints[0].chain.value("ideal.torque_limit") == pytest.approx(force), name
        assert any(why in sentence and sentence.startswith("Warning: ") for sentence in robot.said), name
