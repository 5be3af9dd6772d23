"""A joint whose link moves as measured: only its actuator is judged, whatever holds the link."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sealegs.actuators.chain import load_chain
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.causes.visible import limits, shown
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.parts import cut
from sealegs.gap.log.types import JointLog, LogError, MeasuredRun, MeasuredSet
from sealegs.gap.replay.constants import K
from sealegs.gap.replay.driven import DrivenProblem, driven_problem
from sealegs.gap.replay.driven_simulator import replay_driven
from sealegs.gap.replay.joint_model import IMMOVABLE, Axis, JointModel
from sealegs.gap.verdict.verdict import NOT_IDENTIFIABLE

from testbed import hidden_hopper
from testbed.hopper import JOINTS, Servo, nominal_hopper_chain
from tests.small_diagnosis import small_hopper

SPRING = [
    {"position_p": {"gain": 30.0}},
    {"duty_limit": {"limit": 0.9}},
    {"supply": {"volts": 7.4, "resistance": 0.0}},
    {"dc_motor": {"motor_constant": 0.664, "resistance": 2.723, "armature": 0.010}},
    {"friction": {"coulomb": 0.0, "viscous": 0.35}},
    {"spring": {"stiffness": 2.0, "damping": 0.0}},
    {"encoder": {"ticks": 0}},
]
RIGID = [stage for stage in SPRING if "spring" not in stage]


def drive(chain: list, goal: np.ndarray, link: np.ndarray, time: np.ndarray, step: float = 5e-4) -> np.ndarray:
    """Channels (n, 4) of a joint whose link stands or moves as given (n, 3)."""
    joint = JointModel(load_chain(chain))
    program = joint.chain.program()
    out = np.empty((len(time), 4))
    constants = joint.constants({}, program)
    on, warm = np.ones(len(time), bool), np.full(len(time), 25.0)
    told = np.full(len(time), np.nan)
    replay_driven(program, constants, time, goal, on, warm, link, told, link[0, 0], link[0, 1], step, out)
    return out


def test_a_motor_settles_where_its_torque_holds_the_spring_against_a_held_link() -> None:
    time = np.arange(0.0, 2.0, 0.005)
    out = drive(SPRING, np.full(len(time), 0.3), np.zeros((len(time), 3)), time)
    position, torque, duty, current = out[-1]
    assert torque == pytest.approx(2.0 * position, rel=1e-3)
    assert torque == pytest.approx(0.664 * current, rel=1e-3)
    assert duty == pytest.approx(30.0 * (0.3 - position), rel=1e-6)


def test_a_rigid_joint_asks_for_the_duty_that_its_measured_position_asks_for() -> None:
    time = np.arange(0.0, 2.0, 0.005)
    angle, speed = 0.2 * np.sin(5.0 * time), np.cos(5.0 * time)
    link = np.stack([angle, speed, -5.0 * np.sin(5.0 * time)], axis=1)
    out = drive(RIGID, angle + 0.01, link, time)
    np.testing.assert_allclose(out[:, 0], angle)
    np.testing.assert_allclose(out[5:, 2], 0.3, atol=1e-9)
    current = (0.3 * 7.4 - 0.664 * speed) / 2.723
    np.testing.assert_allclose(out[5:, 3], current[5:], atol=1e-9)
    np.testing.assert_allclose(out[5:, 1], (0.664 * current - 0.35 * speed - 0.010 * link[:, 2])[5:], atol=1e-9)


def test_friction_of_a_rigid_joint_grows_with_the_load_that_its_link_is() -> None:
    """It saw the motor's torque without the link's, half of what passes the gears: it was fitted twice as large."""
    time = np.arange(0.0, 2.0, 0.005)
    link = np.stack([0.5 * time, np.full(len(time), 0.5), np.zeros(len(time))], axis=1)
    loaded = [
        {**stage, "friction": {**stage["friction"], "load": 0.1}} if "friction" in stage else stage for stage in RIGID
    ]
    goal = link[:, 0] + 0.02
    left, passed = drive(RIGID, goal, link, time)[5:, 1], drive(loaded, goal, link, time)[5:, 1]
    motor = left + 0.35 * 0.5  # viscous friction takes its share behind the gears
    assert motor.min() > 0.5
    np.testing.assert_allclose(passed, left - 0.1 * (motor + passed), rtol=2e-3)


def test_a_rigid_joint_whose_position_is_read_late_asks_for_the_duty_of_where_it_is() -> None:
    time = np.arange(0.0, 2.0, 0.005)

    def motion(late: float) -> np.ndarray:
        at = 5.0 * (time - late)
        return np.stack([0.2 * np.sin(at), np.cos(at), -5.0 * np.sin(at)], axis=1)

    goal = np.full(len(time), 0.05)
    true, late = drive(RIGID, goal, motion(0.0), time), [*RIGID[:-1], {"encoder": {"ticks": 0, "latency": 0.012}}]
    read = drive(late, goal, motion(0.012), time)
    inside = slice(10, -5)
    np.testing.assert_allclose(read[inside, 1:], true[inside, 1:], atol=2e-3)
    np.testing.assert_allclose(read[inside, 0], motion(0.012)[inside, 0], atol=1e-3)


def geared(side: str, friction: float = 1.0) -> tuple[MeasuredRun, list]:
    """A gear motor that follows a measured motion, whose torque is logged behind the gear or as the drive's estimate;
    by the equations, not by the replay. Its friction is a factor of what its chain says.
    """
    time = np.arange(0.0, 8.0, 0.01)
    rates, sizes = np.array([3.0, 7.3, 12.1]), np.array([0.5, 0.2, 0.05])
    angle = (sizes * np.sin(rates * time[:, None])).sum(1)
    speed = (sizes * rates * np.cos(rates * time[:, None])).sum(1)
    turning = -(sizes * rates**2 * np.sin(rates * time[:, None])).sum(1)
    rng = np.random.default_rng(3)
    lag = 0.02 * np.sin(2.0 * time) + 0.005
    given = 0.664 * (30.0 * lag * 7.4 - 0.664 * speed) / 2.723
    lost = 0.05 * turning + friction * (0.35 * speed + 0.1 * np.sign(speed))
    torque = given if side == "drive" else given - lost
    log = JointLog(angle + lag, angle + rng.normal(0.0, 1e-4, len(time)), torque=torque)
    chain = [dict(stage) for stage in RIGID]
    chain[3] = {"dc_motor": {"motor_constant": 0.664, "resistance": 2.723, "armature": 0.05}}
    chain[4] = {"friction": {"coulomb": 0.1, "viscous": 0.35}}
    return MeasuredRun("a", time, {"servo": log}, robot="arm", actuators={"servo": chain}), chain


@pytest.mark.parametrize("side", ["shaft", "drive"])
def test_a_torque_is_replayed_on_the_side_of_the_gear_on_which_it_was_logged(side: str) -> None:
    """A drive's estimate was compared with the torque of the shaft: armature and friction were a gap."""
    run, chain = geared(side)
    problem = driven_problem([run], "servo", [JointModel(load_chain(chain))], cut([run], "servo"), 1e-4)
    assert problem.torque_side == side and problem.signal == ("torque", "N.m")
    error = np.abs(problem.position_error(problem.simulate([{}])[0]))
    assert np.median(error) < 0.03, "of a torque of 1 N.m; the lag is read with noise"
    _, hidden = shown(problem, problem.models[0], catalogue(problem.models[0]))
    assert ("friction.coulomb" in hidden) == (side == "drive"), "what the drive gives does not pass through friction"
    assert "as its own shape shows" in limits(problem, "servo", ())[1].sentence
    said = driven_problem([replace(run, meta={"torque": "drive"})], "servo", problem.models, problem.units, 1e-4)
    assert said.torque_side == "drive" and "as the sidecar says" in limits(said, "servo", ())[1].sentence


