"""A whole robot: what was found at its joints becomes its own model, which moves in the engine as its log says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.actuators.chain import load_chain
from sealegs.envs.described.robot_described import as_robot, bare_model
from sealegs.envs.extended import Change, Extended, Mounted
from sealegs.gap.load.robot import Frame, LoggedRobot
from sealegs.gap.load.tree import Motion, terms_along
from sealegs.gap.log.types import MeasuredRun, MeasuredSet
from sealegs.gap.output.extension import of_robot
from sealegs.gap.output.robot_mjcf import write_robot
from sealegs.gap.replay.engine import replay_whole, whole, why_not_whole

from testbed.bench import NOISE_FLOOR
from tests.logged_robots import JOINTS, block_of, free_replay, nominal_error, robot, two_link_run


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> MeasuredRun:
    return two_link_run(tmp_path_factory.mktemp("arm"), 3.0)


def chains(run: MeasuredRun, machine: LoggedRobot) -> dict[str, Mounted]:
    return {
        joint: Mounted(machine.frame(joint).chain_to_model(load_chain(run.actuators[joint])), f"{joint}.yaml")
        for joint in JOINTS
    }


def errors(run: MeasuredRun) -> list[float]:
    machine = robot(run)
    readings = replay_whole(whole(machine, {j: item.chain for j, item in chains(run, machine).items()}), run)
    return [float(np.sqrt(np.mean((readings[j] - run.joints[j].position) ** 2))) for j in JOINTS]


def test_a_whole_robot_moves_in_the_engine_as_it_was_logged(recorded: MeasuredRun) -> None:
    assert why_not_whole(robot(recorded), [recorded]) is None
    assert max(errors(recorded)) < 2.0 * NOISE_FLOOR


def test_it_does_where_zeros_and_directions_of_the_log_are_others(recorded: MeasuredRun) -> None:
    elbow = recorded.joints["elbow"]
    assert elbow.goal is not None
    turned = replace(elbow, goal=0.7 - elbow.goal, position=0.7 - elbow.position, velocity=None)
    other = replace(recorded, joints={**recorded.joints, "elbow": turned})
    said = replace(other, meta={**recorded.meta, "frames": {"elbow": {"zero": 0.7, "direction": -1}}})
    assert max(errors(said)) < 2.0 * NOISE_FLOOR


def test_it_does_where_a_drive_turns_its_joint_through_a_ratio(recorded: MeasuredRun, tmp_path: Path) -> None:
    """The drive started at the joint's angle instead of its own, and the ratio was counted twice."""
    ratio, elbow = 2.0, recorded.joints["elbow"]
    assert elbow.goal is not None
    geared = replace(elbow, goal=ratio * elbow.goal, position=ratio * elbow.position, velocity=None)
    powers = {"gain": -1, "motor_constant": -1, "armature": -2, "coulomb": -1, "viscous": -2}
    chain = [
        {stage: {key: value * ratio ** powers.get(key, 0) for key, value in numbers.items()}}
        for item in recorded.actuators["elbow"]
        if isinstance(item, dict)
        for stage, numbers in item.items()
    ]  # the same joint, seen on the drive's side
    file = tmp_path / "arm.yaml"
    file.write_text(f"model: {recorded.robot}\njoints: {{shoulder: {{}}, elbow: {{belt: {{elbow: {ratio}}}}}}}\n")
    run = replace(
        recorded,
        robot=str(file),
        joints={**recorded.joints, "elbow": geared},
        actuators={**recorded.actuators, "elbow": chain},
    )
    later = {j: replace(log, **{key: v[200:] for key, v in log.signals().items()}) for j, log in run.joints.items()}
    shoulder, through = errors(replace(run, time=run.time[200:], joints=later))  # it starts away from zero
    assert max(shoulder, through / ratio) < 2.0 * NOISE_FLOOR


