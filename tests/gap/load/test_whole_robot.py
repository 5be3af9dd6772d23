"""A whole robot: what was found at its joints becomes its own model, which moves in the engine as its log says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.actuators.chain import load_chain
from sealegs.envs.described.as_robot import as_robot, bare_model
from sealegs.envs.engine.model_poses import followers_of
from sealegs.envs.extended import Change, Extended, Mounted
from sealegs.gap.diagnose import diagnose
from sealegs.gap.load import dynamics
from sealegs.gap.load.dynamics import Dynamics
from sealegs.gap.load.robot import Frame, LoggedRobot, moved_by
from sealegs.gap.load.tree import Motion, block_along, carries, terms_along, tip_behind
from sealegs.gap.log.types import MeasuredRun, MeasuredSet
from sealegs.gap.measure.named import NamedCause, Value
from sealegs.gap.output.carried import point_felt, weight_felt
from sealegs.gap.output.extension import of_robot
from sealegs.gap.output.robot_mjcf import write_robot
from sealegs.gap.replay.engine import replay_whole, whole, why_not_whole
from sealegs.gap.replay.tree import not_free, torques_of
from sealegs.gap.robot.directions import payload

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


def named(joint: str, path: str, value: float, half: float, confidence: float) -> tuple[Change, NamedCause]:
    """A load that is named at a joint, with half of its interval."""
    size = Value(value, value - half, value + half, "", 0.0)
    cause = NamedCause("load.mass", "", joint, 1.0, confidence, {path: size}, 1.0, "number")
    return change(joint, path, value), cause


@pytest.mark.parametrize("payload", [0.03, 0.1, 0.3])
def test_a_body_that_two_joints_name_in_two_ways_is_made_heavier_once(recorded: MeasuredRun, payload: float) -> None:
    """A payload at one joint and a heavier link at the next were both handed over: 15 mrad off where 10 were before."""
    machine = robot(recorded)
    elbow = machine.number("elbow")
    tip = tip_behind(machine.model, elbow)
    as_factor = (
        1.0 + payload * point_felt(machine.model, elbow, tip.body, tip.point) / weight_felt(machine.model, elbow).sum()
    )

    def handed(*findings: tuple[Change, NamedCause]) -> dict[str, float]:
        told = {(one.joint, one.path): cause for one, cause in findings}
        return {item.path: item.after for item in of_robot(machine, [one for one, _ in findings], told)}

    at_shoulder = named("shoulder", "load.payload", payload, 0.05 * payload, 0.98)
    vague = named("elbow", "load.mass_factor", 1.0 + 0.8 * (as_factor - 1.0), 0.4 * (as_factor - 1.0), 0.5)
    assert handed(at_shoulder, vague) == {"body.payload": pytest.approx(payload, rel=0.05)}
    other = named("elbow", "load.mass_factor", 2.0 * as_factor, 0.02 * as_factor, 0.95)
    assert set(handed(at_shoulder, other)) == {"body.payload", "body.mass_factor"}, "no payload is both"
    surer = named("elbow", "load.mass_factor", as_factor, 0.2 * (as_factor - 1.0), 0.99)
    lighter = named("shoulder", "load.payload", payload, 1.5 * payload, 0.4)
    assert set(handed(lighter, surer)) == {"body.mass_factor"}, "what is named surest stays"


@pytest.mark.parametrize("joint", JOINTS)
def test_a_number_without_a_cause_takes_no_place_of_a_named_one(recorded: MeasuredRun, joint: str) -> None:
    """A refitted factor of 1.02 stood for a payload of 0.1 kg, as both links 1.35 times as heavy."""
    machine, (payload, cause) = robot(recorded), named("elbow", "load.payload", 0.1, 0.005, 0.98)
    refitted = replace(change(joint, "load.mass_factor", 1.02), cause="", refitted=True)
    found = of_robot(machine, [refitted, payload], {("elbow", payload.path): cause})
    (hung,) = (item for item in found if item.path == "body.payload")
    assert hung.after == pytest.approx(0.1) and hung.cause == "load.mass"
    factors = [item.after for item in found if item.path == "body.mass_factor"]
    assert all(0.95 < factor < 1.05 for factor in factors)


def test_what_one_joint_found_of_both_kinds_stays_as_it_found_it(recorded: MeasuredRun) -> None:
    lighter, payload = change("elbow", "load.mass_factor", 0.9), change("elbow", "load.payload", 0.1)
    for cause in ("load.mass", ""):
        found = of_robot(robot(recorded), [replace(one, cause=cause) for one in (lighter, payload)])
        assert {item.path: item.after for item in found} == {
            "body.mass_factor": pytest.approx(0.9, abs=1e-3),
            "body.payload": pytest.approx(0.1),
        }


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


# --- what joints work against along a motion, and joints that an equality ties: judged as one, with the mass of both.

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