@pytest.mark.parametrize("side", ["shaft", "drive"])
@pytest.mark.parametrize("friction", [0.3, 0.5, 2.0])
def test_a_torque_is_of_its_side_though_the_friction_is_not_as_believed(side: str, friction: float) -> None:
    """With a third of the friction, what was measured behind the gear was taken for the drive's estimate."""
    run, chain = geared(side, friction)
    problem = driven_problem([run], "servo", [JointModel(load_chain(chain))], cut([run], "servo"), 1e-4)
    assert (problem.torque_side, problem.side_reason) == (side, "shown")


def test_what_a_sidecar_says_of_a_torque_that_was_not_logged_is_no_side() -> None:
    """A robot without that column was refused for the maker's number in its ``meta``."""
    run, chain = geared("drive")
    log = replace(run.joints["servo"], torque=None, current=np.zeros(len(run.time)))
    bare = replace(run, joints={"servo": log}, meta={"torque": "2.9 N.m at stall"})
    models = [JointModel(load_chain(chain))]
    assert driven_problem([bare], "servo", models, cut([bare], "servo"), 1e-4).torque_side == "shaft"
    with pytest.raises(LogError, match=r"not '2\.9 N\.m at stall'"):
        driven_problem([replace(run, meta=bare.meta)], "servo", models, cut([run], "servo"), 1e-4)