@pytest.mark.parametrize(
    ("plain", "passive"),
    [
        ('<joint name="elbow"', '<joint stiffness="0.6" springref="0.2" name="elbow"'),
        ('<body name="elbow_link"', '<body gravcomp="1" name="elbow_link"'),
    ],
)
def test_springs_and_weight_compensation_of_a_file_act_on_a_joint_as_in_the_engine(
    recorded: MeasuredRun, tmp_path: Path, plain: str, passive: str
) -> None:
    """The engine had them, the replay of a joint had not: a right file got causes with confidence."""
    file = tmp_path / "arm.xml"
    file.write_text(Path(recorded.robot).read_text().replace(plain, passive))
    run = replace(recorded, robot=str(file))
    machine = robot(run)
    readings = replay_whole(whole(machine, {j: item.chain for j, item in chains(run, machine).items()}), run)
    run = replace(run, joints={j: replace(log, position=readings[j]) for j, log in run.joints.items()})
    assert all(nominal_error(free_replay(run, joint)) < 2.0 * NOISE_FLOOR for joint in JOINTS)


def test_a_robot_with_a_joint_that_nothing_commands_is_not_simulated_as_a_whole(recorded: MeasuredRun) -> None:
    joints = {"shoulder": recorded.joints["shoulder"]}
    assert why_not_whole(robot(recorded), [replace(recorded, joints=joints)]) == "run0 has no command of 'elbow'"


def felt(run: MeasuredRun, changes: list[Change], joint: str) -> tuple[np.ndarray, np.ndarray]:
    """What a joint works against in the robot's own model, and in that with changes (samples, columns)."""
    machine = robot(run)
    found = Extended(run.robot, {}, {}, tuple(of_robot(machine, changes)))
    model = bare_model(machine.file, found.params_on(as_robot(machine.file)))
    motion = Motion(*np.random.default_rng(3).normal(0.0, 0.6, (3, 4, 2)))
    number = machine.number(joint)
    return terms_along(machine.model, number, motion), terms_along(model, number, motion)


def change(joint: str, path: str, value: float) -> Change:
    return Change(joint, path, 0.0, value, "load.mass", "robot")


@pytest.mark.parametrize(("path", "size", "block"), [("load.payload", 0.1, 1), ("load.centre_shift", 0.06, 2)])
def test_a_load_that_was_found_at_a_joint_is_the_same_load_in_the_robots_model(
    recorded: MeasuredRun, path: str, size: float, block: int
) -> None:
    """Of a shift by a third of the arm, a first derivative alone showed half as much again."""
    believed, found = felt(recorded, [change("shoulder", path, size)], "shoulder")
    wanted = block_of(believed, 0) + size * block_of(believed, block)
    if path == "load.centre_shift":
        wanted += size**2 * block_of(believed, 3)
    np.testing.assert_allclose(block_of(found, 0), wanted, atol=2e-4)


def test_a_payload_that_one_joint_names_and_another_tunes_is_hung_on_once(recorded: MeasuredRun) -> None:
    """The named 0.15 kg and 5 g that a fit had turned the other way were added."""
    changes = [change("shoulder", "load.payload", 0.15), replace(change("elbow", "load.payload", -0.005), cause="")]
    (payload,) = [item for item in of_robot(robot(recorded), changes) if item.path == "body.payload"]
    assert (payload.after, payload.cause) == (pytest.approx(0.15), changes[0].cause)


def test_masses_that_joints_agree_on_become_those_of_the_bodies(recorded: MeasuredRun) -> None:
    changes = [change(joint, "load.mass_factor", 1.3) for joint in JOINTS]
    for joint in JOINTS:
        believed, found = felt(recorded, changes, joint)
        np.testing.assert_allclose(block_of(found, 0), 1.3 * block_of(believed, 0), rtol=0.02, atol=1e-4)


def test_joints_that_disagree_a_little_take_no_body_away(recorded: MeasuredRun) -> None:
    """A boom of 0.15 kg became one of 7.5 g, because two joints had tuned their loads by a few percent each."""
    for factors in ((0.94, 1.08), (1.06, 0.94)):
        changes = [change(joint, "load.mass_factor", factor) for joint, factor in zip(JOINTS, factors, strict=True)]
        masses = [item.after for item in of_robot(robot(recorded), changes) if item.path == "body.mass_factor"]
        assert len(masses) == len(JOINTS) and all(0.8 < factor < 1.2 for factor in masses)


