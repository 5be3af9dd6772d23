"""Safety: goals are kept within limits, measurements beyond them end the run, no limit can be left out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.common.errors import SealegsError
from sealegs.configs.compose import compose
from sealegs.hw.bus.packets import NoReplyError
from sealegs.hw.bus.servo_state import ServoState
from sealegs.hw.guard.safety import Fault, Limits, Safety
from sealegs.hw.machine.limits import Ability, Following, ability
from sealegs.hw.machine.robot import Reading, build_robot
from sealegs.hw.run.commands import Trajectory
from sealegs.hw.run.measured_log import read_events

from tests.simulated_runs import XL330, Simulation, sine

CONFIG: dict[str, Any] = compose("deploy", {"robot": "hopper"})["robot"]
PERIOD = 0.01


def guard(**limits: Any) -> Safety:
    values = {**Limits.from_config(CONFIG["safety"]).__dict__, **limits}
    return Safety(build_robot(CONFIG), Limits(**values), PERIOD)


def reading(took: float = 0.002, status: tuple[int, int] = (0, 0), at: float = 0.0, **values: Any) -> Reading:
    """Of two joints, asked for ``at`` [s]."""
    base = {
        "position": (-0.61, 0.61),
        "velocity": (0.0, 0.0),
        "current": (0.1, 0.1),
        "voltage": (7.4, 7.4),
        "temperature": (30.0, 30.0),
    }
    arrays = {name: np.array(value, float) for name, value in {**base, **values}.items()}
    zero = np.zeros(2)
    state = ServoState((1, 2), 0.0, took, zero, zero, zero, zero, zero, zero, zero, np.array(status), zero, {})
    more = {"duty": zero, "link": zero, "base_position": zero, "base_velocity": zero, "state": state}
    return Reading(before=at, after=at + took, **arrays, **more)


def test_what_is_within_the_limits_passes_untouched() -> None:
    safety = guard()
    goals = np.array([-0.5, 0.7])
    admitted = safety.admit(goals, np.array([-0.6, 0.6]))
    assert isinstance(admitted, np.ndarray) and (admitted == goals).all() and safety.judge(reading()) is None
    assert safety.cut == {"range": 0, "speed": 0}


def test_goals_are_cut_to_range_and_speed() -> None:
    safety = guard(goal_speed=20.0)
    admitted = safety.admit(np.array([0.5, 5.0]), np.array([-0.1, 1.15]))
    assert isinstance(admitted, np.ndarray)
    assert admitted == pytest.approx([-0.01, 1.21]), "hip goes up to -0.01 rad, knee up to 1.21 rad"
    assert safety.cut == {"range": 1, "speed": 1}
    admitted = safety.admit(np.array([-1.0, 1.0]), np.array([-0.1, 1.1]))
    assert isinstance(admitted, np.ndarray) and admitted == pytest.approx([-0.3, 1.0])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_goal_that_is_no_number_ends_the_run(bad: float) -> None:
    fault = guard().admit(np.array([-0.5, bad]), np.array([-0.6, 0.6]))
    assert isinstance(fault, Fault) and fault.name == "goal" and "knee" in fault.sentence


@pytest.mark.parametrize(
    ("values", "name", "says"),
    [
        ({"position": (-0.61, 1.7)}, "range", "joint knee (servo 2) is 0.490 rad beyond its range"),
        ({"velocity": (-40.0, 0.0)}, "speed", "joint hip (servo 1) moves at 40 rad/s"),
        ({"temperature": (30.0, 71.0)}, "temperature", "is at 71 degC; its limit is 65 degC"),
        ({"voltage": (5.1, 5.1)}, "voltage", "gets 5.1 V, under safety.voltage_low, 6 V"),
        ({"voltage": (9.9, 7.4)}, "voltage", "gets 9.9 V, over safety.voltage_high"),
        ({"position": (np.nan, 0.61)}, "range", "joint hip"),
        ({"status": (0, 32)}, "OverloadFault", "servo 2 is overloaded"),
        ({"status": (4, 0)}, "OverheatFault", "servo 1 is hotter"),
    ],
)
def test_a_measurement_beyond_a_limit_is_named_with_its_joint(values: dict[str, Any], name: str, says: str) -> None:
    fault = guard().judge(reading(**values))
    assert fault is not None and fault.name == name and says in fault.sentence


def test_current_may_peak_but_not_stay() -> None:
    safety = guard(current=2.0, current_time=0.05)
    strong = [reading(at=cycle * PERIOD, current=(2.4, 0.1)) for cycle in range(11)]
    assert [safety.judge(item) for item in strong[:4]] == [None] * 4
    assert safety.judge(reading(at=4 * PERIOD)) is None
    faults = [safety.judge(item) for item in strong[5:]]
    assert faults[:5] == [None] * 5 and faults[5] is not None and faults[5].name == "current"


LOST = NoReplyError("servo 2 did not answer.", [2])


def test_lost_replies_are_tolerated_by_their_rate_and_a_silent_servo_is_named_after_its_time() -> None:
    safety = guard(silent=0.05, loss=0.1)
    for cycle in range(2000):  # one in twenty, now and then three in a row
        gone = cycle % 60 < 3
        assert safety.missed(LOST if gone else None, [2] if gone else [], cycle * PERIOD) is None
    faults = [safety.missed(LOST, [2], cycle * PERIOD) for cycle in range(2000, 2006)]
    assert faults[:5] == [None] * 5 and faults[5] is not None
    assert (faults[5].name, faults[5].servos) == ("NoReplyError", (2,)) and "for 60 ms" in faults[5].sentence


def test_a_servo_that_loses_every_third_reply_ends_the_run_though_it_is_never_silent() -> None:
    safety = guard(silent=0.05, loss=0.1)
    cycles = [(LOST if cycle % 3 == 0 else None, [2] if cycle % 3 == 0 else [], cycle) for cycle in range(200)]
    faults = [safety.missed(lost, servos, cycle * PERIOD) for lost, servos, cycle in cycles]
    (fault, *_) = [fault for fault in faults if fault is not None]
    assert fault.servos == (2,) and "% of its replies" in fault.sentence


def test_a_late_reading_that_is_tolerated_is_judged_all_the_same() -> None:
    fault = guard(late=0.008).judge(reading(took=0.009, temperature=(30.0, 71.0)))
    assert fault is not None and fault.name == "temperature"


def test_late_readings_count_as_missing() -> None:
    safety = guard(late=0.008, silent=0.02)
    faults = [safety.judge(reading(took=0.009, at=cycle * PERIOD)) for cycle in range(3)]
    assert faults[:2] == [None, None]
    assert faults[2] is not None and faults[2].name == "late" and "9.0 ms" in faults[2].sentence


@pytest.mark.parametrize("cycle", [PERIOD, 4.0 * PERIOD])
def test_times_are_the_clocks_however_long_the_cycles_take(cycle: float) -> None:
    def until(ask: Any) -> float:
        return next(cycle * k for k in range(1000) if ask(cycle * k) is not None)

    strong = guard(current=2.0, current_time=0.2)
    assert until(lambda at: strong.judge(reading(at=at, current=(2.4, 0.1)))) == pytest.approx(0.2, abs=cycle)
    silent = guard(silent=0.2)
    assert until(lambda at: silent.missed(LOST, [2], at)) == pytest.approx(0.2, abs=cycle)
    behind = guard(following_time=0.2)
    assert until(lambda at: behind.follows(np.array([-0.1, 1.1]), reading(at=at))) == pytest.approx(
        0.22, abs=2.0 * cycle
    )
    fast = guard(goal_speed=1.0, following_time=0.2)

    def wild(at: float) -> Fault | None:
        found = fast.admit(np.array([-0.6, 0.1 + 2.0 * at]), np.array([-0.6, 0.6]), at)
        return found if isinstance(found, Fault) else None

    assert until(wild) == pytest.approx(0.22, abs=2.0 * cycle)


def test_one_lost_reply_after_a_stall_is_no_silent_servo() -> None:
    safety = guard(silent=0.05, loss=0.1)
    assert [safety.missed(None, [], at) for at in (0.0, 0.01, 0.02)] == [None] * 3
    assert safety.missed(LOST, [2], 0.5) is None and safety.missed(LOST, [2], 0.51) is not None


# --- limits joint by joint ---------------------------------------------------------------------------------------


def crawler(**limits: Any) -> Safety:
    config: dict[str, Any] = compose("deploy", {"robot": "hexapod"})["robot"]
    return Safety(build_robot(config), Limits.from_config({**config["safety"], **limits}), PERIOD)


def test_joints_in_metres_have_limits_of_their_own() -> None:
    robot = build_robot(compose("deploy", {"robot": "hexapod"})["robot"])
    limits = Limits.from_config(compose("deploy", {"robot": "hexapod"})["robot"]["safety"])
    span = robot.high - robot.low
    assert (limits.by_joint("range_margin", robot) < 0.5 * span).all(), "a margin is less than the range"
    screws = np.array([unit == "m" for unit in robot.units])
    assert (limits.by_joint("speed", robot)[screws] < 0.1).all(), "a screw without load makes 23 mm/s"


def test_a_joint_in_metres_that_leaves_its_range_by_millimetres_ends_the_run() -> None:
    safety, robot = crawler(), build_robot(compose("deploy", {"robot": "hexapod"})["robot"])
    k = robot.names.index("leg0_vertical")
    middle, zero = 0.5 * (robot.low + robot.high), np.zeros(18)
    state = {"velocity": zero, "current": zero, "voltage": zero + 24.0, "temperature": zero + 30.0}
    more = {"duty": zero, "link": zero, "base_position": zero, "base_velocity": zero, "state": None}

    def judged(**changed: np.ndarray) -> Fault | None:
        return safety.judge(Reading(0.0, 0.002, **{"position": middle, **state, **more, **changed}))

    away = np.where(np.arange(18) == k, 1.0, 0.0)
    assert judged() is None
    out = judged(position=middle + away * (robot.high[k] - middle[k] + 0.006))
    assert out is not None and out.name == "range" and "joint leg0_vertical" in out.sentence and " m " in out.sentence
    fast = judged(velocity=away * 0.2)
    assert fast is not None and fast.name == "speed" and "m/s" in fast.sentence


@pytest.mark.long
@pytest.mark.parametrize(
    ("limits", "says"),
    [
        ({"range_margin": 0.15}, "range_margin is 0.15 rad, but joint leg0_vertical and 11 more joints are in m"),
        ({"range_margin": 0.15, "speed": 9.0}, 'safety.speed is 9 rad/s.*\'robot.safety.speed=."leg0_vertical": 0.5, '),
        ({"speed": {"*_rotation": 5.0}}, "has no value for joint leg0_vertical"),
        ({"speed": {"*": 5.0, "*_vertcal": 1.0}}, "fits no joint"),
        ({"speed": {"*": 0.0}}, "safety.speed is 0; it must be above 0"),
    ],
)
def test_limits_that_do_not_fit_the_joints_are_refused(limits: dict[str, Any], says: str) -> None:
    with pytest.raises(SealegsError, match=says):
        crawler(**limits)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"speed": None}, "safety.speed takes a number"),
        ({"speed": -1.0}, "safety.speed is -1"),
        ({"sped": 1.0}, "did you mean 'speed'?"),
        ({"voltage_low": 9.0}, "not below voltage_high"),
        ({"loss": 0.0}, "safety.loss is 0"),
        ({"log_only": ["speed"]}, "it may hold following and goal_speed"),
    ],
)
def test_limits_cannot_be_switched_off(change: dict[str, Any], says: str) -> None:
    with pytest.raises(SealegsError, match=says.replace("?", r"\?")):
        Limits.from_config({**CONFIG["safety"], **change})
    without = {key: value for key, value in CONFIG["safety"].items() if key != "temperature"}
    with pytest.raises(SealegsError, match=r"safety\.temperature is missing"):
        Limits.from_config(without)


def test_a_reading_of_another_size_is_no_goal() -> None:
    assert isinstance(guard().admit(np.zeros(3), np.zeros(2)), Fault)
    assert replace(Fault("a", "b"), name="c").servos == ()


# --- joints that do not follow: blocked or blind ones are named, loaded and slow ones left alone, jumps are cut ------

LOOSE = {"range_margin": 9.0, "speed": 99.0, "current": 99.0}
"""Limits other than those of following."""


@pytest.mark.parametrize(
    ("servo", "amplitude"),
    [
        ((), 0.04),
        (XL330, 0.1),
        *(pytest.param(*row, marks=pytest.mark.long) for row in (((), 0.02), (XL330, 0.06), (XL330, 0.2))),
    ],
    ids=str,
)
def test_a_servo_that_goes_blind_is_stopped_before_it_turns_away(servo: tuple[str, ...], amplitude: float) -> None:
    frozen = {"kind": "frozen", "at": 3.3}
    simulation = Simulation("bench", *servo, commands=sine(amplitude), faults=[frozen], limits=LOOSE)
    outcome = simulation.run(5.0)
    assert outcome.fault is not None and outcome.fault.name in ("following", "frozen"), simulation.port.now()
    assert abs(simulation.rig.machine.position(0)) < 1.5, "it would turn by a radian in each second"
    assert simulation.port.now() - 3.3 < 2.0, "a period of the sine"


@pytest.mark.parametrize("servo", [(), XL330], ids=str)
@pytest.mark.parametrize(("hertz", "seconds"), [(0.1, 7.0), pytest.param(0.02, 30.0, marks=pytest.mark.long)])
def test_a_servo_that_sticks_and_slips_under_its_load_is_left_alone(
    servo: tuple[str, ...], hertz: float, seconds: float
) -> None:
    heavy = ("robot.params.mass=0.6", "robot.params.length=0.12") if not servo else ()
    simulation = Simulation("bench", *servo, *heavy, commands=sine(0.3, hertz, offset=0.5), limits=LOOSE)
    assert simulation.run(seconds).ending == "finished"


@pytest.mark.long
@pytest.mark.parametrize("amplitude", [0.01, 0.05])
def test_twice_the_friction_that_the_chain_has_is_no_blind_servo(amplitude: float, tmp_path: Path) -> None:
    hidden = tmp_path / "stiff.yaml"
    hidden.write_text("friction.coulomb: 0.1\n")
    outcome = Simulation(hidden=str(hidden), commands=sine(amplitude, 0.2), limits=LOOSE).run(4.0)
    assert outcome.ending == "finished", outcome.fault


def test_a_goal_that_shakes_about_one_place_makes_no_servo_blind_and_one_that_goes_away_does() -> None:
    for drift, blind in ((0.0, False), (0.02, True)):  # [rad/s]
        following = Following([Ability(0.3, 10.0, 0.3, 0.0075, 0.3)], np.array([np.nan]), 0.01)
        random, here = np.random.default_rng(0), np.array([1.4])
        for k in range(200):
            goal = here + random.choice((-0.009, 0.0, 0.009), 1) + drift * 0.01 * k
            following.see(goal, here, np.array([True]), 0.01 * k)
        assert (following.stuck[0] > 0.3) == blind


def test_a_joint_that_arrives_with_its_goal_is_not_taken_for_blind() -> None:
    following = Following([Ability(0.3, 10.0, 0.3, 0.0075, 0.3)], np.array([np.nan]), 0.01)
    for k in range(150):
        goal = np.array([min(0.01 * k, 0.5)])
        following.see(goal, np.maximum(goal - 0.02, 0.0), np.array([True]), 0.01 * k)
    assert following.stuck[0] == 0.0


def test_a_joint_that_is_told_to_stand_still_is_not_taken_for_blind() -> None:
    def step(robot: Any) -> Trajectory:
        time = np.arange(0.0, 20.0, 0.01)
        return Trajectory("step", time, np.where(time > 1.0, 0.8, 0.0)[:, None])

    outcome = Simulation(commands=step, limits=LOOSE).run(4.0)
    assert outcome.ending == "finished", outcome.fault


@pytest.mark.long
@pytest.mark.parametrize("amplitude", [0.06, 0.3, 1.0])
@pytest.mark.parametrize("at", [1.0, 1.9, 2.6])
def test_a_frozen_encoder_ends_the_run_within_two_thirds_of_a_period(amplitude: float, at: float) -> None:
    frozen = {"kind": "frozen", "at": at + 1.0}
    simulation = Simulation(commands=sine(amplitude), faults=[frozen], limits={"range_margin": 9.0})
    outcome = simulation.run(12.0)
    assert outcome.fault is not None and outcome.fault.name in ("following", "frozen") and simulation.torque == [False]
    assert simulation.port.now() - at - 1.0 < 1.4, "of a sine of 0.5 Hz"


@pytest.mark.long
def test_a_joint_that_follows_is_left_alone_however_it_is_driven() -> None:
    for commands in (sine(0.9, 0.3), sine(0.5, 4.0), sine(0.9, 1.5)):
        assert Simulation(commands=commands, limits={"speed": 100.0}).run(6.0).ending == "finished"


@pytest.mark.long
def test_a_joint_behind_its_goal_may_be_logged_before_it_stops(tmp_path: Path) -> None:
    frozen = {"kind": "frozen", "at": 2.0, "seconds": 2.0}
    limits = {"range_margin": 9.0, "speed": 99.0, "log_only": ["following"]}
    simulation = Simulation(faults=[frozen], limits=limits, folder=tmp_path)
    assert simulation.run(6.0).ending == "finished"
    noted = [event for event in read_events(tmp_path / "run.csv") if event["event"] == "limit"]
    assert {event["name"] for event in noted} <= {"following", "frozen"} and 1 <= len(noted) <= 6


def test_the_limits_of_following_come_from_the_servos_chain() -> None:
    servo, small = (ability(load_chain(name)) for name in ("sts3215", "xl330"))
    assert servo.error == pytest.approx(0.97 / 5.3) and servo.speed == pytest.approx(0.97 * 7.4 / 1.2)
    assert small.error == pytest.approx(1.0 / 1.151) and small.speed == pytest.approx(7.4 / 0.41)


@pytest.mark.long
def test_a_goal_jumps_no_further_than_its_speed_allows_and_may_not_jump_for_long() -> None:
    def wild(robot: Any) -> Trajectory:
        time = np.arange(0.0, 10.0, 0.01)
        return Trajectory("wild", time, 0.9 * np.where(np.arange(len(time)) % 2, 1.0, -1.0)[:, None])

    simulation = Simulation(commands=wild, limits={"speed": 100.0})
    sent: list[np.ndarray] = []
    simulation.loop.each_cycle = lambda: sent.append(simulation.loop.sent) if simulation.loop.elapsed else None
    outcome = simulation.run(5.0)
    assert outcome.fault is not None and outcome.fault.name == "goal_speed" and outcome.cut["speed"] > 10
    assert np.abs(np.diff(np.array(sent)[-20:, 0])).max() < 0.24, "four times the no-load speed, in a cycle"
    limits = {"speed": 100.0, "current": 99.0, "log_only": ["goal_speed", "following"]}
    outcome = Simulation(commands=wild, limits=limits).run(1.5)
    assert outcome.ending == "finished" and outcome.cut["speed"] == 0, outcome.fault