def test_a_torque_whose_side_nothing_tells_is_assumed_to_be_the_shafts() -> None:
    """The note claimed that it "fits better"."""
    run, chain = geared("drive")
    chain[3] = {"dc_motor": {"motor_constant": 0.664, "resistance": 2.723, "armature": 0.0}}
    chain[4] = {"friction": {"coulomb": 0.0, "viscous": 0.0}}
    problem = driven_problem([run], "servo", [JointModel(load_chain(chain))], cut([run], "servo"), 1e-4)
    assert problem.torque_side == "shaft" and "cannot tell" in limits(problem, "servo", ())[1].sentence


def test_the_force_of_a_slide_is_told_as_a_force() -> None:
    """It was told in mN.m."""
    run, chain = geared("shaft")
    slide = JointModel(load_chain(chain), axis=Axis(slide=True, low=-0.2, high=0.2))
    problem = driven_problem([run], "servo", [slide], cut([run], "servo"), 1e-4)
    assert problem.signal == ("torque", "N")


def test_halving_the_step_changes_little() -> None:
    time = np.arange(0.0, 3.0, 0.005)
    goal = np.where(time % 0.5 < 0.25, 0.3, -0.3)
    link = np.stack([0.2 * np.sin(20.0 * time), 4.0 * np.cos(20.0 * time), 0.0 * time], axis=1)
    coarse, fine, exact = (drive(SPRING, goal, link, time, step)[:, 0] for step in (1e-3, 5e-4, 2e-5))
    assert np.sqrt(np.mean((coarse - exact) ** 2)) < 1e-4
    assert np.sqrt(np.mean((fine - exact) ** 2)) < 0.5 * np.sqrt(np.mean((coarse - exact) ** 2))


def test_no_torque_moves_a_driven_link() -> None:
    joint = JointModel(load_chain(SPRING))
    assert joint.constants({}, joint.chain.program())[K.inertia] == IMMOVABLE


def problem_of(data: MeasuredSet, joint: str) -> DrivenProblem:
    models = [JointModel(load_chain(run.actuators[joint])) for run in data.runs]
    return driven_problem(data.runs, joint, models, cut(data.runs, joint), 6e-4)


@pytest.mark.long
@pytest.mark.parametrize("joint", JOINTS)
def test_the_true_servo_follows_the_log_of_a_hopping_leg_to_its_noise(joint: str) -> None:
    data, truth = hidden_hopper({"contact.friction": "clear", "contact.slope": "clear"}, seed=11, duration=8.0)
    factors, servo = truth["nominal_factors"][joint], Servo()
    problem = problem_of(data, joint)
    nominal = {
        "delay.seconds": servo.delay * factors["delay"],
        "dc_motor.motor_constant": servo.motor_constant * factors["motor_constant"],
        "dc_motor.resistance": servo.resistance * factors["resistance"],
        "dc_motor.armature": servo.armature * factors["armature"],
        "friction.coulomb": servo.coulomb * factors["coulomb"],
        "friction.viscous": servo.viscous * factors["viscous"],
    }
    error = problem.position_error(problem.simulate([nominal])[0])
    assert np.sqrt(np.mean(error**2)) < 1.2 * truth["noise_floor"]


@pytest.mark.long
def test_what_the_link_hides_is_not_sought_and_is_said() -> None:
    data, _ = hidden_hopper({}, seed=11, duration=8.0, runs=2)
    problem = problem_of(data, "knee")
    kept, hidden = shown(problem, problem.models[0], catalogue(problem.models[0]))
    names = {cause.name for cause in kept}
    assert {"spring.stiffness", "transmission.backlash", "friction.coulomb", "drive.delay"} <= names
    assert {"load.mass", "load.inertia", "contact.blocked"} <= set(hidden)
    assert "load.mass" in limits(problem, "knee", hidden)[0].sentence


