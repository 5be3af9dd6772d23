"""Safety: goals are kept within limits, measurements beyond them end the run, no limit can be left out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sealegs.common.errors import SealegsError
from sealegs.configs.compose import compose
from sealegs.hw.bus.packets import NoReplyError
from sealegs.hw.bus.servo_state import ServoState
from sealegs.hw.guard.safety import Fault, Limits, Safety
from sealegs.hw.machine.robot import Reading, build_robot

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