def test_factors_that_were_only_tuned_are_no_evidence_against_a_mass_that_is_named(recorded: MeasuredRun) -> None:
    """Beside a payload at the end, the link before it was handed over at 0.05 times its mass."""
    tuned = replace(change("shoulder", "load.mass_factor", 1.02), cause="")
    heavier = [tuned, change("elbow", "load.mass_factor", 1.65)]
    masses = {item.joint: item.after for item in of_robot(robot(recorded), heavier)}
    assert masses == {"elbow_link": pytest.approx(1.65, abs=0.01)}
    carried = Change("elbow_link", "body.payload", 0.0, 0.1, "load.mass", "robot")
    (payload,) = of_robot(robot(recorded), [tuned, carried])
    assert payload.path == "body.payload"
    kept = of_robot(robot(recorded), [replace(tuned, refitted=True), carried])
    assert {item.path for item in kept} == {"body.mass_factor", "body.payload"}, "refitted numbers are no nuisance"


def test_an_inertia_that_is_less_than_the_models_is_taken_from_the_body(recorded: MeasuredRun) -> None:
    believed, found = felt(recorded, [change("elbow", "load.extra_inertia", -1.5e-4)], "elbow")
    np.testing.assert_allclose(found[:, 2], believed[:, 2] - 1.5e-4, atol=1e-7)
    np.testing.assert_allclose(found[:, 4], believed[:, 4], atol=1e-4)


def test_stops_and_offsets_change_sides_with_the_direction_of_the_log(recorded: MeasuredRun) -> None:
    machine = replace(robot(recorded), frames={"elbow": Frame(0.5, -1.0)})
    (stop,) = of_robot(machine, [change("elbow", "load.stop_angle", 0.9)])
    assert (stop.path, stop.after) == ("load.lower_stop", pytest.approx(-0.4))
    chain = load_chain("sts3215").with_value("encoder.offset", 0.1)
    assert Frame(0.5, -1.0).chain_to_model(chain).find("encoder").offset == pytest.approx(-0.1)


def test_the_robots_own_model_file_is_written_with_what_plain_mujoco_can_simulate(
    recorded: MeasuredRun, tmp_path: Path
) -> None:
    machine = robot(recorded)
    mounted = chains(recorded, machine)
    heavier = {j: (replace(m, chain=m.chain.with_value("friction.coulomb", 0.1)),) for j, m in mounted.items()}
    changes = tuple(of_robot(machine, [change("elbow", "load.payload", 0.05)]))
    path = write_robot(Extended(recorded.robot, {}, heavier, changes), MeasuredSet((recorded,), "log"), tmp_path)
    assert path is not None
    model = mujoco.MjModel.from_xml_path(str(path))
    assert list(model.dof_frictionloss) == pytest.approx([0.1, 0.1]) and model.nu == 2
    assert model.body("elbow_link").mass[0] == pytest.approx(0.18 + 0.05)
    data = mujoco.MjData(model)
    data.ctrl[:] = 0.3, -0.2
    mujoco.mj_step(model, data, 1000)
    np.testing.assert_allclose(data.qpos, [0.3, -0.2], atol=0.05)


def test_joints_that_rest_in_their_friction_stay_there_whatever_the_noise_of_their_first_samples(
    recorded: MeasuredRun,
) -> None:
    """Thrown off at a derivative of noise, a joint slipped to where its friction held it again, and stayed off."""
    rng, rows, noise = np.random.default_rng(1), 200, 1e-3
    still = {
        joint: replace(
            recorded.joints[joint],
            goal=np.full(rows, 0.4),
            position=0.4 + noise * rng.normal(size=rows),
            **dict.fromkeys(("velocity", "current", "torque", "duty", "voltage", "temperature")),
        )
        for joint in JOINTS
    }
    run = replace(recorded, time=recorded.time[:rows], joints=still)
    readings, machine = {}, robot(run)
    for name, positions in (("noisy", None), ("exact", np.full(rows, 0.4))):
        joints = {j: log if positions is None else replace(log, position=positions) for j, log in still.items()}
        which = {j: item.chain for j, item in chains(run, machine).items()}
        readings[name] = replay_whole(whole(machine, which), replace(run, joints=joints))
    for joint in JOINTS:
        assert np.abs(readings["noisy"][joint] - readings["exact"][joint])[-1] < 0.5 * noise