@pytest.mark.long
def test_play_in_the_belt_of_a_hopping_leg_is_named() -> None:
    (hip, knee, _), _ = small_hopper()
    assert [cause.name for cause in knee.causes] == ["transmission.backlash"], knee.sentence
    width = knee.causes[0].parameters["backlash.width"]
    assert width.low <= 0.12 <= width.high
    assert width.value == pytest.approx(0.12, abs=0.01)
    assert not hip.causes, hip.sentence
    assert any(finding.code == "replay.driven" for finding in knee.findings)


def bare(data: MeasuredSet, chain: list, keep: tuple[str, ...]) -> MeasuredSet:
    """The runs with only some columns of each joint."""
    runs = []
    for run in data.runs:
        joints = {
            name: JointLog(goal=log.goal, position=log.position, **{key: getattr(log, key) for key in keep})
            for name, log in run.joints.items()
        }
        runs.append(
            MeasuredRun(run.name, run.time, joints, {}, run.robot, run.robot_params, dict.fromkeys(JOINTS, chain))
        )
    return MeasuredSet(tuple(runs), data.name)


@pytest.mark.long
def test_a_log_that_cannot_tell_says_which_column_would() -> None:
    data, _ = hidden_hopper({}, seed=12, duration=6.0, runs=2)
    for chain, column in ((nominal_hopper_chain(), "link_position"), (RIGID, "duty")):
        for found in diagnose(bare(data, chain, ())):
            assert found.verdict == NOT_IDENTIFIABLE
        assert column in diagnose(bare(data, chain, ()))[0].text


def test_a_rigid_joint_is_judged_by_what_it_asks_of_its_drive() -> None:
    data, _ = hidden_hopper({}, seed=12, duration=6.0, runs=2)
    problem = problem_of(bare(data, RIGID, ("duty", "current")), "hip")
    assert problem.signal == ("current", "A")
    _, hidden = shown(problem, problem.models[0], catalogue(problem.models[0]))
    assert "friction.coulomb" in hidden and "transmission.backlash" in hidden


@pytest.mark.long
def test_samples_without_the_judged_column_do_not_count() -> None:
    data, _ = hidden_hopper({}, seed=12, duration=6.0, runs=2)
    gaps = []
    for run in bare(data, RIGID, ("duty", "current")).runs:
        current = run.joints["hip"].current
        assert current is not None
        current = np.where(np.arange(len(run.time)) % 7 == 0, np.nan, current)
        gaps.append(replace(run, joints={"hip": replace(run.joints["hip"], current=current)}))
    whole = problem_of(bare(data, RIGID, ("duty", "current")), "hip")
    problem = problem_of(MeasuredSet(tuple(gaps), "gaps"), "hip")
    assert problem.judged.sum() == pytest.approx(6 / 7 * whole.judged.sum(), rel=0.01)
    assert np.isfinite(problem.position_error(problem.simulate([{}])[0])).all()


@pytest.mark.parametrize("push", [-0.05, 0.05])
def test_dry_friction_holds_a_rigid_joint_at_rest_whichever_way_it_is_pushed(push: float) -> None:
    chain = [stage if "friction" not in stage else {"friction": {"coulomb": 0.03}} for stage in RIGID]
    time = np.arange(0.0, 1.0, 0.005)
    rest = np.zeros((len(time), 3))
    free = drive(
        [s if "friction" not in s else {"friction": {"coulomb": 0.0}} for s in chain], time * 0 + push, rest, time
    )
    held = drive(chain, time * 0 + push, rest, time)
    np.testing.assert_allclose(held[5:, 1], free[5:, 1] - np.copysign(0.03, push), atol=1e-9)


def test_a_motor_behind_a_spring_starts_where_its_reading_says() -> None:
    time = np.arange(0.0, 1.0, 0.005)
    chain = [{"position_p": {"gain": 0.0}}, *SPRING[1:-1], {"encoder": {"ticks": 0, "scale": 2.0, "offset": 0.1}}]
    out = drive(chain, np.zeros(len(time)), np.stack([0.2 + 0.0 * time, 0 * time, 0 * time], axis=1), time)
    assert out[0, 0] == pytest.approx(0.2, abs=1e-9)
